//! Is it lost? `monitor` gives the one answer, `adapt` learns from the frames it trusts.

use super::{Engine, Estimate, Work};
use crate::control::{
    ConfidenceModel, Consistency, ConsistencyMonitor, ConsistencySettings, DistractorSearch, DistractorSettings,
    FrameEvidence, LossMonitor, TrackConfidence, distractors,
};
use crate::gaze::Context;
use crate::geometry::{Gaze, State};
use crate::identity::surroundings::Surroundings;
use crate::identity::{Appearance, Lesson};
use crate::recognition::Recognition;
use crate::scene::Image;

/// Least share in view at which evidence is judged: of what is hidden for the most part, looks say nothing.
const LEAST_JUDGED: f64 = 0.5;
/// The same while another target is in its way: a tenth that is covered costs more than a tenth of the evidence.
const LEAST_JUDGED_BESIDE: f64 = 0.9;
/// Share of the place where the target is expected below which another target may be what is seen there.
const OWN_PLACE: f64 = 0.8;
/// P(lost) by the own cues below which a second opinion that is lost begins again at the estimate: seldom. Where it is led to the first's place
/// more readily it agrees with it, right or wrong (docs/lab/confidence.md).
const SURE: f64 = 0.005;
/// P(lost) below which the target is certain, and frames from one that is remembered to the next.
const CERTAIN: f64 = 0.05;
const REMEMBERED_EVERY: u64 = 8;

/// What watches the evidence, and says from it how probably the target is lost.
pub struct Monitor {
    /// Compares the evidence with the reference.
    pub(super) consistency: ConsistencyMonitor,
    /// The same for what is learned for now, by the evidence as it is with that; `None` without a short-term memory.
    pub(super) for_now: Option<ForNow>,
    /// P(lost) and the status.
    pub(super) loss: LossMonitor,
    /// Looks for what the target could be mistaken for; `None` for among the particles only.
    pub(super) distractors: Option<DistractorSearch>,
    /// What was around the target while it was certain; `None` where nothing is remembered.
    pub(super) surroundings: Option<Surroundings>,
}

/// From which frames a short-term memory learns.
pub(super) struct ForNow {
    pub consistency: ConsistencyMonitor,
    /// The most that a frame's evidence may fall short.
    gate: f64,
}

impl Monitor {
    /// A monitor with these settings, which has seen nothing yet.
    pub fn new(consistency: ConsistencySettings, model: ConfidenceModel) -> Self {
        Self {
            consistency: ConsistencyMonitor::new(consistency),
            for_now: None,
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
    /// The same, for an appearance that learns for now from frames of larger deficits: `threshold` of the smoothed one, `gate` of one
    /// frame's.
    pub fn remembering(self, settings: &ConsistencySettings, short_term: Option<(f64, f64)>) -> Self {
        let for_now = short_term.map(|(threshold, gate)| {
            let settings = ConsistencySettings { threshold, ..settings.clone() };
            ForNow { consistency: ConsistencyMonitor::new(settings), gate }
        });
        Self { for_now, ..self }
    }
    /// The fitted model of P(lost).
    pub fn model(&self) -> &ConfidenceModel {
        self.loss.model()
    }
    /// How the last frame's evidence compared with the reference.
    pub(crate) fn consistency(&self) -> Consistency {
        self.consistency.last()
    }
    /// Whether the first of two places looks more like what was around the target in remembered frames than the second does.
    pub(super) fn was_beside(
        &mut self,
        appearance: &mut dyn Appearance,
        places: [State; 2],
        features: &mut Vec<f32>,
    ) -> bool {
        let Some(surroundings) = &mut self.surroundings else { return false };
        appearance.features(&places, features);
        let (first, second) = features.split_at(features.len() / 2);
        surroundings.elsewhere(first) > surroundings.elsewhere(second)
    }
    pub(super) fn reset(&mut self) {
        self.reset_consistency();
        self.loss.reset();
    }
    /// Forgets how evidence was, and what was usual: what it is compared with has changed.
    pub(super) fn forget_evidence(&mut self) {
        self.reset_consistency();
        self.loss.forget_usual();
    }
    /// Forgets how evidence was in the last frames.
    pub(super) fn reset_consistency(&mut self) {
        self.consistency.reset();
        self.for_now.iter_mut().for_each(|it| it.consistency.reset());
    }
}

impl Engine {
    /// Perceives at the estimate, and judges the frame: P(lost), the status, and what the policy is told next.
    pub(super) fn monitor(&mut self, image: &Image, estimate: &Estimate) -> TrackConfidence {
        let evidence = self.evidence(image, estimate);
        let (judged, loss) = (self.is_judged(), &mut self.parts.monitor.loss);
        let confidence = if judged { loss.judge(&evidence) } else { loss.hold() };
        let lost = loss.is_searching();
        if lost && !self.context.lost && loss.is_misled() {
            self.forget_learned();
        }
        self.context = Context {
            ess: estimate.ess / self.work.predicted.len() as f64,
            deficit: evidence.consistency.deficit.max(evidence.alarm),
            frame_deficit: evidence.consistency.frame_deficit,
            spread: evidence.spread,
            lost,
            ..self.context
        };
        if lost {
            self.parts.appearance.forget_short_term();
        } else if confidence.own < CERTAIN {
            if confidence.own < SURE {
                self.advise(estimate);
            }
            if judged && self.frame.is_multiple_of(REMEMBERED_EVERY) {
                self.remember(&estimate.mean);
            }
        }
        confidence
    }

    /// Forgets what discriminant and colours learned since the first frame, and what was around the target: it was learned of something else,
    /// for which the target was taken, and vouches for it.
    fn forget_learned(&mut self) {
        self.parts.appearance.forget_learned();
        self.parts.monitor.surroundings.iter_mut().for_each(Surroundings::clear);
        self.second.iter_mut().for_each(|second| second.forget_learned());
    }

    /// What the frame shows of the target at the estimate; where it is not judged, what is told of its looks is the last verdict's.
    fn evidence(&mut self, image: &Image, estimate: &Estimate) -> FrameEvidence {
        let (reference, judged) = (self.reference(), self.is_judged());
        let unit = self.target().unit * estimate.mean.log_scale.exp();
        let w = &mut self.work;
        let evidence = w.log_evidence / w.plan.looks();
        let chosen = w.plan.chosen();
        // The mean of states that are scattered lies where none of them is.
        let seen = chosen.relative_to(self.parts.appearance.home());
        self.parts.appearance.see_more(image, &[estimate.mean], &[seen]);
        self.parts.appearance.perceive(&estimate.mean, seen, &mut w.percept);
        let (distance, colour) = (w.percept.distance, w.percept.colour);
        let distractor = if judged { self.look_around(image, &estimate.mean) } else { None };
        let (evidence, distractor) = self.in_the_long_term(estimate, evidence, distractor);
        // As much as looks at the target count for.
        let distractor = distractor.map(|fit| self.visible * fit);
        let consistency = match judged {
            true => self.parts.monitor.consistency.judge(evidence, &self.work.log_posterior, reference),
            false => self.parts.monitor.consistency.last(),
        };
        let elsewhere = if judged { self.was_elsewhere(estimate) } else { 0.0 };
        self.work.percept.gaze = chosen;
        FrameEvidence {
            consistency,
            evidence,
            reference,
            distractor,
            spread: spread(&estimate.covariance, unit),
            distance,
            colour,
            elsewhere,
            agreement: self.agreement(image, estimate),
            absent: self.absent(image, estimate),
            estimate: estimate.mean,
            unit,
            alarm: self.parts.recognition.as_ref().map_or(0.0, Recognition::alarm),
        }
    }

    /// Evidence and the likelihood of the best distractor, without what was learned for now: that may not vouch for itself.
    fn in_the_long_term(&mut self, estimate: &Estimate, evidence: f64, distractor: Option<f64>) -> (f64, Option<f64>) {
        let (judged, reference, visible) = (self.is_judged(), self.reference(), self.visible);
        let (parts, w) = (&mut self.parts, &mut self.work);
        let Some(for_now) = parts.monitor.for_now.as_mut().filter(|_| judged) else { return (evidence, distractor) };
        w.drawn.clear();
        w.drawn.push(estimate.mean);
        if distractor.is_some() {
            w.drawn.extend(&w.distractors);
        }
        w.scores.resize(w.drawn.len(), 0.0);
        if !parts.appearance.long_term_log_likelihood(&w.drawn, &mut w.scores) {
            for_now.consistency.follow(&parts.monitor.consistency);
            return (evidence, distractor);
        }
        for_now.consistency.judge(evidence, &w.log_posterior, reference);
        let mut here = [0.0];
        parts.appearance.log_likelihood(&[estimate.mean], Gaze::CENTRE, &mut here);
        let best = w.scores[1..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (evidence + visible * (w.scores[0] - here[0]), distractor.map(|_| best))
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
    pub(super) fn remember(&mut self, state: &State) {
        let extent = self.target().extent;
        let (monitor, features) = (&mut self.parts.monitor, &mut self.work.features);
        if let (Some(surroundings), Some(around)) = (&mut monitor.surroundings, &monitor.distractors)
            && self.parts.appearance.width() > 0
        {
            self.parts.appearance.features(around.last(), features);
            surroundings.remember(state, extent, around.last(), features);
        }
    }

    /// Learns what tells the target from what is around it, while the evidence is consistent with its being there.
    pub(super) fn adapt(&mut self, image: &Image, estimate: &Estimate) {
        let (judged, extent) = (self.is_judged(), self.target().extent);
        let (parts, w) = (&mut self.parts, &mut self.work);
        let (monitor, lost) = (&parts.monitor, self.context.lost);
        let learns = monitor.consistency.learns(self.frame, lost) && !monitor.loss.is_doubted();
        let for_now =
            |it: &ForNow| it.consistency.learns(self.frame, false) && it.consistency.last().frame_deficit <= it.gate;
        let lesson = Lesson {
            deficit: learns.then(|| monitor.consistency.last().frame_deficit),
            for_now: !lost && monitor.for_now.as_ref().is_some_and(for_now),
        };
        if !(judged && (learns || lesson.for_now) && parts.appearance.adapts()) {
            return;
        }
        if parts.monitor.distractors.is_none() {
            distractors(&w.predicted, &w.log_posterior, &estimate.mean, extent, &mut w.distractors);
        }
        parts.appearance.adapt(image, &estimate.mean, &w.distractors, lesson);
    }

    /// Whether enough of the target is in view for its evidence to say that it is lost.
    pub(super) fn is_judged(&self) -> bool {
        let least = if self.meets_another() { LEAST_JUDGED_BESIDE } else { LEAST_JUDGED };
        self.visible >= least && !self.is_contested()
    }

    /// Whether another target may be what is seen where this one is expected.
    pub fn is_contested(&self) -> bool {
        self.exclusion.share(&self.work.expected) < OWN_PLACE
    }

    /// Whether another target claims places that this one may be at.
    pub fn meets_another(&self) -> bool {
        !self.exclusion.is_empty()
    }
}

/// Standard deviation of place in template units; a million stands for what is not finite.
fn spread(covariance: &[[f64; 6]; 6], unit: f64) -> f64 {
    ((0.5 * (covariance[0][0] + covariance[1][1])).sqrt() / unit).min(1e6)
}
