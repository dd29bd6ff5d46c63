//! Identity scores (Ristani et al., Performance measures and a data set for multi-target, multi-camera tracking, 2016): each target is
//! assigned one track for the whole sequence.

use std::collections::HashMap;

use serde::Serialize;

use super::frame_table::FrameTable;
use super::{HALF, ratio};
use foveate_core::assignment;

/// Counts of one sequence or of several, and the derived scores.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Identity {
    /// Harmonic mean of the next two, 0 to 1.
    pub idf1: f64,
    /// Fraction of the result boxes on the target assigned to their track.
    pub idp: f64,
    /// Fraction of the true boxes found by the track assigned to the target.
    pub idr: f64,
    /// Boxes found by the right track.
    pub idtp: usize,
    /// Other boxes of the results.
    pub idfp: usize,
    /// Other boxes of the truth.
    pub idfn: usize,
}

impl Identity {
    /// Pools several sequences by adding their counts.
    pub fn pooled<'a>(all: impl Iterator<Item = &'a Self>) -> Self {
        let sum = |a: [usize; 3], b: &Self| [a[0] + b.idtp, a[1] + b.idfp, a[2] + b.idfn];
        let [tp, fp, fneg] = all.fold([0; 3], sum);
        Self::of(tp, tp + fp, tp + fneg)
    }

    fn of(tp: usize, found: usize, truth: usize) -> Self {
        let (t, f) = (tp as f64, found as f64);
        let (idp, idr) = (ratio(t, f), ratio(t, truth as f64));
        let idf1 = ratio(t, 0.5 * (f + truth as f64));
        Self { idf1, idp, idr, idtp: tp, idfp: found - tp, idfn: truth - tp }
    }
}

/// Counts the frames in which a target and a track overlap by half.
#[derive(Default)]
pub(super) struct Counter {
    together: HashMap<(usize, usize), usize>,
}

impl Counter {
    pub(super) fn frame(&mut self, frame_table: &FrameTable, overlaps: &[f64]) {
        let pairs = frame_table
            .truth
            .iter()
            .flat_map(|(target, _)| frame_table.found.iter().map(move |(id, _)| (*target, *id)));
        for (pair, _) in pairs.zip(overlaps).filter(|(_, overlap)| **overlap >= HALF) {
            *self.together.entry(pair).or_default() += 1;
        }
    }

    /// Assigns tracks to targets for the largest number of right boxes, which also maximises IDF1.
    pub(super) fn finish(self, ids: (usize, usize), boxes: (usize, usize)) -> Identity {
        let mut scores = vec![0.0; ids.0 * ids.1];
        for (&(target, id), &frames) in &self.together {
            scores[target * ids.1 + id] = frames as f64;
        }
        let right = assignment::best(&scores, ids.0, ids.1);
        let tp = right.iter().map(|&(target, id)| scores[target * ids.1 + id] as usize).sum();
        Identity::of(tp, boxes.1, boxes.0)
    }
}
