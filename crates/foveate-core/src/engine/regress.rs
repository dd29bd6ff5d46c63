//! The box that is told: the mean of the belief, moved by the box regression.

use super::{Engine, Estimate};
use crate::scene::Image;

impl Engine {
    /// The estimate as it is told. Nothing that comes after it in this frame or the next hears of it.
    pub(super) fn regress(&mut self, image: &Image, estimate: &Estimate) -> Estimate {
        let extent = self.target().extent;
        let moved = self.parts.box_regression.as_mut().map(|it| it.moved(image, &estimate.mean, extent));
        Estimate { mean: moved.unwrap_or(estimate.mean), ..*estimate }
    }
}
