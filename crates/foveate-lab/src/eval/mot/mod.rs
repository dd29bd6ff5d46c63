//! How good tracks of many targets are: CLEAR MOT, identity and HOTA scores.
//!
//! [`clear`] counts misses, false positives and switches (MOTA, MOTP), [`identity`] gives each target one track (IDF1),
//! [`hota`] balances detection with association. [`sequences`] finds truth and results in files, [`table`] shows scores.
//! Scores equal those of TrackEval 1.0 on the same files, read as its benchmark MOT15.
//!
//! Preprocessing: boxes of the truth with a seventh column that truncates to 0 are removed, and a result on such a
//! box is a false positive. Not supported: thresholds on the confidence of results, ignored distractors (MOT16 and
//! later mark them by class; the class column is not read), and ignored regions. motmetrics 1.4 gives the same
//! misses, false positives, MOTP, IDF1, IDP and IDR. Its switches, and so MOTA, can differ, because it keeps a pair
//! through frames in which the target is missed; it also defines fragmentations and mostly tracked differently. Two
//! boxes match if their IoU is at least 0.5 (HOTA: each α).

pub mod clear;
mod frame_table;
pub mod hota;
pub mod identity;
pub mod identity_preservation;
pub mod sequences;
pub mod table;

pub use self::clear::Clear;
pub use self::hota::Hota;
pub use self::identity::Identity;
pub use self::identity_preservation::Crossings;
pub use self::sequences::{Evaluation, Sequence, find_sequences, score_results};
pub use foveate_video::mot::{TrackBox, Tracks};

use serde::Serialize;

use foveate_base::Result;

/// The overlap that a match needs, except in HOTA.
const HALF: f64 = 0.5;

/// All scores of one sequence, or of several pooled.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Frames up to the last one with a box in truth or results.
    pub frames: usize,
    /// Number of true boxes that count.
    pub truth_boxes: usize,
    /// Number of result boxes.
    pub result_boxes: usize,
    /// Number of targets.
    pub truth_ids: usize,
    /// Number of tracks.
    pub result_ids: usize,
    /// MOTA and its counts.
    #[serde(flatten)]
    pub clear: Clear,
    /// IDF1 and its counts.
    #[serde(flatten)]
    pub identity: Identity,
    /// HOTA and its terms.
    #[serde(flatten)]
    pub hota: Hota,
}

/// Scores results against the truth of one video.
///
/// # Errors
/// An id is negative or has two boxes in one frame; more than 4096 boxes in a frame or 50 million pairs of ids.
pub fn score(truth: &Tracks, results: &Tracks) -> Result<Score> {
    let all = frame_table::FrameTables::of(truth, results)?;
    let mut clear = clear::Counter::new(all.ids.0);
    let (mut identity, mut hota) = (identity::Counter::default(), hota::Counter::default());
    for frame_table in &all.frames {
        let overlaps = frame_table.overlaps();
        clear.frame(frame_table, &overlaps);
        identity.frame(frame_table, &overlaps);
        hota.frame(frame_table, &overlaps);
    }
    Ok(Score {
        frames: truth.frames().max(results.frames()),
        truth_boxes: all.boxes.0,
        result_boxes: all.boxes.1,
        truth_ids: all.ids.0,
        result_ids: all.ids.1,
        clear: clear.finish(),
        identity: identity.finish(all.ids, all.boxes),
        hota: hota.finish(&all),
    })
}

impl Score {
    /// Pools several sequences: scores follow from summed counts, so that every box has equal weight.
    pub fn pooled<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let sum = |count: fn(&Self) -> usize| all.clone().map(count).sum();
        Self {
            frames: sum(|s| s.frames),
            truth_boxes: sum(|s| s.truth_boxes),
            result_boxes: sum(|s| s.result_boxes),
            truth_ids: sum(|s| s.truth_ids),
            result_ids: sum(|s| s.result_ids),
            clear: Clear::pooled(all.clone().map(|s| &s.clear)),
            identity: Identity::pooled(all.clone().map(|s| &s.identity)),
            hota: Hota::pooled(all.map(|s| &s.hota)),
        }
    }
}

/// Returns a / b; 0 if b is 0.
fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

#[cfg(test)]
mod tests;
