//! The class of the target, which never changes the belief, and the regression of its box, which changes size and shape alone.

use super::target::Estimate;
use super::view::View;
use crate::control::ConfidenceModel;
use crate::gaze::Context;
use crate::geometry::Extent;
use crate::identity::box_regression::{Answer, BoxRegression};
use crate::recognition::Recognition;
use crate::scene::{Image, Meter};
use foveate_base::rng::Streams;

/// P(lost) below which the particles follow the box regression.
pub(super) const CONFIDENT: f64 = 0.3;

/// The recogniser and the box regression of a tracker; both are optional.
#[derive(Debug, Default)]
pub(super) struct Extras {
    /// p(cₜ | all looks at the estimate).
    pub recognition: Option<Recognition>,
    pub box_regression: Option<BoxRegression>,
}

impl Extras {
    /// Starts on a target at `state` of its first picture.
    pub(super) fn init(&mut self, image: &Image, state: &crate::geometry::State, extent: Extent) {
        if let Some(it) = &mut self.box_regression {
            it.imprint(image, state, extent);
        }
    }

    /// Returns the answer of the box regression at the estimate, if this frame uses its log odds of an absent target: in each frame of a
    /// lost target, and in the frames where the regression runs in any case.
    pub(super) fn ask(
        &mut self,
        view: &View<'_>,
        estimate: &Estimate,
        model: &ConfidenceModel,
        lost: bool,
    ) -> Option<Answer> {
        let (returns, absence) = (model.box_regression.weight != 0.0, model.absence.counts());
        let counts = |it: &&mut BoxRegression| if lost { returns || absence } else { absence && it.is_due() };
        let boxes = self.box_regression.as_mut().filter(counts)?;
        Some(boxes.answer(view.scene.image, &estimate.mean, view.target.extent))
    }

    /// Returns the estimate as reported. `answer` is the answer of the box regression if this frame has
    /// computed it already.
    pub(super) fn regress(&mut self, view: &View<'_>, estimate: Estimate, answer: Option<Answer>) -> Estimate {
        let Some(boxes) = &mut self.box_regression else { return estimate };
        Estimate { mean: boxes.moved(view.scene.image, &estimate.mean, view.target.extent, answer), ..estimate }
    }

    /// Returns the change of log size and log of width / height that the particles take after this frame; none if it is not confident.
    pub(super) fn follow(&mut self, confident: bool) -> [f64; 2] {
        let regression = self.box_regression.as_mut().filter(|_| confident);
        regression.and_then(BoxRegression::follow).unwrap_or_default()
    }

    /// Classifies the target from another look at the estimate.
    pub(super) fn recognise(&mut self, view: &View<'_>, estimate: &Estimate, context: &Context, streams: Streams) {
        if let Some(it) = &mut self.recognition {
            it.look(view.scene.image, &estimate.mean, view.target.extent, context, &mut streams.rng(0));
        }
    }

    /// Returns a lower bound on P(lost) from the classes of the previous frames, 0 to 1.
    pub(super) fn alarm(&self) -> f64 {
        self.recognition.as_ref().map_or(0.0, Recognition::alarm)
    }

    /// Adds the rectangles that were read in this frame.
    pub(super) fn measure(&mut self, meter: &mut Meter) {
        if let Some(it) = &self.recognition {
            it.measure(meter);
        }
        if let Some(it) = &mut self.box_regression {
            it.measure(meter);
        }
    }

    /// Frees buffers that are not needed until the next step.
    pub(super) fn compact(&mut self) {
        if let Some(it) = &mut self.box_regression {
            it.compact();
        }
    }
}
