//! A second, smaller tracker of the same target, whose box is compared with this one's: where the two part, one of them is lost.
//!
//! Deviation: the paper has one tracker. A committee is asked where its members disagree (Seung, Opper and Sompolinsky, *Query by
//! committee*, 1992): the second sees something else of the target, the middle of its box, say, and learns from its own boxes only, so
//! that what misleads one seldom misleads both in the same way. It moves no box of the first; P(lost) hears of it (*agreement*).

use super::{Engine, Estimate};
use crate::scene::{Image, Scene};

impl Engine {
    /// Lets the second opinion look: the overlap (IoU) of its box with that at the estimate; `None` without one.
    pub(super) fn agreement(&mut self, image: &Image, estimate: &Estimate) -> Option<f64> {
        let here = estimate.mean.bbox(self.target().extent);
        let second = self.second.as_mut()?;
        Some(second.step(Scene { image, detections: &[] }).bbox.iou(&here))
    }

    /// A second opinion that has lost the target begins again where the first is, which has to be certain: else agreement would be the
    /// first's own word.
    pub(super) fn advise(&mut self, estimate: &Estimate) {
        let here = estimate.mean.bbox(self.target().extent);
        if let Some(second) = self.second.as_mut().filter(|second| second.context.lost) {
            second.begin_again_at(&here);
        }
    }
}
