//! Operations on rows of units between the products: biases, probabilities, draws, sums.

use super::Visible;
use foveate_base::rng::Rng;
use rand::Rng as _;
use rand_distr::{Distribution, StandardNormal};

/// Adds `bias` to every row of `x`.
pub fn add_bias(x: &mut [f32], bias: &[f32]) {
    for row in x.chunks_exact_mut(bias.len()) {
        row.iter_mut().zip(bias).for_each(|(x, b)| *x += b);
    }
}

/// log(1 + eˣ) without overflow.
pub fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// aᵀb in f64.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}

/// The part of the energy that the visible units have with a bias alone.
pub(super) fn visible_energy(visible: Visible, bias: &[f32], v: &[f32]) -> f64 {
    match visible {
        Visible::Bernoulli => -dot(bias, v),
        Visible::Gaussian => {
            0.5 * v.iter().zip(bias).map(|(v, b)| (f64::from(*v) - f64::from(*b)).powi(2)).sum::<f64>()
        }
    }
}

/// `out[i]` = 1 with probability `p[i]`, else 0. Two draws of 24 bits from every word of the generator.
pub(super) fn sample_binary(p: &[f32], rng: &mut Rng, out: &mut [f32]) {
    const WORDS: usize = 32;
    let mut bits = [0u32; 2 * WORDS];
    for (p, out) in p.chunks(2 * WORDS).zip(out.chunks_mut(2 * WORDS)) {
        for pair in bits[..p.len().next_multiple_of(2)].chunks_exact_mut(2) {
            let word = rng.next_u64();
            (pair[0], pair[1]) = ((word >> 8) as u32 & 0xff_ffff, (word >> 40) as u32);
        }
        for ((out, &p), &bits) in out.iter_mut().zip(p).zip(&bits) {
            *out = if (bits as i32 as f32) < p * 16_777_216.0 { 1.0 } else { 0.0 };
        }
    }
}

/// Replaces means by draws: of bits, or of normal numbers of variance 1.
pub(super) fn sample_visible(visible: Visible, v: &mut [f32], rng: &mut Rng) {
    match visible {
        Visible::Bernoulli => {
            let mut p = [0.0; 64];
            for v in v.chunks_mut(p.len()) {
                p[..v.len()].copy_from_slice(v);
                sample_binary(&p[..v.len()], rng, v);
            }
        }
        Visible::Gaussian => v.iter_mut().for_each(|v| {
            let noise: f32 = StandardNormal.sample(rng);
            *v += noise;
        }),
    }
}

/// `sums` += the sum of the rows of `x`.
pub fn add_rows(x: &[f32], sums: &mut [f32]) {
    for row in x.chunks_exact(sums.len()) {
        foveate_kernels::add_scaled(1.0, row, sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;

    #[test]
    fn draws_have_their_probabilities() {
        let p = [0.0, 0.01, 0.3, 0.5, 0.9, 1.0, 0.5];
        let (mut sums, mut out, n) = ([0.0f32; 7], [0.0f32; 7], 20_000);
        let mut both = 0.0;
        let mut rng = Streams::new(5, 0).rng(0);
        for _ in 0..n {
            sample_binary(&p, &mut rng, &mut out);
            add_rows(&out, &mut sums);
            both += out[2] * out[3];
        }
        // 20,000 draws, seed 5; 4.5 sd: a false alarm in 10⁴ runs of another seed.
        for (s, p) in sums.into_iter().zip(p).chain([(both, 0.15)]) {
            let sd = (f64::from(n) * f64::from(p * (1.0 - p))).sqrt();
            assert!((f64::from(s) - f64::from(p) * f64::from(n)).abs() <= 4.5 * sd, "{s} of {n} at {p}");
        }
        assert!(sums[0] == 0.0 && sums[5] == n as f32, "certainties are certain");
    }
}
