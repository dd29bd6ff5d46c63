//! ICA of two layers with given subspaces: filters W orthonormal, the cost Σ √(ε + u), u = Σ (wⱼ·x)² over a subspace.
//!
//! √ lies below its tangent at today's u, so the cost lies below Σ wⱼᵀ C wⱼ + a constant, with C = ½ mean of x xᵀ / √(ε + u) for each subspace;
//! that lies below −2 Σ wⱼᵀ (λ − C) wⱼ' + a constant, where wⱼ' is today's filter and λ the largest eigenvalue of C. The orthonormal
//! filters that make this smallest are the polar factor of the columns (λ − C) wⱼ'. No step can raise the cost.

use super::Sums;
use crate::Stop;
use faer::{MatRef, Side};
use foveate_base::rows::Rows;

/// ε, where a whitened number has variance 1.
const SMOOTH: f64 = 1e-3;

/// Σ x xᵀ / √(ε + u) of each subspace (n_x × n_x), and Σ √(ε + u). None if it was stopped.
pub(super) fn sums(white: Rows<'_>, filters: &[f32], size: usize, stop: Stop<'_>) -> Option<Sums> {
    let n_x = white.width();
    let k = filters.len() / n_x;
    let (mut around, mut cost) = (vec![0.0; k / size * n_x * n_x], 0.0);
    let (mut scores, mut scaled) = (vec![0.0f64; k], vec![0.0f64; n_x]);
    for x in white.iter() {
        if stop() {
            return None;
        }
        scores.fill(0.0);
        for (x, row) in x.iter().zip(filters.chunks_exact(k)) {
            scores.iter_mut().zip(row).for_each(|(s, w)| *s += f64::from(*x) * f64::from(*w));
        }
        for (scores, around) in scores.chunks_exact(size).zip(around.chunks_exact_mut(n_x * n_x)) {
            let root = (SMOOTH + scores.iter().map(|s| s * s).sum::<f64>()).sqrt();
            cost += root;
            scaled.iter_mut().zip(x).for_each(|(scaled, x)| *scaled = f64::from(*x) / root);
            // The upper triangle: the matrix is symmetric.
            for (i, (x, row)) in x.iter().zip(around.chunks_exact_mut(n_x)).enumerate() {
                let x = f64::from(*x);
                row[i..].iter_mut().zip(&scaled[i..]).for_each(|(sum, scaled)| *sum += x * scaled);
            }
        }
    }
    Some(Sums { cost, parts: [around, vec![]] })
}

pub(super) fn turn(sums: &Sums, filters: &mut [f32], n_x: usize, size: usize, stop: Stop<'_>) -> Option<()> {
    let k = filters.len() / n_x;
    let mut toward = vec![0.0; n_x * k];
    for (subspace, upper) in sums.parts[0].chunks_exact(n_x * n_x).enumerate() {
        if stop() {
            return None;
        }
        let c = |i: usize, j: usize| upper[i.min(j) * n_x + i.max(j)];
        let full: Vec<f64> = (0..n_x * n_x).map(|at| c(at / n_x, at % n_x)).collect();
        let Ok(values) = MatRef::from_row_major_slice(&full, n_x, n_x).self_adjoint_eigenvalues(Side::Lower) else {
            return Some(());
        };
        let most = values.last().copied().unwrap_or(0.0);
        for j in subspace * size..(subspace + 1) * size {
            let w: Vec<f64> = (0..n_x).map(|i| f64::from(filters[i * k + j])).collect();
            for (i, row) in full.chunks_exact(n_x).enumerate() {
                toward[i * k + j] = most * w[i] - row.iter().zip(&w).map(|(c, w)| c * w).sum::<f64>();
            }
        }
    }
    orthonormal(&toward, n_x, filters);
    Some(())
}

/// Filters ← the polar factor of the columns of `toward` (n_x × K, K at most n_x): the nearest orthonormal ones. Left as they are where
/// the columns have none.
pub(super) fn orthonormal(toward: &[f64], n_x: usize, filters: &mut [f32]) {
    let k = filters.len() / n_x;
    let Ok(svd) = MatRef::from_row_major_slice(toward, n_x, k).thin_svd() else { return };
    let polar = svd.U() * svd.V().transpose();
    for (at, to) in filters.iter_mut().enumerate() {
        *to = polar[(at / k, at % k)] as f32;
    }
}
