//! CLEAR MOT (Bernardin and Stiefelhagen, EURASIP Journal on Image and Video Processing 2008): misses, false
//! positives and identity switches.

use serde::Serialize;

use super::frame_table::FrameTable;
use super::{HALF, ratio};
use foveate_core::assignment;

/// Counts of one sequence or of several, and the derived scores.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Clear {
    /// 1 − (misses + false positives + switches) / true boxes, at most 1; 0 without a true box.
    pub mota: f64,
    /// Mean overlap of the matches, 0.5 to 1 (motmetrics reports 1 − this); 0 without one.
    pub motp: f64,
    /// Number of true boxes that were found.
    pub matches: usize,
    /// Number of true boxes that were not found.
    pub misses: usize,
    /// False positives.
    pub false_positives: usize,
    /// Number of times that a target is found under another id than before.
    pub switches: usize,
    /// Number of times that a target is found again after a gap.
    pub fragmentations: usize,
    /// Targets found in more than 80 % of their frames.
    pub mostly_tracked: usize,
    /// Targets found in 20 to 80 % of them.
    pub partly_tracked: usize,
    /// Targets found in fewer than 20 % of their frames.
    pub mostly_lost: usize,
    #[serde(skip)]
    overlap: f64,
}

impl Clear {
    /// Pools several sequences by adding their counts.
    pub fn pooled<'a>(all: impl Iterator<Item = &'a Self>) -> Self {
        let mut sum = Self::default();
        for one in all {
            sum.matches += one.matches;
            sum.misses += one.misses;
            sum.false_positives += one.false_positives;
            sum.switches += one.switches;
            sum.fragmentations += one.fragmentations;
            sum.mostly_tracked += one.mostly_tracked;
            sum.partly_tracked += one.partly_tracked;
            sum.mostly_lost += one.mostly_lost;
            sum.overlap += one.overlap;
        }
        sum.rated()
    }

    fn rated(mut self) -> Self {
        let truth = self.matches + self.misses;
        let wrong = self.false_positives + self.switches;
        self.mota = if truth > 0 { (self.matches as f64 - wrong as f64) / truth as f64 } else { 0.0 };
        self.motp = ratio(self.overlap, self.matches as f64);
        self
    }
}

/// Counts frame by frame.
pub(super) struct Counter {
    clear: Clear,
    targets: Vec<Target>,
    /// Frames with boxes in both truth and results.
    shared: usize,
}

#[derive(Clone, Default)]
struct Target {
    frames: usize,
    found: usize,
    stretches: usize,
    /// The track it was last matched with, and when (in shared frames).
    last: Option<(usize, usize)>,
}

impl Counter {
    pub(super) fn new(targets: usize) -> Self {
        Self { clear: Clear::default(), targets: vec![Target::default(); targets], shared: 0 }
    }

    /// Adds one frame. Pairs of the previous shared frame stay matched while they overlap by half; the rest is matched for the largest sum
    /// of overlaps.
    pub(super) fn frame(&mut self, frame_table: &FrameTable, overlaps: &[f64]) {
        let (rows, columns) = (frame_table.truth.len(), frame_table.found.len());
        frame_table.truth.iter().for_each(|&(id, _)| self.targets[id].frames += 1);
        let mut matches = 0;
        if rows > 0 && columns > 0 {
            self.shared += 1;
            let scores = self.scores(frame_table, overlaps);
            for (i, j) in assignment::best(&scores, rows, columns) {
                if scores[i * columns + j] > f64::EPSILON {
                    matches += 1;
                    self.clear.overlap += overlaps[i * columns + j];
                    self.matched(frame_table.truth[i].0, frame_table.found[j].0);
                }
            }
        }
        self.clear.matches += matches;
        self.clear.misses += rows - matches;
        self.clear.false_positives += columns - matches;
    }

    /// Returns the overlap, 0 below half, plus 1000 for a pair of the previous shared frame.
    fn scores(&self, frame_table: &FrameTable, overlaps: &[f64]) -> Vec<f64> {
        let pairs = frame_table
            .truth
            .iter()
            .flat_map(|&(target, _)| frame_table.found.iter().map(move |&(id, _)| (target, id)));
        let score = |((target, id), &overlap): ((usize, usize), &f64)| {
            let stays = self.targets[target].last == Some((id, self.shared - 1));
            let bonus = if stays { 1000.0 } else { 0.0 };
            if overlap < HALF - f64::EPSILON { 0.0 } else { bonus + overlap }
        };
        pairs.zip(overlaps).map(score).collect()
    }

    fn matched(&mut self, target: usize, id: usize) {
        let target = &mut self.targets[target];
        target.found += 1;
        self.clear.switches += usize::from(target.last.is_some_and(|(last, _)| last != id));
        target.stretches += usize::from(target.last.is_none_or(|(_, when)| when + 1 != self.shared));
        target.last = Some((id, self.shared));
    }

    pub(super) fn finish(mut self) -> Clear {
        for target in &self.targets {
            let share = ratio(target.found as f64, target.frames as f64);
            *match share {
                s if s > 0.8 => &mut self.clear.mostly_tracked,
                s if s >= 0.2 => &mut self.clear.partly_tracked,
                _ => &mut self.clear.mostly_lost,
            } += 1;
            self.clear.fragmentations += target.stretches.saturating_sub(1);
        }
        self.clear.rated()
    }
}
