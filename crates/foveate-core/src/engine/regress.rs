//! The box that is told: the mean of the belief, moved by the box regression. And whether the target is there, by its word.

use super::{Engine, Estimate};
use crate::scene::Image;

impl Engine {
    /// Log odds by the box regression that the target is not at the estimate, where it looks in any case and that counts, and in each frame of
    /// a target that is occluded or lost; `None` elsewhere.
    pub(super) fn absent(&mut self, image: &Image, estimate: &Estimate) -> Option<f64> {
        let (lost, extent, model) = (self.context.lost, self.target().extent, self.parts.monitor.model());
        let (found, gone) = (model.box_regression.weight != 0.0, model.absence.counts());
        let boxes = self.parts.box_regression.as_mut();
        let boxes = boxes.filter(|it| if lost { found || gone } else { gone && it.is_due() })?;
        let answer = boxes.answer(image, &estimate.mean, extent);
        self.work.answer = Some(answer);
        Some(answer.lost.into())
    }

    /// The estimate as it is told. Nothing that comes after it in this frame or the next hears of it.
    pub(super) fn regress(&mut self, image: &Image, estimate: &Estimate) -> Estimate {
        let (extent, answer) = (self.target().extent, self.work.answer.take());
        let moved = self.parts.box_regression.as_mut().map(|it| it.moved(image, &estimate.mean, extent, answer));
        Estimate { mean: moved.unwrap_or(estimate.mean), ..*estimate }
    }
}
