//! HOTA (Luiten et al., International Journal of Computer Vision 2021): detection, association and localisation in one score, over 19
//! overlap thresholds α = 0.05, 0.10, ..., 0.95.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;

use super::frame_table::{FrameTable, FrameTables};
use super::ratio;
use foveate_core::assignment;

/// Number of thresholds.
pub const ALPHAS: usize = 19;

/// The scores at one threshold; all from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AtAlpha {
    /// The overlap that a match needs.
    pub alpha: f64,
    /// √(DetA · AssA).
    pub hota: f64,
    /// Matches over matches, misses and false positives.
    pub det_a: f64,
    /// Mean over matches of: frames that both tracks share, divided by frames that either has.
    pub ass_a: f64,
    /// Mean over matches of: shared frames divided by the target's frames.
    pub ass_re: f64,
    /// Mean over matches of: shared frames divided by the track's frames.
    pub ass_pr: f64,
    /// Mean overlap of the matches; 1 without one.
    pub loc_a: f64,
    /// Number of matches.
    pub matches: usize,
}

/// Means over the thresholds, and their terms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hota {
    /// Mean of √(DetA · AssA): not the root of the means' product.
    pub hota: f64,
    /// Detection accuracy.
    pub det_a: f64,
    /// Detection recall: matches over true boxes.
    pub det_re: f64,
    /// Detection precision: matches over boxes found.
    pub det_pr: f64,
    /// Association accuracy.
    pub ass_a: f64,
    /// Association recall.
    pub ass_re: f64,
    /// Association precision.
    pub ass_pr: f64,
    /// Localisation accuracy.
    pub loc_a: f64,
    /// One for each threshold.
    pub alphas: [AtAlpha; ALPHAS],
    #[serde(skip)]
    boxes: (usize, usize),
}

impl Hota {
    /// Pools several sequences: all matches have equal weight, at each threshold.
    pub fn pooled<'a>(all: impl Iterator<Item = &'a Self>) -> Self {
        let all: Vec<_> = all.collect();
        let boxes = all.iter().fold((0, 0), |(a, b), one| (a + one.boxes.0, b + one.boxes.1));
        let at = |k: usize| {
            let sum = |value: &dyn Fn(&AtAlpha) -> f64| {
                all.iter().map(|one| value(&one.alphas[k]) * one.alphas[k].matches as f64).sum::<f64>()
            };
            let (ass_a, ass_re, ass_pr) = (sum(&|a| a.ass_a), sum(&|a| a.ass_re), sum(&|a| a.ass_pr));
            let matches = all.iter().map(|one| one.alphas[k].matches).sum();
            at_alpha(k, matches, [ass_a, ass_re, ass_pr, sum(&|a| a.loc_a)], boxes)
        };
        Self::of(std::array::from_fn(at), boxes)
    }

    fn of(alphas: [AtAlpha; ALPHAS], boxes: (usize, usize)) -> Self {
        let mean = |value: &dyn Fn(&AtAlpha) -> f64| alphas.iter().map(value).sum::<f64>() / ALPHAS as f64;
        Self {
            hota: mean(&|a| a.hota),
            det_a: mean(&|a| a.det_a),
            det_re: mean(&|a| ratio(a.matches as f64, boxes.0 as f64)),
            det_pr: mean(&|a| ratio(a.matches as f64, boxes.1 as f64)),
            ass_a: mean(&|a| a.ass_a),
            ass_re: mean(&|a| a.ass_re),
            ass_pr: mean(&|a| a.ass_pr),
            loc_a: mean(&|a| a.loc_a),
            alphas,
            boxes,
        }
    }
}

/// Computes the scores from sums over matches of the three association scores and of overlaps.
fn at_alpha(k: usize, matches: usize, sums: [f64; 4], boxes: (usize, usize)) -> AtAlpha {
    let [ass_a, ass_re, ass_pr, overlap] = sums.map(|sum| ratio(sum, matches as f64));
    let det_a = ratio(matches as f64, (boxes.0 + boxes.1 - matches) as f64);
    let loc_a = if matches > 0 { overlap } else { 1.0 };
    AtAlpha { alpha: alpha(k), hota: (det_a * ass_a).sqrt(), det_a, ass_a, ass_re, ass_pr, loc_a, matches }
}

fn alpha(k: usize) -> f64 {
    0.05 + 0.05 * k as f64
}

/// The global alignment of a target and a track over the whole sequence, before any matching: the sum of their overlaps, each divided by
/// all overlaps of the two boxes in that frame.
#[derive(Default)]
pub(super) struct Counter {
    together: HashMap<(usize, usize), f64>,
}

impl Counter {
    pub(super) fn frame(&mut self, frame_table: &FrameTable, overlaps: &[f64]) {
        let columns = frame_table.found.len();
        let mut of_found = vec![0.0; columns];
        for row in overlaps.chunks_exact(columns.max(1)) {
            of_found.iter_mut().zip(row).for_each(|(sum, overlap)| *sum += overlap);
        }
        for (&(target, _), row) in frame_table.truth.iter().zip(overlaps.chunks_exact(columns.max(1))) {
            let of_target: f64 = row.iter().sum();
            for ((&(id, _), &overlap), found) in frame_table.found.iter().zip(row).zip(&of_found) {
                let either = found + of_target - overlap;
                if overlap > 0.0 && either > f64::EPSILON {
                    *self.together.entry((target, id)).or_default() += overlap / either;
                }
            }
        }
    }

    /// Matches every frame for the largest sum of (global alignment) × overlap, and counts.
    pub(super) fn finish(self, all: &FrameTables) -> Hota {
        let (mut targets, mut tracks) = (vec![0.0; all.ids.0], vec![0.0; all.ids.1]);
        for frame_table in &all.frames {
            frame_table.truth.iter().for_each(|&(id, _)| targets[id] += 1.0);
            frame_table.found.iter().for_each(|&(id, _)| tracks[id] += 1.0);
        }
        let aligned = |target: usize, id: usize| match self.together.get(&(target, id)) {
            Some(sum) => sum / (targets[target] + tracks[id] - sum),
            None => 0.0,
        };
        let mut pairs: BTreeMap<(usize, usize), Vec<f64>> = BTreeMap::new();
        for frame_table in &all.frames {
            let (overlaps, columns) = (frame_table.overlaps(), frame_table.found.len());
            let ids =
                frame_table.truth.iter().flat_map(|&(t, _)| frame_table.found.iter().map(move |&(id, _)| (t, id)));
            let score = |(t, id), overlap| if overlap > 0.0 { aligned(t, id) * overlap } else { 0.0 };
            let scores: Vec<f64> = ids.zip(&overlaps).map(|(ids, overlap)| score(ids, *overlap)).collect();
            for (i, j) in assignment::best(&scores, frame_table.truth.len(), columns) {
                pairs
                    .entry((frame_table.truth[i].0, frame_table.found[j].0))
                    .or_default()
                    .push(overlaps[i * columns + j]);
            }
        }
        let at = |k: usize| {
            let (mut matches, mut sums) = (0, [0.0; 4]);
            for (&(target, id), overlaps) in &pairs {
                let enough = |o: &&f64| **o >= alpha(k) - f64::EPSILON;
                let n = overlaps.iter().filter(enough).count();
                let (shared, target, track) = (n as f64, targets[target], tracks[id]);
                matches += n;
                sums[0] += shared * ratio(shared, target + track - shared);
                sums[1] += shared * ratio(shared, target);
                sums[2] += shared * ratio(shared, track);
                sums[3] += overlaps.iter().filter(enough).sum::<f64>();
            }
            at_alpha(k, matches, sums, all.boxes)
        };
        Hota::of(std::array::from_fn(at), all.boxes)
    }
}
