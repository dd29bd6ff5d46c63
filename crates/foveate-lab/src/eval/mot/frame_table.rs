//! Tracks by frame for the scores, with ids counted from 0.

use std::collections::BTreeSet;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_video::mot::{TrackBox, Tracks};

/// Maximum number of boxes per frame: matching needs memory for its square.
const LARGEST_FRAME: usize = 4096;
/// Maximum number of pairs of ids, for the same reason.
const LARGEST_PAIRS: usize = 50_000_000;

/// The objects of one frame: ids as indices, with their boxes, in the order of the file.
pub(super) struct FrameTable {
    pub truth: Vec<(usize, BBox)>,
    pub found: Vec<(usize, BBox)>,
}

impl FrameTable {
    /// Returns the intersection over union of each true box (row) with each result box (column).
    pub(super) fn overlaps(&self) -> Vec<f64> {
        self.truth.iter().flat_map(|(_, t)| self.found.iter().map(|(_, f)| overlap(t, f))).collect()
    }
}

/// Intersection over union, 0 to 1; 0 if a box has no area.
///
/// Computed from the corners in the file's coordinates, so that rounding, and so each comparison with a threshold,
/// equals that of other tools on the same file.
fn overlap(a: &BBox, b: &BBox) -> f64 {
    let corners = |r: &BBox| (r.x + 1.0, r.y + 1.0, r.x + 1.0 + r.w, r.y + 1.0 + r.h);
    let (a, b) = (corners(a), corners(b));
    let area = |r: (f64, f64, f64, f64)| (r.2 - r.0) * (r.3 - r.1);
    let both = (a.2.min(b.2) - a.0.max(b.0)).max(0.0) * (a.3.min(b.3) - a.1.max(b.1)).max(0.0);
    let either = area(a) + area(b) - both;
    if area(a) <= f64::EPSILON || area(b) <= f64::EPSILON || either <= f64::EPSILON { 0.0 } else { both / either }
}

/// All data of a sequence for the scores.
pub(super) struct FrameTables {
    /// Frames with at least one box, in order.
    pub frames: Vec<FrameTable>,
    /// Number of targets, of tracks.
    pub ids: (usize, usize),
    /// Boxes of truth that count, of results.
    pub boxes: (usize, usize),
}

impl FrameTables {
    /// # Errors
    /// An id is negative or twice in a frame, or there are too many boxes.
    pub(super) fn of(truth: &Tracks, results: &Tracks) -> Result<Self> {
        // A flag between 0 and 1 counts as 0: MOTChallenge's tools truncate it to a whole number.
        let counts = |s: &&TrackBox| s.confidence.trunc() != 0.0;
        let truth = numbered("truth", truth.sightings.iter().filter(counts).collect())?;
        let found = numbered("results", results.sightings.iter().collect())?;
        let ids = (truth.1, found.1);
        if ids.0.saturating_mul(ids.1) > LARGEST_PAIRS {
            let problem = format!("{} targets and {} tracks have too many pairs of ids to be matched", ids.0, ids.1);
            return Err(Error::Invalid(problem));
        }
        let (truth, found) = (truth.0, found.0);
        let boxes = (truth.len(), found.len());
        let frames: BTreeSet<usize> = truth.iter().chain(&found).map(|(frame, ..)| *frame).collect();
        let (mut truth, mut found) = (truth.into_iter().peekable(), found.into_iter().peekable());
        let mut take = |frame: usize| {
            let mut frame_table = FrameTable { truth: vec![], found: vec![] };
            while let Some((_, id, bbox)) = truth.next_if(|next| next.0 == frame) {
                frame_table.truth.push((id, bbox));
            }
            while let Some((_, id, bbox)) = found.next_if(|next| next.0 == frame) {
                frame_table.found.push((id, bbox));
            }
            frame_table
        };
        Ok(Self { frames: frames.into_iter().map(&mut take).collect(), ids, boxes })
    }
}

/// Frame, id, box.
type Numbered = (usize, usize, BBox);

/// Returns the boxes by frame, otherwise in the order of the file, with ids counted from 0; and the number of ids.
fn numbered(what: &str, mut sightings: Vec<&TrackBox>) -> Result<(Vec<Numbered>, usize)> {
    if let Some(s) = sightings.iter().find(|s| s.id < 0) {
        let (id, frame) = (s.id, s.frame + 1);
        return Err(Error::Invalid(format!("{what}: id {id} in frame {frame}; a track's id is 0 or more")));
    }
    sightings.sort_by_key(|s| s.frame);
    for frame in sightings.chunk_by(|a, b| a.frame == b.frame) {
        let at = frame[0].frame + 1;
        if frame.len() > LARGEST_FRAME {
            let problem =
                format!("{what}: {} boxes in frame {at}; at most {LARGEST_FRAME} can be matched", frame.len());
            return Err(Error::Invalid(problem));
        }
        let mut ids: Vec<i64> = frame.iter().map(|s| s.id).collect();
        ids.sort_unstable();
        if let Some(twice) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Error::Invalid(format!("{what}: id {} has two boxes in frame {at}", twice[0])));
        }
    }
    let mut ids: Vec<i64> = sightings.iter().map(|s| s.id).collect();
    ids.sort_unstable();
    ids.dedup();
    let index = |s: &&TrackBox| (s.frame, ids.binary_search(&s.id).expect("every id is in the list"), s.bbox);
    Ok((sightings.iter().map(index).collect(), ids.len()))
}
