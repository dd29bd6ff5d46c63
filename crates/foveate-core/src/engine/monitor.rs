//! Is it lost? `monitor` gives the one answer, `adapt` learns from the frames it trusts.

use super::{Engine, Estimate, Work};
use crate::control::{
    ConfidenceModel, Consistency, ConsistencyMonitor, ConsistencySettings, DistractorSearch, DistractorSettings,
    FrameEvidence, LossMonitor, TrackConfidence, distractors,
};
use crate::gaze::Context;
use crate::geometry::{Gaze, State};
use crate::identity::surroundings::Surroundings;
use crate::recognition::Recognition;
use crate::scene::Image;

/// Least share in view at which evidence is judged: of what is hidden for the most part, looks say nothing.
const LEAST_JUDGED: f64 = 0.5;
/// P(lost) below which the target is certain, and frames from one that is remembered to the next.
const CERTAIN: f64 = 0.05;
const REMEMBERED_EVERY: u64 = 8;

/// What watches the evidence, and says from it how probably the target is lost.
pub struct Monitor {
    /// Compares the evidence with the reference.
    pub(super) consistency: ConsistencyMonitor,
    /// P(lost) and the status.
    pub(super) loss: LossMonitor,
    /// Looks for what the target could be mistaken for; `None` for among the particles only.
    pub(super) distractors: Option<DistractorSearch>,
    /// What was around the target while it was certain; `None` where nothing is remembered.
    pub(super) surroundings: Option<Surroundings>,
}

impl Monitor {
    /// A monitor with these settings, which has seen nothing yet.
    pub fn new(consistency: ConsistencySettings, model: ConfidenceModel) -> Self {
        Self {
            consistency: ConsistencyMonitor::new(consistency),
            loss: LossMonitor::new(model),
            distractors: None,
            surroundings: None,
        }
    }
    /// The same, looking for distractors around the target in every frame, and remembering what was there.
    pub fn searching(self, settings: Option<DistractorSettings>) -> Self {
        let remembering = settings.as_ref().filter(|settings| settings.remembered > 0);
        let surroundings = remembering.map(|settings| Surroundings::new(settings.remembered, settings.count()));
        Self { distractors: settings.map(DistractorSearch::new), surroundings, ..self }
    }
    /// The fitted model of P(lost).
    pub fn model(&self) -> &ConfidenceModel {
        self.loss.model()
    }
    /// How the last frame's evidence compared with the reference.
    pub(crate) fn consistency(&self) -> Consistency {
        self.consistency.last()
    }
    pub(super) fn reset(&mut self) {
        self.consistency.reset();
        self.loss.reset();
    }
}

impl Engine {
    /// Perceives at the estimate, and judges the frame: P(lost), the status, and what the policy is told next.
    pub(super) fn monitor(&mut self, image: &Image, estimate: &Estimate) -> TrackConfidence {
        let (reference, judged) = (self.reference(), self.is_judged());
        let unit = self.target().unit * estimate.mean.log_scale.exp();
        let w = &mut self.work;
        let evidence = w.log_evidence / w.plan.looks();
        let consistency = match judged {
            true => self.parts.monitor.consistency.judge(evidence, &w.log_posterior, reference),
            false => self.parts.monitor.consistency.last(),
        };
        let chosen = w.plan.chosen();
        // The mean of states that are scattered lies where none of them is.
        self.parts.appearance.see_more(image, &[estimate.mean], &[chosen]);
        self.parts.appearance.perceive(&estimate.mean, chosen, &mut w.percept);
        let (distance, colour) = (w.percept.distance, w.percept.colour);
        let distractor = if judged { self.look_around(image, estimate) } else { None };
        let elsewhere = if judged { self.was_elsewhere(estimate) } else { 0.0 };
        let spread = spread(&estimate.covariance, unit);
        let alarm = self.parts.recognition.as_ref().map_or(0.0, Recognition::alarm);
        let estimated = estimate.mean;
        let loss = &mut self.parts.monitor.loss;
        let confidence = match judged {
            true => loss.judge(&FrameEvidence {
                consistency,
                evidence,
                reference,
                distractor,
                spread,
                distance,
                colour,
                elsewhere,
                estimate: estimated,
                unit,
                alarm,
            }),
            false => loss.last(),
        };
        self.context = Context {
            ess: estimate.ess / self.work.predicted.len() as f64,
            deficit: consistency.deficit.max(alarm),
            frame_deficit: consistency.frame_deficit,
            spread,
            lost: confidence.status.is_occluded_or_lost(),
            ..self.context
        };
        if judged && confidence.p_lost < CERTAIN && !self.context.lost && self.frame.is_multiple_of(REMEMBERED_EVERY) {
            self.remember(&estimate.mean);
        }
        confidence
    }

    /// How much more the estimate looks like what was around the target in remembered frames than like the target.
    fn was_elsewhere(&mut self, estimate: &Estimate) -> f64 {
        let Some(surroundings) = &mut self.parts.monitor.surroundings else { return 0.0 };
        let Work { features, percept, .. } = &mut self.work;
        if percept.gaze == Gaze::CENTRE {
            return surroundings.elsewhere(&percept.features);
        }
        self.parts.appearance.features(&[estimate.mean], features);
        surroundings.elsewhere(features)
    }

    /// Remembers what is at the places that were searched for distractors, with the target at `state`.
    fn remember(&mut self, state: &State) {
        let extent = self.target().extent;
        let (monitor, features) = (&mut self.parts.monitor, &mut self.work.features);
        if let (Some(surroundings), Some(around)) = (&mut monitor.surroundings, &monitor.distractors)
            && self.parts.appearance.width() > 0
        {
            self.parts.appearance.features(around.last(), features);
            surroundings.remember(state, extent, around.last(), features);
        }
    }

    /// Forgets what was around the target before, and remembers what is there in its first frame.
    pub(super) fn remember_first(&mut self, image: &Image, state: &State) {
        let extent = self.target().extent;
        let monitor = &mut self.parts.monitor;
        let (Some(surroundings), Some(around)) = (&mut monitor.surroundings, &mut monitor.distractors) else { return };
        surroundings.clear();
        self.work.features.reserve(surroundings.places() * self.parts.appearance.width());
        let places = around.places((image.width(), image.height()), state, extent);
        if !places.is_empty() {
            self.parts.appearance.see(image, places, &[Gaze::CENTRE]);
            self.remember(state);
        }
    }

    /// Learns what tells the target from what is around it, while the evidence is consistent with its being there.
    pub(super) fn adapt(&mut self, image: &Image, estimate: &Estimate) {
        let (judged, extent) = (self.is_judged(), self.target().extent);
        let (parts, w) = (&mut self.parts, &mut self.work);
        let consistency = parts.monitor.consistency.last();
        let learns = parts.monitor.consistency.learns(self.frame, self.context.lost);
        if !(judged && learns && parts.appearance.adapts()) {
            return;
        }
        if parts.monitor.distractors.is_none() {
            distractors(&w.predicted, &w.log_posterior, &estimate.mean, extent, &mut w.distractors);
        }
        parts.appearance.adapt(image, &estimate.mean, &w.distractors, consistency.frame_deficit);
    }

    /// Whether enough of the target is in view for its evidence to say that it is lost.
    fn is_judged(&self) -> bool {
        self.visible >= LEAST_JUDGED
    }
}

/// Standard deviation of place in template units; a million stands for what is not finite.
fn spread(covariance: &[[f64; 6]; 6], unit: f64) -> f64 {
    ((0.5 * (covariance[0][0] + covariance[1][1])).sqrt() / unit).min(1e6)
}
