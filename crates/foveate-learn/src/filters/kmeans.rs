//! k-means by Lloyd's two steps: every patch takes its best filter, and every filter turns to the patches that took it.
//!
//! Given the filters, s and the choice of filter are the best there are; given those, the best filter of length 1 is Σ s x
//! brought to length 1. To the sum the filter itself is added (Coates & Ng 2012), so that no filter jumps; neither step
//! can raise the cost. A filter that no patch takes becomes some patch, which cannot raise it either.

use super::{Sums, TOGETHER, place};
use crate::Stop;
use crate::rbm::product::rows_times;
use foveate_base::rows::Rows;

/// Σ s x of each filter (n_x × K), how many patches took it, and Σ ‖x − s d‖². None if it was stopped.
pub(super) fn sums(white: Rows<'_>, filters: &[f32], stop: Stop<'_>) -> Option<Sums> {
    let n_x = white.width();
    let k = filters.len() / n_x;
    let (mut sums, mut counts, mut left) = (vec![0.0; n_x * k], vec![0.0; k], 0.0);
    let mut scores = vec![0.0; TOGETHER * k];
    for rows in white.data().chunks(TOGETHER * n_x) {
        if stop() {
            return None;
        }
        let scores = &mut scores[..rows.len() / n_x * k];
        rows_times(Rows::new(rows, n_x), filters, scores);
        for (x, scores) in rows.chunks_exact(n_x).zip(scores.chunks_exact(k)) {
            let (mut best, mut most) = (0, f32::NEG_INFINITY);
            for (j, &score) in scores.iter().enumerate() {
                if score > most {
                    (best, most) = (j, score);
                }
            }
            let s = f64::from(most.max(0.0));
            counts[best] += f64::from(u8::from(s > 0.0));
            for (i, &x) in x.iter().enumerate() {
                sums[i * k + best] += s * f64::from(x);
                left += f64::from(x).powi(2);
            }
            left -= s * s;
        }
    }
    Some(Sums { cost: left, parts: [sums, counts] })
}

pub(super) fn turn(sums: &Sums, filters: &mut [f32], n_x: usize, mut some: impl FnMut() -> Vec<f64>) {
    let k = filters.len() / n_x;
    let [toward, counts] = &sums.parts;
    for (j, count) in counts.iter().enumerate() {
        let turned: Vec<f64> = if *count == 0.0 {
            some()
        } else {
            (0..n_x).map(|i| toward[i * k + j] + f64::from(filters[i * k + j])).collect()
        };
        place(filters, j, &turned);
    }
}
