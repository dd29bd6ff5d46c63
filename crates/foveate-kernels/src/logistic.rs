//! The logistic function 1 / (1 + e^-x) over slices.
//!
//! e^-x = 2^n e^r with n = round(-x / ln 2) and |r| ≤ ln 2 / 2: r by a two-part ln 2 (Cody and Waite
//! 1980), e^r by a polynomial of degree 6, 2^n by writing the exponent. There is no branch and no
//! conversion to an integer, so a NaN passes through.

use crate::level::{levels, multiply_add};

/// Adding this to a small number leaves it, rounded, plus the exponent bias 127, in the low bits.
const MAGIC: f32 = 12_582_912.0 + 127.0;
const LN_2_HIGH: f32 = 0.693_359_4;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// e^z for z in [-87, 88.3], relative error about 1e-7; at least 1e-38 below that, infinite above it; NaN stays NaN.
#[inline(always)]
fn exp<const V: u8>(z: f32) -> f32 {
    let z = z.clamp(-87.0, 89.0);
    let shifted = multiply_add::<V>(z, std::f32::consts::LOG2_E, MAGIC);
    let n = shifted - MAGIC;
    let r = multiply_add::<V>(n, -LN_2_HIGH, z);
    let r = multiply_add::<V>(n, -LN_2_LOW, r);
    let p = multiply_add::<V>(r, 1.0 / 720.0, 1.0 / 120.0);
    let p = multiply_add::<V>(p, r, 1.0 / 24.0);
    let p = multiply_add::<V>(p, r, 1.0 / 6.0);
    let p = multiply_add::<V>(p, r, 0.5);
    let p = multiply_add::<V>(p, r, 1.0);
    let p = multiply_add::<V>(p, r, 1.0);
    p * f32::from_bits(shifted.to_bits() << 23)
}

/// 1 + 2^x, at least 1 and at most 2.3e38; relative error 2e-7; NaN stays NaN.
///
/// Cheaper than [`exp`] by half: no product for the base, a polynomial of degree 5 (least greatest error, 1.1e-7)
/// with value 1 and slope ln 2 at 0, and the exponent added to that of the polynomial.
#[inline(always)]
pub(crate) fn one_plus_exp2<const V: u8>(x: f32) -> f32 {
    let x = x.clamp(-126.0, 127.4);
    let shifted = x + (MAGIC - 127.0);
    let f = x - (shifted - (MAGIC - 127.0));
    let p = multiply_add::<V>(f, 1.330_060_5e-3, 9.669_691e-3);
    let p = multiply_add::<V>(p, f, 5.550_558_5e-2);
    let p = multiply_add::<V>(p, f, 0.240_222_83);
    let p = multiply_add::<V>(p, f, std::f32::consts::LN_2);
    let p = multiply_add::<V>(p, f, 1.0);
    1.0 + f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// 1 / (1 + e^-x).
#[inline(always)]
pub(crate) fn logistic_of<const V: u8>(x: f32) -> f32 {
    1.0 / (1.0 + exp::<V>(-x))
}

#[inline(always)]
fn logistic_body<const V: u8>(x: &mut [f32]) {
    for x in x {
        *x = logistic_of::<V>(*x);
    }
}

#[inline(always)]
fn bias_logistic_body<const V: u8>(rows: &mut [f32], bias: &[f32]) {
    for row in rows.chunks_exact_mut(bias.len()) {
        for (x, &b) in row.iter_mut().zip(bias) {
            *x = logistic_of::<V>(*x + b);
        }
    }
}

levels! {
    /// x ← 1 / (1 + e^-x) in place.
    ///
    /// Relative error below 3e-7 (1.3e-7 with FMA) for x ≥ -87; below that the result is within 1.2e-38 of the truth and
    /// 0 from -88.4 on. NaN stays NaN.
    pub fn logistic / logistic_at (x: &mut [f32]) = logistic_body
}

levels! {
    /// Every row x of `rows` (n × `bias.len()`) becomes 1 / (1 + e^-(x + bias)).
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows.
    pub fn bias_logistic / bias_logistic_at (rows: &mut [f32], bias: &[f32]) = bias_logistic_checked
}

#[inline(always)]
fn bias_logistic_checked<const V: u8>(rows: &mut [f32], bias: &[f32]) {
    if rows.is_empty() {
        return;
    }
    assert!(
        !bias.is_empty() && rows.len().is_multiple_of(bias.len()),
        "{} values are not whole rows of {}",
        rows.len(),
        bias.len()
    );
    bias_logistic_body::<V>(rows, bias);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;

    #[test]
    fn agrees_with_f64_everywhere() {
        let xs: Vec<f32> = (-880_000..=1_000_000).map(|i| i as f32 * 1e-4).collect();
        for level in Level::all() {
            let mut ys = xs.clone();
            logistic_at(level, &mut ys);
            let mut worst = 0.0f64;
            for (&x, &y) in xs.iter().zip(&ys) {
                let truth = 1.0 / (1.0 + (-x as f64).exp());
                if x >= -87.0 {
                    worst = worst.max((y as f64 / truth - 1.0).abs());
                } else {
                    assert!((y as f64 - truth).abs() < 1.2e-38, "{level:?}: {x} gave {y}");
                }
            }
            assert!(worst < 3e-7, "{level:?}: relative error {worst}");
        }
    }

    #[test]
    fn ends_of_the_line() {
        for level in Level::all() {
            let mut x = [f32::NEG_INFINITY, f32::MIN, -200.0, -0.0, 0.0, 200.0, f32::MAX, f32::INFINITY, f32::NAN];
            logistic_at(level, &mut x);
            assert_eq!(x[..8], [0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.0], "{level:?}");
            assert!(x[8].is_nan());
        }
    }

    /// An element's result does not depend on its position.
    #[test]
    fn place_does_not_matter() {
        let xs: Vec<f32> = (0..101).map(|i| (i as f32 * 0.37 - 18.0) * 1.1).collect();
        for level in Level::all() {
            let mut whole = xs.clone();
            logistic_at(level, &mut whole);
            for (&x, &y) in xs.iter().zip(&whole) {
                let mut one = [x];
                logistic_at(level, &mut one);
                assert_eq!(one[0].to_bits(), y.to_bits());
            }
        }
    }

    #[test]
    fn bias_is_added_to_every_row() {
        let bias: Vec<f32> = (0..37).map(|j| j as f32 * 0.1 - 2.0).collect();
        for level in Level::all() {
            let mut rows: Vec<f32> = (0..3 * 37).map(|i| i as f32 * 0.03 - 1.0).collect();
            let mut twin: Vec<f32> = rows.iter().enumerate().map(|(i, &x)| x + bias[i % 37]).collect();
            bias_logistic_at(level, &mut rows, &bias);
            logistic_at(level, &mut twin);
            assert_eq!(rows, twin, "{level:?}");
        }
        bias_logistic(&mut [], &[]);
    }
}
