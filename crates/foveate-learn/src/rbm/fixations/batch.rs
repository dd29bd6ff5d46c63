//! Operations on many fixations at once: gates, sums over a sequence, classes. Rows depend on themselves alone.

use super::super::product::{block_of, rows_times, rows_times_transposed, set_outer};
use super::Code;
use crate::softmax::normalize;
use foveate_base::rows::Rows;
use foveate_kernels::{add_product, add_scaled, bias_logistic, softplus_sum};
use rayon::prelude::*;

/// `out` = `rows` · `weights`, by all threads.
pub(super) fn times(rows: Rows<'_>, weights: &[f32], out: &mut [f32]) {
    let (k, n, block) = (rows.width(), weights.len() / rows.width(), block_of(rows.len()));
    (out.par_chunks_mut(block * n), rows.data().par_chunks(block * k))
        .into_par_iter()
        .for_each(|(out, rows)| rows_times(Rows::new(rows, k), weights, out));
}

/// `out` = `rows` · `weights`ᵀ, by all threads.
pub(super) fn times_transposed(rows: Rows<'_>, weights: &[f32], out: &mut [f32]) {
    let (n, k, block) = (rows.width(), weights.len() / rows.width(), block_of(rows.len()));
    (out.par_chunks_mut(block * k), rows.data().par_chunks(block * n))
        .into_par_iter()
        .for_each(|(out, rows)| rows_times_transposed(Rows::new(rows, n), weights, out));
}

/// `out` = `left`ᵀ · `right`, by all threads.
pub(super) fn outer(out: &mut [f32], left: Rows<'_>, right: Rows<'_>) {
    let block = block_of(left.width());
    (out.par_chunks_mut(block * right.width()).enumerate())
        .for_each(|(b, out)| set_outer(out, 1.0, left, b * block, right));
}

/// The gates of each fixation: V zₖ, one row of `gates` (places × D) or a mean of rows.
pub(super) fn gates_of(codes: &[Code], gates: &[f32], factors: usize, out: &mut [f32]) {
    for (code, out) in codes.iter().zip(out.chunks_exact_mut(factors)) {
        out.fill(0.0);
        for (place, share) in code.parts() {
            add(out, share, &gates[place * factors..][..factors]);
        }
    }
}

/// `out` += `factor` · `x`.
pub(super) fn add(out: &mut [f32], factor: f32, x: &[f32]) {
    add_scaled(factor, x, out);
}

/// `out` += `x` ∘ `y`.
pub(super) fn add_gated(out: &mut [f32], x: &[f32], y: &[f32]) {
    add_product(1.0, x, y, out);
}

/// The output of the factors: Σₖ (V zₖ) ∘ (Fᵀxₖ), one row of `out` a sequence of `window` rows of `z` and `a`; or one row a
/// beginning of it (k = 1, 2, ..), if `sequential`.
pub(super) fn gather(z: &[f32], a: &[f32], factors: usize, window: usize, sequential: bool, out: &mut [f32]) {
    let rows = if sequential { window } else { 1 };
    let sequences = z.chunks_exact(window * factors).zip(a.chunks_exact(window * factors));
    for ((z, a), out) in sequences.zip(out.chunks_exact_mut(rows * factors)) {
        out[..factors].fill(0.0);
        for (k, (z, a)) in z.chunks_exact(factors).zip(a.chunks_exact(factors)).enumerate() {
            if sequential && k > 0 {
                out.copy_within((k - 1) * factors..k * factors, k * factors);
            }
            let row = if sequential { k } else { 0 };
            add_gated(&mut out[row * factors..][..factors], z, a);
        }
    }
}

/// For one row x of excitations (n_h): `on`[l] ← p(h | x, y = l), n_c × n_h, and `log_p` ← log p(y | x) (exact: h is
/// summed out). Returns the logarithm of the normaliser of `log_p`.
pub(super) fn classify(x: &[f32], labels: &[f32], bias: &[f32], on: &mut [f32], log_p: &mut [f64]) -> f64 {
    let n_h = x.len();
    on.chunks_exact_mut(n_h).for_each(|on| on.copy_from_slice(x));
    bias_logistic(on, labels);
    for (l, q) in log_p.iter_mut().enumerate() {
        let of = l * n_h..(l + 1) * n_h;
        *q = f64::from(bias[l]) + softplus_sum(x, &labels[of.clone()], &on[of]);
    }
    normalize(log_p)
}
