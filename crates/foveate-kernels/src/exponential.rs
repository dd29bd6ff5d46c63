//! e^x in double precision over slices, for log weights that become weights.
//!
//! e^z = 2ⁿ eʳ with n = round(z / ln 2) and |r| ≤ ln 2 / 2 (Cody & Waite 1980), eʳ by its series.

use crate::Level;
use crate::wide::same_bits;

/// Maxima, and sums, side by side.
const LANES: usize = 8;

/// e^z for z in [-708, 0] with a relative error below 1e-15. 0 outside and for NaN.
#[inline(always)]
pub(crate) fn exp(z: f64) -> f64 {
    /// Adding this to a small number leaves it, rounded, plus the exponent's bias, in the low bits.
    const MAGIC: f64 = 6_755_399_441_055_744.0 + 1023.0;
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1; // 33 bits: n times it is exact
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let shifted = z * std::f64::consts::LOG2_E + MAGIC;
    let n = shifted - MAGIC;
    let r = z - n * LN_2_HIGH - n * LN_2_LOW;
    let mut p = 1.0 / 479_001_600.0; // 12!
    for factorial in [39_916_800.0, 3_628_800.0, 362_880.0, 40_320.0, 5040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        p = p * r + 1.0 / factorial;
    }
    let value = p * f64::from_bits(shifted.to_bits() << 52);
    if (-708.0..=0.0).contains(&z) { value } else { 0.0 }
}

#[inline(always)]
fn exp_from_body(x: &[f64], top: f64, out: &mut [f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let ((rows, rest), (out, out_rest)) = (x.as_chunks::<LANES>(), out.as_chunks_mut::<LANES>());
    for (row, out) in rows.iter().zip(out) {
        for i in 0..LANES {
            out[i] = exp(row[i] - top);
            lanes[i] += out[i];
        }
    }
    for (i, (&x, out)) in rest.iter().zip(out_rest).enumerate() {
        *out = exp(x - top);
        lanes[i] += *out;
    }
    lanes.iter().sum()
}

#[inline(always)]
fn largest_body(x: &[f64]) -> f64 {
    let larger = |max: f64, x: f64| if x > max && x < f64::INFINITY { x } else { max };
    let mut lanes = [f64::NEG_INFINITY; LANES];
    let (rows, rest) = x.as_chunks::<LANES>();
    for row in rows {
        for i in 0..LANES {
            lanes[i] = larger(lanes[i], row[i]);
        }
    }
    lanes.into_iter().chain(rest.iter().copied()).fold(f64::NEG_INFINITY, larger)
}

same_bits! {
    fn exp_from_at(x: &[f64], top: f64, out: &mut [f64]) -> f64 = exp_from_body
}

same_bits! {
    fn largest_at(x: &[f64]) -> f64 = largest_body
}

/// out ← e^(x − top) if x − top is from −708 to 0; 0 otherwise and for NaN. Returns Σ out, in eight parallel sums.
///
/// Relative error below 1e-15; the same bits on every processor. Panics if the lengths differ.
pub fn exp_from(x: &[f64], top: f64, out: &mut [f64]) -> f64 {
    assert_eq!(x.len(), out.len(), "x and out must be equally long");
    exp_from_at(Level::best(), x, top, out)
}

/// The largest finite number of `x`; −∞ if there is none.
pub fn largest_finite(x: &[f64]) -> f64 {
    largest_at(Level::best(), x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_library_at_every_level() {
        let x: Vec<f64> = (0..=708_000).map(|i| f64::from(i) * -1e-3).chain([-1e-17, -1e-300, -0.0]).collect();
        let mut exact = vec![0.0; x.len()];
        let sum = exp_from_at(Level::Portable, &x, 0.0, &mut exact);
        assert!((sum / exact.iter().sum::<f64>() - 1.0).abs() < 1e-13);
        for (&x, &y) in x.iter().zip(&exact) {
            assert!((y / x.exp() - 1.0).abs() < 1e-15, "e^{x} is {}, not {y}", x.exp());
        }
        for level in Level::all() {
            let mut y = vec![0.0; x.len()];
            assert_eq!(exp_from_at(level, &x, 0.0, &mut y), sum);
            assert!(y == exact, "{level:?}");
        }
    }

    #[test]
    fn what_is_not_finite_weighs_nothing() {
        let x = [f64::NAN, f64::NEG_INFINITY, f64::INFINITY, 3.0, -5000.0, 2.0, f64::MIN];
        for level in Level::all() {
            let mut y = [f64::NAN; 7];
            exp_from_at(level, &x, 3.0, &mut y);
            assert_eq!(y[..5], [0.0, 0.0, 0.0, 1.0, 0.0], "{level:?}");
            assert_eq!(y[6], 0.0);
            for repeats in 1..5 {
                let x = x.repeat(repeats);
                assert_eq!(largest_at(level, &x), 3.0);
                assert_eq!(largest_at(level, &x[..3]), f64::NEG_INFINITY);
            }
        }
    }
}
