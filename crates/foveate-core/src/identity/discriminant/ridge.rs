//! Ridge regression by its sums: the samples of a frame, sums that fade, and steps of conjugate gradients.

use std::sync::Arc;

use foveate_kernels as kernels;
use serde::{Deserialize, Serialize};

use super::settings::Settings;
use crate::geometry::State;
use crate::identity::numbers::floats;

/// Steps of conjugate gradients on the first frame, and on each other.
pub(super) const STEPS: (usize, usize) = (30, 4);

/// Σ h hᵀ (its lower triangle) and Σ label · h.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Sums {
    #[serde(with = "floats")]
    pub gram: Vec<f32>,
    #[serde(with = "floats")]
    pub cross: Vec<f32>,
}

/// The training samples of one frame.
#[derive(Clone, Debug, Default)]
pub(in crate::identity) struct Learning {
    /// Where to look to learn.
    pub places: Vec<State>,
    /// The features there, each followed by a 1.
    pub rows: Vec<f32>,
    pub labels: Vec<f32>,
    /// Rows of the features of all gazes; 0 for those that a gaze does not read.
    pub whole: Vec<f32>,
    system: Sums,
    work: [Vec<f32>; 2],
    /// Scratch buffer for the triangles of a discriminant that keeps none.
    pub triangles: [Vec<f32>; 2],
}

impl Sums {
    /// Fades the sums, and adds a share of rows of `n` values with these labels.
    pub(super) fn learn(&mut self, (rows, labels): (&[f32], &[f32]), n: usize, (keep, share): (f32, f32)) {
        if keep == 0.0 {
            self.gram.fill(0.0);
        }
        kernels::add_outer(rows, n, keep, share, &mut self.gram);
        self.cross.iter_mut().for_each(|b| *b *= keep);
        for (row, label) in rows.chunks_exact(n).zip(labels) {
            self.cross.iter_mut().zip(row).for_each(|(b, h)| *b += share * *label * h);
        }
    }
}

/// The fit: its settings, the lengths of the parts of the features, and their covariance.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    pub settings: Settings,
    pub parts: Vec<usize>,
    /// The covariance of features that is added to the sums; empty if unknown.
    pub variation: Option<Arc<[f32]>>,
}

impl Regression {
    /// Conjugate gradients from `weights` on: so many steps towards the ridge regression of both sums.
    pub(super) fn solve(
        &self,
        begun: &Sums,
        recent: &Sums,
        weights: &mut [f32],
        Learning { system, work: [step, image], .. }: &mut Learning,
        steps: usize,
    ) {
        let (settings, n) = (&self.settings, weights.len());
        system.gram.resize(recent.gram.len(), 0.0);
        system.cross.resize(n, 0.0);
        step.resize(n, 0.0);
        image.resize(n, 0.0);
        let old = settings.first_frame_weight as f32;
        let mix = |out: &mut [f32], a: &[f32], b: &[f32]| {
            out.iter_mut().zip(a).zip(b).for_each(|((out, a), b)| *out = old * a + (1.0 - old) * b);
        };
        mix(&mut system.gram, &begun.gram, &recent.gram);
        mix(&mut system.cross, &begun.cross, &recent.cross);
        self.leave_out(&mut system.gram);
        for i in 0..n {
            system.gram[i * (i + 3) / 2] += settings.ridge as f32;
        }
        if let Some(variation) = &self.variation {
            system.gram.iter_mut().zip(&**variation).for_each(|(sum, more)| *sum += more);
        }
        // `cross` becomes the rest of the right-hand side.
        let rest = &mut system.cross;
        kernels::symmetric_times(&system.gram, weights, image);
        rest.iter_mut().zip(&*image).for_each(|(rest, image)| *rest -= image);
        step.copy_from_slice(rest);
        let mut left = kernels::dot(rest, rest);
        for _ in 0..steps {
            if left < 1e-12 {
                break;
            }
            kernels::symmetric_times(&system.gram, step, image);
            let length = left / kernels::dot(step, image);
            weights.iter_mut().zip(&*step).for_each(|(w, step)| *w += length * step);
            rest.iter_mut().zip(&*image).for_each(|(rest, image)| *rest -= length * image);
            let before = std::mem::replace(&mut left, kernels::dot(rest, rest));
            step.iter_mut().zip(&*rest).for_each(|(step, rest)| *step = rest + left / before * *step);
        }
        // The sums of a damaged state give such weights; zeros separate nothing.
        if !kernels::dot(weights, weights).is_finite() {
            weights.fill(0.0);
        }
    }

    /// Divides sums of two features of one part by 1 − dropout: Σ h hᵀ in expectation. One part alone cannot be left out.
    fn leave_out(&self, gram: &mut [f32]) {
        let more = 1.0 / (1.0 - self.settings.dropout as f32);
        if more == 1.0 || self.parts.len() < 2 {
            return;
        }
        let mut start = 0;
        for part in &self.parts {
            for i in start..start + part {
                let row = i * (i + 1) / 2;
                gram[row + start..=row + i].iter_mut().for_each(|sum| *sum *= more);
            }
            start += part;
        }
    }
}

/// Σ r rᵀ of rows of `n` values.
pub(super) fn outer(rows: &[f32], n: usize, gram: &mut Vec<f32>) {
    gram.clear();
    gram.resize(n * (n + 1) / 2, 0.0);
    kernels::add_outer(rows, n, 0.0, 1.0, gram);
}
