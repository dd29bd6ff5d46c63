//! The class of the target, which never changes the belief, and the regression of its box, which changes size and shape alone.

use super::target::Estimate;
use super::view::View;
use crate::control::{ConfidenceModel, PlaceEvidence};
use crate::gaze::Context;
use crate::geometry::Extent;
use crate::identity::box_regression::{Answer, BoxRegression};
use crate::recognition::Recognition;
use crate::scene::{Image, Meter};
use foveate_base::rng::Streams;

/// The recogniser and the box regression of a tracker, and the rule for its first box; all are optional.
#[derive(Debug, Default)]
pub(super) struct Extras {
    /// p(cₜ | all looks at the estimate).
    pub recognition: Option<Recognition>,
    pub box_regression: Option<BoxRegression>,
    /// Whether a first box that is too large shrinks to what moves as one (`engine/first_box.rs`).
    pub shrinks_first_box: bool,
    /// The rectangle that this rule has read: left column, top row, width and height, pixels.
    pub read: Option<(usize, usize, usize, usize)>,
}

impl Extras {
    /// Starts on a target at `state` of its first picture.
    pub(super) fn init(&mut self, image: &Image, state: &crate::geometry::State, extent: Extent) {
        if let Some(it) = &mut self.box_regression {
            it.init_template(image, state, extent);
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
        let (returns, absence) = (model.box_regression.weight != 0.0, model.counts_absence());
        let counts = |it: &&mut BoxRegression| if lost { returns || absence } else { absence && it.is_due() };
        let boxes = self.box_regression.as_mut().filter(counts)?;
        Some(boxes.answer(view.scene.image, &estimate.mean, view.target.extent))
    }

    /// Returns the estimate as reported, with the expected errors of size and shape by the box regression in its covariance: a sample that
    /// agrees is no certainty; and the change of log size and log of width / height that the particles take after this frame, none if it
    /// is not `confident`. `answer` is the answer of the box regression if this frame has computed it already.
    pub(super) fn regress(
        &mut self,
        view: &View<'_>,
        estimate: &Estimate,
        answer: Option<Answer>,
        confident: bool,
    ) -> (Estimate, [f64; 2]) {
        let Some(boxes) = &mut self.box_regression else { return (*estimate, [0.0; 2]) };
        let mean = boxes.moved(view.scene.image, &estimate.mean, view.target.extent, answer);
        let ([.., log_scale, log_aspect], mut covariance) = (boxes.errors(), estimate.covariance);
        // In the order of `State::to_array`.
        for (k, error) in [(4, log_scale), (6, log_aspect)] {
            covariance[k][k] += error * error;
        }
        let change = confident.then(|| boxes.follow()).flatten().unwrap_or_default();
        (Estimate { mean, covariance, ..*estimate }, change)
    }

    /// Returns the inputs of the error of a reported place.
    pub(super) fn evidence(&self, estimate: &Estimate, extent: Extent) -> PlaceEvidence {
        let (c, (half_w, half_h)) = (&estimate.covariance, estimate.mean.half(extent));
        let [right, down, ..] = self.box_regression.as_ref().map_or([0.0; 4], BoxRegression::errors);
        PlaceEvidence {
            belief: [c[0][0], c[0][1], c[1][1]],
            errors: [right * half_w, down * half_h],
            ess: estimate.ess,
            unit: extent.mean() * estimate.mean.log_scale.exp(),
            moved: estimate.moved,
        }
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
        if let Some(read) = self.read.take() {
            meter.add(read);
        }
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

#[cfg(test)]
mod tests {
    use super::super::toy::{Toy, parts, picture, started, turning};
    use crate::scene::Scene;

    /// Another class at the estimate is a loss, however well the place fits: the alarm is a lower bound of P(lost), and a deficit for the
    /// policy. Without an alarm the class changes nothing.
    #[test]
    fn an_alarm_of_the_class_is_evidence_of_a_loss() {
        let recognitions = [turning(20), turning(20).with_alarm().expect("two classes")];
        let [without, with] = recognitions.map(|recognition| {
            let mut engine = started(parts(Toy::at(50.0)).with_recognition(Some(recognition)), 0);
            let image = picture();
            let mut alarms = (0..40).map(|frame| {
                let alarm = engine.parts.extras.alarm();
                let p_lost = engine.step_on(Scene { image: &image, detections: &[] }).p_lost;
                assert!(p_lost == alarm || (alarm < 0.01 && p_lost < 0.01), "frame {frame}: P(lost) {p_lost}, {alarm}");
                assert!(engine.context.deficit >= alarm, "frame {frame}");
                alarm
            });
            (alarms.by_ref().take(20).sum::<f64>(), alarms.last().expect("frames"), engine.is_searching())
        });
        assert_eq!(without, (0.0, 0.0, false));
        assert!(with.0 == 0.0 && with.1 > 0.7 && with.2, "{with:?}");
    }
}
