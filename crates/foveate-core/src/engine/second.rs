//! A second, smaller tracker of the same target. If the boxes of the two diverge, one of them is lost.
//!
//! Deviation: the paper has one tracker. Query by committee (Seung, Opper and Sompolinsky, 1992) uses the disagreement of members: the
//! second tracker reads another part of the target, such as the middle of its box, and learns from its own boxes only, so that the two
//! seldom fail in the same way. It never moves the box of the first tracker; the overlap of the boxes is a cue of the reported P(lost)
//! (*agreement*).

use super::Engine;
use super::monitor::Verdict;
use super::target::Estimate;
use super::view::View;
use crate::scene::Scene;

/// P(lost) of the first tracker without the agreement cue, below which a lost second tracker restarts at the estimate. It is small because
/// a second tracker that restarts more readily agrees with the first one, right or wrong (docs/lab/confidence.md).
const SURE: f64 = 0.005;

/// Steps the second tracker. Returns the overlap (IoU) of its box with the box at the estimate of the first; `None` without a second
/// tracker.
pub(super) fn agreement(second: Option<&mut Engine>, view: &View<'_>, estimate: &Estimate) -> Option<f64> {
    let second = second?;
    second.step_on(Scene { image: view.scene.image, detections: &[] });
    let (theirs, _) = second.record.reported?;
    // The boxes of what the two follow: a margin that was drawn around it would hide a difference.
    Some(theirs.mean.bbox(second.target().extent).iou(&estimate.mean.bbox(view.target.extent)))
}

/// Resets the second tracker with the first. If the first was misled, everything that the second learned since frame 1 is reset. If the
/// second is lost and the first is sure of its place, the second restarts at the estimate. Its box takes the change of shape of the first;
/// its size is its own.
pub(super) fn follow(
    second: Option<&mut Engine>,
    view: &View<'_>,
    estimate: &Estimate,
    verdict: &Verdict,
    [_, log_aspect]: [f64; 2],
) {
    let Some(second) = second else { return };
    if verdict.is_misled {
        second.parts.monitor.forget_learned(second.parts.appearance.memory());
    }
    if !verdict.is_searching && verdict.confidence.own < SURE && second.context.lost {
        second.start_again_at(&estimate.mean.bbox(view.target.drawn()));
    }
    second.parts.filter.reshape([0.0, log_aspect]);
}
