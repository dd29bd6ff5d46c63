//! One track from two: that of the key frame before, and that of the key frame after.
//!
//! The expected IoU of a track in a frame is linear in three signs: P(lost), the overlap of the two tracks, and where the track ends: a track
//! that misses the other key frame's box went wrong on the way. `bench/annotate.py` fits the coefficients.

use foveate::BBox;

use super::passes::{Passes, Sight, Stretch};

/// Expected IoU: constant, logit of P(lost), overlap of the two tracks, and share of the way times miss at its end.
const BOTH: [f64; 4] = [0.383, -0.028, 0.354, -0.324];
/// Expected IoU of a track without another: constant, logit of P(lost).
const ALONE: [f64; 2] = [0.383, -0.060];
/// Expected IoU of the joined boxes by that of the better track: constant, slope.
const JOINED: [f64; 2] = [0.12, 0.87];
/// How steeply the weights of the two tracks follow their expected IoU.
const STEEPNESS: f64 = 8.0;
/// Tracks that overlap less are of two objects: the better one is taken, not a mean.
const SAME: f64 = 0.3;
/// A track whose end overlaps the key frame's box by more has drifted, not lost the target: its drift is spread over its frames.
const DRIFT: f64 = 0.5;
/// The least and the greatest P(lost) that a logit is taken of.
const CERTAIN: [f64; 2] = [0.001, 0.999];

/// The box of a frame, and its expected IoU with the true box, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Joined {
    pub bbox: BBox,
    pub iou: f64,
}

/// Joins the tracks through a stretch: the boxes of frames `from` to `to`. Key frames keep their boxes.
pub(super) fn join(stretch: &Stretch, passes: &Passes) -> Vec<Joined> {
    let key = |bbox: Option<BBox>| bbox.map(|bbox| Joined { bbox, iou: 1.0 });
    let between = match (stretch.first, stretch.last) {
        (Some(first), Some(last)) if !passes.forward.is_empty() => both(&first, &last, passes),
        (Some(_), None) => passes.forward.iter().map(alone).collect(),
        _ => passes.backward.iter().map(alone).collect(),
    };
    key(stretch.first)
        .into_iter()
        .chain(between)
        .chain(key(stretch.last).filter(|_| stretch.to > stretch.from))
        .collect()
}

fn alone(sight: &Sight) -> Joined {
    Joined { bbox: sight.bbox, iou: (ALONE[0] + ALONE[1] * logit(sight.p_lost)).clamp(0.0, 1.0) }
}

/// The frames strictly between two key frames.
fn both(first: &BBox, last: &BBox, Passes { forward, backward }: &Passes) -> Vec<Joined> {
    let n = forward.len();
    let ends = [forward[n - 1].bbox.iou(last), backward[0].bbox.iou(first)];
    // By how much each track misses the key frame at its end, if it is still on the target there.
    let drifts = [(&forward[n - 1].bbox, last), (&backward[0].bbox, first)].map(|(end, key)| apart(end, key));
    let drift = |k: usize| if ends[k] > DRIFT { drifts[k] } else { [0.0; 4] };
    (1..n)
        .map(|i| {
            let (pair, way) = ([forward[i - 1], backward[i]], i as f64 / n as f64);
            let far = [way, 1.0 - way];
            let overlap = pair[0].bbox.iou(&pair[1].bbox);
            let expected: [f64; 2] = std::array::from_fn(|k| {
                BOTH[0] + BOTH[1] * logit(pair[k].p_lost) + BOTH[2] * overlap + BOTH[3] * far[k] * (1.0 - ends[k])
            });
            let boxes: [BBox; 2] = std::array::from_fn(|k| moved(&pair[k].bbox, &drift(k), far[k]));
            let share = 1.0 / (1.0 + (STEEPNESS * (expected[1] - expected[0])).exp());
            let bbox = match () {
                () if overlap > SAME => moved(&boxes[1], &apart(&boxes[1], &boxes[0]), share),
                () if share > 0.5 => boxes[0],
                () => boxes[1],
            };
            let iou = (JOINED[0] + JOINED[1] * expected[0].max(expected[1])).clamp(0.0, 1.0);
            Joined { bbox, iou }
        })
        .collect()
}

fn logit(p: f64) -> f64 {
    let p = p.clamp(CERTAIN[0], CERTAIN[1]);
    (p / (1.0 - p)).ln()
}

/// From one box to another: x and y of the centre, log width, log height.
fn apart(from: &BBox, to: &BBox) -> [f64; 4] {
    let (a, b) = (from.centre(), to.centre());
    [b.0 - a.0, b.1 - a.1, (to.w / from.w).ln(), (to.h / from.h).ln()]
}

/// A box, moved by a share of such a difference.
fn moved(bbox: &BBox, by: &[f64; 4], share: f64) -> BBox {
    let (x, y) = bbox.centre();
    let (w, h) = (bbox.w * (share * by[2]).exp(), bbox.h * (share * by[3]).exp());
    BBox::around(x + share * by[0], y + share * by[1], w, h)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(x: f64, p_lost: f64) -> Sight {
        Sight { bbox: BBox::new(x, 0.0, 10.0, 10.0), p_lost }
    }

    fn stretch(first: Option<f64>, last: Option<f64>, to: usize) -> Stretch {
        let bbox = |x: Option<f64>| x.map(|x| BBox::new(x, 0.0, 10.0, 10.0));
        Stretch { from: 0, to, first: bbox(first), last: bbox(last) }
    }

    fn lefts(joined: &[Joined]) -> Vec<f64> {
        joined.iter().map(|joined| joined.bbox.x).collect()
    }

    #[test]
    fn key_frames_are_exact_and_tracks_that_agree_are_kept() {
        let passes = Passes {
            forward: (1..=4).map(|t| sight(f64::from(t), 0.01)).collect(),
            backward: (0..4).map(|t| sight(f64::from(t), 0.01)).collect(),
        };
        let joined = join(&stretch(Some(0.0), Some(4.0), 4), &passes);
        for (t, x) in lefts(&joined).into_iter().enumerate() {
            assert!((x - t as f64).abs() < 1e-9, "{t}: {x}");
        }
        assert_eq!((joined[0].iou, joined[4].iou), (1.0, 1.0));
        assert!(joined[2].iou > 0.8 && joined[2].iou < 1.0, "{}", joined[2].iou);
    }

    #[test]
    fn drift_is_spread_over_the_frames() {
        // The forward track ends 2 px before the key frame, the backward track 2 px after the other one: both drift.
        let passes = Passes {
            forward: (1..=10).map(|t| sight(0.8 * f64::from(t), 0.01)).collect(),
            backward: (0..10).map(|t| sight(10.0 - 0.8 * (10.0 - f64::from(t)), 0.01)).collect(),
        };
        let joined = join(&stretch(Some(0.0), Some(10.0), 10), &passes);
        for (t, x) in lefts(&joined).into_iter().enumerate() {
            assert!((x - t as f64).abs() < 1e-9, "{t}: {x}");
        }
    }

    #[test]
    fn of_tracks_of_two_objects_the_one_that_arrives_is_taken() {
        let lost = (1..=10).map(|t| sight(if t < 4 { f64::from(t) } else { 100.0 }, 0.02)).collect();
        let passes = Passes { forward: lost, backward: (0..10).map(|t| sight(f64::from(t), 0.02)).collect() };
        let joined = join(&stretch(Some(0.0), Some(10.0), 10), &passes);
        for (t, x) in lefts(&joined).into_iter().enumerate() {
            assert!((x - t as f64).abs() < 0.5, "{t}: {x}");
        }
        assert!(joined[6].iou < joined[2].iou, "doubt where the tracks part");
    }

    #[test]
    fn a_single_track_is_doubted_by_p_lost() {
        let passes = Passes { forward: vec![sight(1.0, 0.01), sight(2.0, 0.9)], backward: vec![] };
        let joined = join(&stretch(Some(0.0), None, 2), &passes);
        assert_eq!(lefts(&joined), [0.0, 1.0, 2.0]);
        assert!(joined[1].iou > 0.6 && joined[2].iou < 0.3);
        let passes = Passes { forward: vec![], backward: vec![sight(1.0, 0.01), sight(2.0, 0.01)] };
        assert_eq!(lefts(&join(&stretch(None, Some(3.0), 2), &passes)), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn neighbouring_key_frames_have_nothing_between_them() {
        let passes = Passes { forward: vec![sight(9.0, 0.5)], backward: vec![sight(9.0, 0.5)] };
        assert_eq!(lefts(&join(&stretch(Some(0.0), Some(1.0), 1), &passes)), [0.0, 1.0]);
        assert_eq!(lefts(&join(&stretch(Some(5.0), None, 0), &Passes::default())), [5.0]);
    }
}
