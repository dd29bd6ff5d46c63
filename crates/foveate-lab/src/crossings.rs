//! Where targets pass over each other: the moments at which identities are lost.

use std::collections::BTreeMap;

use foveate_core::geometry::{BBox, sharing_columns};
use foveate_video::mot::Tracks;

/// A crossing covers at least this share of the smaller box.
const COVERED: f64 = 0.5;
/// Frames apart that still belong to one crossing.
const PAUSE: usize = 10;

/// Two targets over each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// Their ids, the smaller first.
    pub pair: (i64, i64),
    /// First and last frame, from 0, in which half of the smaller box at least is covered by the other one.
    pub frames: (usize, usize),
}

/// All crossings of some tracks, by pair and time. Stretches at most 10 frames apart are one.
pub fn crossings(tracks: &Tracks) -> Vec<Crossing> {
    let mut frames: BTreeMap<usize, Vec<(i64, BBox)>> = BTreeMap::new();
    for s in &tracks.sightings {
        frames.entry(s.frame).or_default().push((s.id, s.bbox));
    }
    let mut met: BTreeMap<(i64, i64), Vec<(usize, usize)>> = BTreeMap::new();
    let mut order = vec![];
    for (&frame, boxes) in &frames {
        for (i, j) in sharing_columns(boxes.len(), &|i| boxes[i].1, &mut order) {
            let ((a, box_a), (b, box_b)) = (&boxes[i], &boxes[j]);
            let smaller = (box_a.w * box_a.h).min(box_b.w * box_b.h);
            if smaller > 0.0 && box_a.intersection(box_b) >= COVERED * smaller {
                let stretches = met.entry((*a.min(b), *a.max(b))).or_default();
                match stretches.last_mut() {
                    Some((_, last)) if frame - *last <= PAUSE => *last = frame,
                    _ => stretches.push((frame, frame)),
                }
            }
        }
    }
    met.into_iter().flat_map(|(pair, all)| all.into_iter().map(move |frames| Crossing { pair, frames })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_video::mot::TrackBox;

    #[test]
    fn crossings_are_stretches_of_cover() {
        // The second passes the first one from the left, 2 px a frame; 10 px wide, they half cover from −5 to 5.
        let boxed = |frame: usize, id: i64, x: f64| TrackBox {
            frame,
            id,
            bbox: BBox { x, y: 0.0, w: 10.0, h: 10.0 },
            confidence: 1.0,
        };
        let pass = |start: usize| {
            (0..20).flat_map(move |t| [boxed(start + t, 4, 0.0), boxed(start + t, 2, 2.0 * t as f64 - 19.0)])
        };
        let once = Tracks { sightings: pass(0).collect() };
        let first = Crossing { pair: (2, 4), frames: (7, 12) };
        assert_eq!(crossings(&once), [first]);
        let twice = Tracks { sightings: pass(0).chain(pass(30)).collect() };
        assert_eq!(crossings(&twice), [first, Crossing { pair: (2, 4), frames: (37, 42) }]);
        let soon = Tracks { sightings: pass(0).chain(pass(10).filter(|s| s.frame >= 20)).collect() };
        assert_eq!(crossings(&soon), [Crossing { pair: (2, 4), frames: (7, 22) }]);
        assert!(crossings(&Tracks::default()).is_empty());
    }
}
