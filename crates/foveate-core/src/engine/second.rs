//! A second, smaller tracker of the same target. If the boxes of the two part, one of them is lost.
//!
//! Deviation: the paper has one tracker. Query by committee (Seung, Opper and Sompolinsky, 1992) asks where members disagree: the second
//! tracker sees another part of the target, such as the middle of its box, and learns from its own boxes only, so that the two are seldom wrong
//! in the same way. It moves no box of the first tracker; the overlap of the boxes is a cue of the reported P(lost) (*agreement*).

use super::Engine;
use super::target::Estimate;
use super::view::View;
use crate::control::TrackConfidence;
use crate::scene::Scene;

/// P(lost) by the own cues below which a lost second tracker starts again at the estimate. It is small: a second tracker that is led to the
/// first one's place more readily agrees with it, right or wrong (docs/lab/confidence.md).
const SURE: f64 = 0.005;

/// Steps the second tracker: the overlap (IoU) of its box with that at the estimate of the first; `None` without one.
pub(super) fn agreement(second: &mut Option<Box<Engine>>, view: &View<'_>, estimate: &Estimate) -> Option<f64> {
    let scene = Scene { image: view.scene.image, detections: &[] };
    Some(second.as_mut()?.step_on(scene).bbox.iou(&estimate.mean.bbox(view.target.extent)))
}

/// Resets the second tracker with the first: it forgets what it learned since frame 1 if the first was `misled`, and starts again at the
/// estimate if it is lost and the first is sure of its place.
pub(super) fn follow(
    second: &mut Option<Box<Engine>>,
    view: &View<'_>,
    estimate: &Estimate,
    verdict: &TrackConfidence,
    (lost, misled): (bool, bool),
) {
    let Some(second) = second else { return };
    if misled {
        second.forget_learned();
    }
    if !lost && verdict.own < SURE && second.context.lost {
        second.start_again_at(&estimate.mean.bbox(view.target.extent));
    }
}

impl Engine {
    /// Forgets what the discriminant and the colours learned since frame 1, and the surroundings of the target.
    fn forget_learned(&mut self) {
        if let Some(memory) = self.parts.appearance.memory() {
            memory.forget();
        }
        if let Some(surroundings) = &mut self.parts.monitor.surroundings {
            surroundings.clear();
        }
        if let Some(second) = &mut self.second {
            second.forget_learned();
        }
    }
}
