//! Identity preservation: the fraction of crossings after which both targets keep their tracks.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::{HALF, Tracks, ratio};
use crate::crossings::crossings;
use foveate_core::geometry::BBox;

/// Frames before and after a crossing within which a target must have its track.
const NEAR: usize = 10;

/// The outcomes of crossings, of one video or of several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Crossings {
    /// Crossings of the truth that begin after its first frame and end before its last one.
    pub all: usize,
    /// Both targets had a track within 10 frames before, and the same one within 10 frames after.
    pub preserved: usize,
    /// One of them had, within 10 frames after, the track that the other one had before.
    pub swapped: usize,
}

impl Crossings {
    /// Counts the crossings in the truth and their outcomes in the results. A target has a track if their IoU is at
    /// least 0.5.
    pub fn of(truth: &Tracks, results: &Tracks) -> Self {
        // Boxes that do not count, as for the other scores.
        let mut truth = truth.clone();
        truth.sightings.retain(|s| s.confidence.trunc() != 0.0);
        let truth = &truth;
        let (truth_at, found_at) = (by_frame(truth), by_frame(results));
        let (begin, frames) = (truth.sightings.iter().map(|s| s.frame).min().unwrap_or(0), truth.frames());
        let tracks = |target: i64, frame: usize| -> Vec<i64> {
            let Some(bbox) = truth_at.get(&frame).and_then(|all| all.iter().find(|(id, _)| *id == target)) else {
                return vec![];
            };
            let found = found_at.get(&frame).into_iter().flatten();
            found.filter(|(_, b)| b.iou(&bbox.1) >= HALF).map(|(id, _)| *id).collect()
        };
        let mut sum = Self::default();
        for crossing in crossings(truth) {
            let ((a, b), (first, last)) = (crossing.pair, crossing.frames);
            if first <= begin || last + 1 >= frames {
                continue;
            }
            let before = |target: i64| {
                (first.saturating_sub(NEAR)..first).rev().find_map(|t| tracks(target, t).first().copied())
            };
            let has = |target: i64, id: Option<i64>| {
                (last + 1..(last + 1 + NEAR).min(frames)).any(|t| id.is_some_and(|id| tracks(target, t).contains(&id)))
            };
            let (of_a, of_b) = (before(a), before(b));
            let preserved = has(a, of_a) && has(b, of_b);
            sum.all += 1;
            sum.preserved += usize::from(preserved);
            sum.swapped += usize::from(!preserved && (has(a, of_b) || has(b, of_a)));
        }
        sum
    }

    /// Pools several videos.
    pub fn pooled<'a>(all: impl Iterator<Item = &'a Self>) -> Self {
        all.fold(Self::default(), |sum, one| Self {
            all: sum.all + one.all,
            preserved: sum.preserved + one.preserved,
            swapped: sum.swapped + one.swapped,
        })
    }
    /// Returns the fraction of the crossings after which both targets have their tracks; 0 without a crossing.
    pub fn share_preserved(&self) -> f64 {
        ratio(self.preserved as f64, self.all as f64)
    }
    /// Returns the fraction of the crossings after which a track is on the wrong target.
    pub fn share_swapped(&self) -> f64 {
        ratio(self.swapped as f64, self.all as f64)
    }
}

fn by_frame(tracks: &Tracks) -> HashMap<usize, Vec<(i64, BBox)>> {
    let mut frames: HashMap<usize, Vec<(i64, BBox)>> = HashMap::new();
    for s in &tracks.sightings {
        frames.entry(s.frame).or_default().push((s.id, s.bbox));
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_video::mot::TrackBox;

    fn boxed(frame: usize, id: i64, x: f64) -> TrackBox {
        TrackBox { frame, id, bbox: BBox { x, y: 0.0, w: 10.0, h: 10.0 }, confidence: 1.0 }
    }

    #[test]
    fn preserved_swapped_and_lost() {
        // One stands, one passes from −29 to 29, 2 px a frame: they cross in frames 12 to 17.
        let passes = |t: usize| 2.0 * t as f64 - 29.0;
        let truth = Tracks { sightings: (0..30).flat_map(|t| [boxed(t, 1, 0.0), boxed(t, 2, passes(t))]).collect() };
        let results = |of: &dyn Fn(usize) -> Vec<TrackBox>| Tracks { sightings: (0..30).flat_map(of).collect() };
        let right = results(&|t| vec![boxed(t, 7, 0.0), boxed(t, 9, passes(t))]);
        assert_eq!(Crossings::of(&truth, &right), Crossings { all: 1, preserved: 1, swapped: 0 });
        let swapped = results(&|t| {
            let (a, b) = if t < 15 { (7, 9) } else { (9, 7) };
            vec![boxed(t, a, 0.0), boxed(t, b, passes(t))]
        });
        assert_eq!(Crossings::of(&truth, &swapped), Crossings { all: 1, preserved: 0, swapped: 1 });
        let lost =
            results(&|t| if t < 15 { vec![boxed(t, 7, 0.0), boxed(t, 9, passes(t))] } else { vec![boxed(t, 7, 0.0)] });
        assert_eq!(Crossings::of(&truth, &lost), Crossings { all: 1, preserved: 0, swapped: 0 });
        let renamed = results(&|t| vec![boxed(t, if t < 15 { 7 } else { 8 }, 0.0), boxed(t, 9, passes(t))]);
        assert_eq!(Crossings::of(&truth, &renamed), Crossings { all: 1, preserved: 0, swapped: 0 });
        let both = Crossings::pooled([Crossings::of(&truth, &right), Crossings::of(&truth, &swapped)].iter());
        assert_eq!((both.share_preserved(), both.share_swapped()), (0.5, 0.5));
        // Where the truth begins in the middle of it, nobody could have kept the tracks.
        let late =
            |all: &Tracks| Tracks { sightings: all.sightings.iter().filter(|s| s.frame > 13).copied().collect() };
        assert_eq!(Crossings::of(&late(&truth), &late(&right)), Crossings::default());
        // A box that does not count crosses none.
        let mut ignored = truth.clone();
        ignored.sightings.iter_mut().filter(|s| s.id == 2).for_each(|s| s.confidence = 0.0);
        assert_eq!(Crossings::of(&ignored, &right), Crossings::default());
        assert_eq!(Crossings::of(&Tracks::default(), &right).share_preserved(), 0.0);
    }
}
