//! Sparse coding: codes by coordinate descent, then filters by the same.
//!
//! Given the filters, the codes of a patch are found one after the other, each the best there is while the others stand
//! (Li & Osher 2009), until none moves. Given the codes, each filter in turn becomes the best of length 1 at most while the others
//! stand (Mairal, Bach, Ponce & Sapiro 2009). A filter that no patch uses becomes some patch.

use super::{Sums, TOGETHER, place};
use crate::Stop;
use crate::rbm::product::{rows_times, rows_times_transposed};
use foveate_base::rows::Rows;

/// The most turns of all codes of a patch, while learning and after; fewer where none moves by more than [`STILL`].
const TURNS: usize = 100;
pub(super) const LAST_TURNS: usize = 10_000;
const STILL: f32 = 1e-4;

/// Σ x sᵀ (n_x × K), Σ s sᵀ (K × K), and Σ ½ ‖x − D s‖² + penalty Σ |s|. None if it was stopped.
pub(super) fn sums(white: Rows<'_>, filters: &[f32], penalty: f32, stop: Stop<'_>) -> Option<Sums> {
    let n_x = white.width();
    let k = filters.len() / n_x;
    let gram = gram(filters, k);
    let (mut with_x, mut among, mut cost) = (vec![0.0; n_x * k], vec![0.0; k * k], 0.0);
    let (mut codes, mut drawn, mut used) = (vec![0.0; TOGETHER * k], vec![0.0; TOGETHER * n_x], vec![]);
    for rows in white.data().chunks(TOGETHER * n_x) {
        let n = rows.len() / n_x;
        let (codes, drawn) = (&mut codes[..n * k], &mut drawn[..n * n_x]);
        self::codes(Rows::new(rows, n_x), (filters, &gram), penalty, TURNS, codes, stop)?;
        rows_times_transposed(Rows::new(codes, k), filters, drawn);
        for ((x, s), drawn) in rows.chunks_exact(n_x).zip(codes.chunks_exact(k)).zip(drawn.chunks_exact(n_x)) {
            if stop() {
                return None;
            }
            let error: f64 = x.iter().zip(drawn).map(|(x, d)| f64::from(x - d).powi(2)).sum();
            used.clear();
            used.extend(s.iter().enumerate().filter(|(_, s)| **s != 0.0).map(|(j, s)| (j, f64::from(*s))));
            cost += 0.5 * error + f64::from(penalty) * used.iter().map(|(_, s)| s.abs()).sum::<f64>();
            for &(j, s) in &used {
                x.iter().enumerate().for_each(|(i, x)| with_x[i * k + j] += s * f64::from(*x));
                used.iter().for_each(|(l, other)| among[j * k + l] += s * other);
            }
        }
    }
    Some(Sums { cost, parts: [with_x, among] })
}

/// The codes of rows (m × n_x), m × K, by filters and their products with each other. None if it was stopped.
pub(super) fn codes(
    white: Rows<'_>,
    (filters, gram): (&[f32], &[f32]),
    penalty: f32,
    turns: usize,
    codes: &mut [f32],
    stop: Stop<'_>,
) -> Option<()> {
    let (k, mut scores) = (codes.len() / white.len(), vec![0.0; codes.len()]);
    rows_times(white, filters, &mut scores);
    for (left, s) in scores.chunks_exact_mut(k).zip(codes.chunks_exact_mut(k)) {
        if stop() {
            return None;
        }
        code(gram, left, penalty, turns, s);
    }
    Some(())
}

/// Codes of a patch, from its products with the filters (`left`, which become those of what the codes leave of it).
fn code(gram: &[f32], left: &mut [f32], penalty: f32, turns: usize, s: &mut [f32]) {
    let k = s.len();
    s.fill(0.0);
    for _ in 0..turns {
        let mut moved = 0.0f32;
        for j in 0..k {
            let own = gram[j * k + j];
            if own == 0.0 {
                continue;
            }
            let alone = left[j] + own * s[j];
            let new = (alone.abs() - penalty).max(0.0).copysign(alone) / own;
            let change = new - s[j];
            if change != 0.0 {
                left.iter_mut().zip(&gram[j * k..][..k]).for_each(|(left, g)| *left -= change * g);
                s[j] = new;
                moved = moved.max(change.abs());
            }
        }
        if moved < STILL {
            break;
        }
    }
}

/// DᵀD, K × K.
pub(super) fn gram(filters: &[f32], k: usize) -> Vec<f32> {
    let mut sums = vec![0.0f64; k * k];
    for row in filters.chunks_exact(k) {
        for (j, a) in row.iter().enumerate() {
            sums[j * k..][..k].iter_mut().zip(row).for_each(|(sum, b)| *sum += f64::from(*a) * f64::from(*b));
        }
    }
    sums.into_iter().map(|sum| sum as f32).collect()
}

pub(super) fn turn(
    sums: &Sums,
    filters: &mut [f32],
    n_x: usize,
    mut some: impl FnMut() -> Vec<f64>,
    stop: Stop<'_>,
) -> Option<()> {
    let k = filters.len() / n_x;
    let [with_x, among] = &sums.parts;
    let mut d: Vec<f64> = filters.iter().map(|x| f64::from(*x)).collect();
    let mut turned = vec![0.0; n_x];
    for j in 0..k {
        if stop() {
            return None;
        }
        let own = among[j * k + j];
        if own < 1e-9 {
            place(filters, j, &some());
            (0..n_x).for_each(|i| d[i * k + j] = f64::from(filters[i * k + j]));
            continue;
        }
        for (i, turned) in turned.iter_mut().enumerate() {
            let all: f64 = d[i * k..][..k].iter().zip(&among[j * k..][..k]).map(|(d, a)| d * a).sum();
            *turned = d[i * k + j] + (with_x[i * k + j] - all) / own;
        }
        let length = turned.iter().map(|x| x * x).sum::<f64>().sqrt().max(1.0);
        (0..n_x).for_each(|i| d[i * k + j] = turned[i] / length);
    }
    filters.iter_mut().zip(&d).for_each(|(to, d)| *to = *d as f32);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the best codes, each filter's product with what is left is the penalty times the code's sign, or within the penalty
    /// where the code is 0 (the conditions of Karush, Kuhn and Tucker).
    #[test]
    fn codes_are_the_best_there_are() {
        let (n_x, k, penalty) = (6, 15, 0.3);
        let mut filters: Vec<f32> = (0..n_x * k).map(|i| ((i * i % 37) as f32 * 0.7).sin()).collect();
        for j in 0..k {
            let column: Vec<f64> = (0..n_x).map(|i| f64::from(filters[i * k + j])).collect();
            place(&mut filters, j, &column);
        }
        let gram = gram(&filters, k);
        for patch in 0..20 {
            let x: Vec<f32> = (0..n_x).map(|i| 2.0 * ((i + 7 * patch) as f32).cos()).collect();
            let product = |v: &[f32], j: usize| (0..n_x).map(|i| v[i] * filters[i * k + j]).sum::<f32>();
            let mut left: Vec<f32> = (0..k).map(|j| product(&x, j)).collect();
            let mut s = vec![0.0; k];
            code(&gram, &mut left, penalty, TURNS, &mut s);
            let rest: Vec<f32> =
                (0..n_x).map(|i| x[i] - (0..k).map(|j| filters[i * k + j] * s[j]).sum::<f32>()).collect();
            for (j, s) in s.iter().enumerate() {
                let c = product(&rest, j);
                let off = if *s == 0.0 { (c.abs() - penalty).max(0.0) } else { (c - penalty * s.signum()).abs() };
                assert!(off < 2e-3, "patch {patch}, code {j} is {s}: {c}");
            }
            assert!(s.iter().filter(|s| **s != 0.0).count() < k);
        }
    }
}
