//! The box that is told: the mean of the belief, moved by the box regression. And whether a lost target is there again.

use super::{Engine, Estimate};
use crate::scene::Image;

impl Engine {
    /// Log odds by the box regression that the target is not at the estimate, where it was occluded or lost and that counts; `None` elsewhere.
    pub(super) fn absent(&mut self, image: &Image, estimate: &Estimate) -> Option<f64> {
        let (lost, extent) = (self.context.lost, self.target().extent);
        let counts = self.parts.monitor.model().box_regression.weight != 0.0;
        let boxes = self.parts.box_regression.as_mut().filter(|_| lost && counts)?;
        Some(boxes.answer(image, &estimate.mean, extent).lost.into())
    }

    /// The estimate as it is told. Nothing that comes after it in this frame or the next hears of it.
    pub(super) fn regress(&mut self, image: &Image, estimate: &Estimate) -> Estimate {
        let extent = self.target().extent;
        let moved = self.parts.box_regression.as_mut().map(|it| it.moved(image, &estimate.mean, extent));
        Estimate { mean: moved.unwrap_or(estimate.mean), ..*estimate }
    }
}
