//! Sums over hidden units for all classes at once, for classification by free energy.

use crate::level::{levels, multiply_add};
use crate::sums::fold;

const LANES: usize = 32;
/// Terms with one logarithm: at most 17 factors of at least a half in a lane, and 32 lanes, do not underflow in f64.
const PIECE: usize = 512;

#[inline(always)]
fn softplus_sum_body<const V: u8>(x: &[f32], bias: &[f32], on: &[f32]) -> f64 {
    assert!(x.len() == bias.len() && x.len() == on.len(), "as many of each");
    let mut sum = 0.0;
    for ((x, bias), on) in x.chunks(PIECE).zip(bias.chunks(PIECE)).zip(on.chunks(PIECE)) {
        let (mut positive, mut product) = ([0.0f32; LANES], [1.0f32; LANES]);
        let ((x, x_end), (b, b_end), (s, s_end)) =
            (x.as_chunks::<LANES>(), bias.as_chunks::<LANES>(), on.as_chunks::<LANES>());
        for ((x, b), s) in x.iter().zip(b).zip(s) {
            for i in 0..LANES {
                positive[i] += (x[i] + b[i]).max(0.0);
                product[i] *= s[i].max(1.0 - s[i]);
            }
        }
        for (i, ((x, b), s)) in x_end.iter().zip(b_end).zip(s_end).enumerate() {
            positive[i] += (x + b).max(0.0);
            product[i] *= s.max(1.0 - s);
        }
        let product: f64 = product.iter().map(|&p| f64::from(p)).product();
        sum += f64::from(fold(positive)) - product.ln();
    }
    sum
}

levels! {
    /// Σ log(1 + exp(x + bias)), given `on` = logistic(x + bias), for x + bias of at most a few thousand in size.
    ///
    /// log(1 + eʸ) = max(y, 0) − log max(s, 1 − s) with s = logistic(y): no further exponential, and a logarithm for 512
    /// terms. Relative error about 1e-6.
    ///
    /// # Panics
    /// If the slices are not equally long.
    pub fn softplus_sum / softplus_sum_at (x: &[f32], bias: &[f32], on: &[f32]) -> f64 = softplus_sum_body
}

#[inline(always)]
fn add_to_both_body<const V: u8>(factor: f32, x: &[f32], a: &mut [f32], b: &mut [f32]) {
    assert!(x.len() == a.len() && x.len() == b.len(), "as many of each");
    for ((&x, a), b) in x.iter().zip(a).zip(b) {
        *a = multiply_add::<V>(factor, x, *a);
        *b = multiply_add::<V>(factor, x, *b);
    }
}

levels! {
    /// `a` += `factor` · `x`, and `b` += `factor` · `x`.
    ///
    /// # Panics
    /// If the slices are not equally long.
    pub fn add_to_both / add_to_both_at (factor: f32, x: &[f32], a: &mut [f32], b: &mut [f32]) = add_to_both_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, logistic};

    #[test]
    fn agree_with_f64() {
        for n in [0, 1, 31, 32, 500, 512, 513, 1100] {
            let x: Vec<f32> = (0..n).map(|i| (i as f32 * 0.71).sin() * 40.0).collect();
            let bias: Vec<f32> = (0..n).map(|i| (i as f32 * 1.3).cos() * 3.0).collect();
            let mut on: Vec<f32> = x.iter().zip(&bias).map(|(x, b)| x + b).collect();
            logistic(&mut on);
            let y = x.iter().zip(&bias).map(|(&x, &b)| f64::from(x) + f64::from(b));
            let exact: f64 = y.map(|y| y.max(0.0) + (-y.abs()).exp().ln_1p()).sum();
            for level in Level::all() {
                let found = softplus_sum_at(level, &x, &bias, &on);
                assert!((found - exact).abs() < 1e-5 * (1.0 + exact), "{level:?} {n}: {found} {exact}");
                let (mut a, mut b) = (bias.clone(), x.clone());
                add_to_both_at(level, 0.5, &x, &mut a, &mut b);
                for i in 0..n {
                    assert!((a[i] - (bias[i] + 0.5 * x[i])).abs() < 1e-4 && (b[i] - 1.5 * x[i]).abs() < 1e-4);
                }
            }
        }
        // All terms at the extremes: no underflow, no infinity.
        let (x, on) = ([200.0; 600], [1.0; 600]);
        assert!((softplus_sum(&x, &[0.0; 600], &on) - 120_000.0).abs() < 1.0);
        assert!((softplus_sum(&[0.0; 600], &[0.0; 600], &[0.5; 600]) - 600.0 * 2f64.ln()).abs() < 1e-3);
    }
}
