//! Is it lost? The evidence of a frame, and the updates of the models in trusted frames.

use super::distractors::Distractors;
use super::particles::Particles;
use super::target::Estimate;
use super::view::{Looks, View};
use crate::control::{
    ConfidenceModel, Consistency, ConsistencyMonitor, ConsistencySettings, DistractorSearch, DistractorSettings,
    FrameEvidence, LossMonitor, TrackConfidence, distractors,
};
use crate::gaze::Context;
use crate::geometry::{Covariance, Gaze, State};
use crate::identity::surroundings::Surroundings;
use crate::identity::{Lesson, Memory, Percept};

/// P(lost) below which a frame is confident, and the number of frames from one remembered frame to the next.
const CERTAIN: f64 = 0.05;
const REMEMBERED_EVERY: u64 = 8;

/// Monitors the evidence and computes P(lost) from it.
#[derive(Debug)]
pub struct Monitor {
    /// Compares the evidence with the reference.
    pub(super) consistency: ConsistencyMonitor,
    /// P(lost) and the status.
    pub(super) loss: LossMonitor,
    /// Searches for distractors around the target; `None` to take them from the particles alone.
    pub(super) distractors: Option<DistractorSearch>,
    /// Remembers the places around the target in confident frames; `None` to remember nothing.
    pub(super) surroundings: Option<Surroundings>,
}

/// The cues of other models than the appearance: see [`FrameEvidence`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OtherEvidence {
    pub agreement: Option<f64>,
    pub absent: Option<f64>,
    pub alarm: f64,
}

/// The verdict on a frame.
#[derive(Debug, Default)]
pub(super) struct Verdict {
    pub confidence: TrackConfidence,
    /// Whether the tracker searches for the target from now on.
    pub is_searching: bool,
    /// Whether the particles may follow the box regression.
    pub follows: bool,
    /// Whether the tracker was on another object: it has just lost the target, and everything learned since frame 1 is reset.
    pub is_misled: bool,
    /// How the models may learn the frame; `None` for no update.
    pub lesson: Option<Lesson>,
}

impl Verdict {
    /// Returns the context in which the policy plans the next frame.
    pub(super) fn context(&self, evidence: &FrameEvidence, belief: &Particles, estimate: &Estimate) -> Context {
        Context {
            ess: estimate.ess / belief.states.len() as f64,
            deficit: evidence.consistency.deficit.max(evidence.alarm),
            frame_deficit: evidence.consistency.frame_deficit,
            spread: evidence.spread,
            lost: self.is_searching,
        }
    }
}

impl Monitor {
    /// Creates a monitor with these settings and no history.
    pub fn new(consistency: ConsistencySettings, model: ConfidenceModel) -> Self {
        Self {
            consistency: ConsistencyMonitor::new(consistency),
            loss: LossMonitor::new(model),
            distractors: None,
            surroundings: None,
        }
    }
    /// Adds a search for distractors around the target in every frame, and a memory of the places around it.
    pub fn with_distractors(self, settings: Option<DistractorSettings>) -> Self {
        let remembering = settings.as_ref().filter(|settings| settings.remembered > 0);
        let surroundings = remembering.map(|settings| Surroundings::new(settings.remembered, settings.count()));
        Self { distractors: settings.map(DistractorSearch::new), surroundings, ..self }
    }
    /// Returns the fitted model of P(lost).
    pub fn model(&self) -> &ConfidenceModel {
        self.loss.model()
    }
    /// Returns how the last frame's evidence compares with the reference.
    pub(crate) fn consistency(&self) -> Consistency {
        self.consistency.last()
    }
    /// Resets the history for a new target.
    pub(super) fn reset(&mut self) {
        self.reset_consistency();
        self.loss.reset();
    }
    /// Drops the evidence of past frames and its usual values, because the template has changed.
    pub(super) fn forget_evidence(&mut self) {
        self.reset_consistency();
        self.loss.forget_usual();
    }
    /// Drops the evidence of the last frames.
    pub(super) fn reset_consistency(&mut self) {
        self.consistency.reset();
    }

    /// Returns the target in the last confident frame if it is lost: its size does not change during a search.
    pub(super) fn held_size(&self, context: &Context) -> Option<&State> {
        self.loss.seen().filter(|_| context.lost)
    }

    /// Returns whether the first of two places looks more like the surroundings of the target in remembered frames than the second does.
    pub(super) fn was_beside(&mut self, view: &mut View<'_>, places: [State; 2]) -> bool {
        let Some(surroundings) = &mut self.surroundings else { return false };
        let features = &mut view.scratch.features;
        view.appearance.features(&places, features);
        let (first, second) = features.split_at(features.len() / 2);
        surroundings.elsewhere(first) > surroundings.elsewhere(second)
    }

    /// Returns the evidence at the estimate. If the frame is not judged, nothing is compared with past frames.
    pub(super) fn evidence(
        &mut self,
        view: &mut View<'_>,
        belief: &Particles,
        looks: &Looks,
        estimate: &Estimate,
        (percept, around): (&Percept, &Distractors),
        OtherEvidence { agreement, absent, alarm }: OtherEvidence,
    ) -> FrameEvidence {
        let reference = view.target.reference;
        let unit = view.target.unit * estimate.mean.log_scale.exp();
        let evidence = belief.log_evidence / looks.count();
        let (w, h) = estimate.mean.half(view.target.extent);
        let away = (estimate.mean.x - belief.expected.x, estimate.mean.y - belief.expected.y);
        let (mut distractor, mut consistency, mut elsewhere) = (None, self.consistency.last(), 0.0);
        if view.is_judged {
            // Scaled by the visible fraction, as the log-likelihood of the target is.
            distractor = around.best.map(|best| view.visibility.fraction() * best);
            consistency = self.consistency.judge(evidence, &belief.log_weights, reference);
            elsewhere = self.was_elsewhere(view, &estimate.mean, percept);
        }
        FrameEvidence {
            consistency,
            evidence,
            reference,
            distractor,
            spread: spread(&estimate.covariance, unit),
            distance: percept.distance,
            colour: percept.colour,
            elsewhere,
            innovation: (away.0 / w).hypot(away.1 / h) / (1 + belief.dropped) as f64,
            agreement,
            absent,
            estimate: estimate.mean,
            unit,
            alarm,
            search: around.search,
        }
    }

    /// Returns how much more the estimate looks like the surroundings of the target in remembered frames than like the target, −2 to 2.
    fn was_elsewhere(&mut self, view: &mut View<'_>, estimate: &State, percept: &Percept) -> f64 {
        let Some(surroundings) = &mut self.surroundings else { return 0.0 };
        if percept.gaze.relative_to(view.appearance.committed_gaze()) == Gaze::CENTRE {
            return surroundings.elsewhere(&percept.features);
        }
        view.appearance.features(&[*estimate], &mut view.scratch.features);
        surroundings.elsewhere(&view.scratch.features)
    }

    /// Computes P(lost) and the status of frame `t`, and what follows from them. If the frame is not judged, P(lost) does not change, and
    /// nothing is learned.
    pub(super) fn judge(&mut self, is_judged: bool, evidence: &FrameEvidence, (was_lost, t): (bool, u64)) -> Verdict {
        let confidence = if is_judged { self.loss.judge(evidence) } else { self.loss.hold(evidence.search) };
        let is_searching = self.loss.is_searching();
        let is_misled = is_searching && !was_lost && self.loss.is_misled();
        let learns = is_judged && self.consistency.learns(t, is_searching) && !self.loss.is_doubted();
        let lesson = learns.then_some(Lesson { deficit: evidence.consistency.frame_deficit });
        Verdict { confidence, is_searching, follows: is_judged && self.loss.follows(), is_misled, lesson }
    }

    /// Resets the discriminant and the colour model to frame 1, and drops the surroundings of the target.
    pub(super) fn forget_learned(&mut self, memory: Option<&mut dyn Memory>) {
        if let Some(memory) = memory {
            memory.forget();
        }
        if let Some(surroundings) = &mut self.surroundings {
            surroundings.clear();
        }
    }

    /// Remembers the places of the last search for distractors, with the target at `state`.
    pub(super) fn remember(&mut self, view: &mut View<'_>, state: &State) {
        if let (Some(surroundings), Some(around)) = (&mut self.surroundings, &self.distractors)
            && view.appearance.width() > 0
        {
            let features = &mut view.scratch.features;
            view.appearance.features(around.last(), features);
            surroundings.remember(state, view.target.extent, around.last(), features);
        }
    }

    /// Searches for distractors around the estimate, if the frame is judged and the result is not known yet.
    pub(super) fn search(&mut self, view: &mut View<'_>, estimate: &State, found: Distractors) -> Distractors {
        if !view.is_judged {
            return found;
        }
        found.search(self.distractors.as_mut(), view, estimate)
    }

    /// Resets the models if the tracker was misled, remembers the surroundings of the target if frame `t` is due, and trains the models if
    /// the verdict has a lesson: on the target at the estimate, and on the distractors around it or among the particles.
    pub(super) fn learn(
        &mut self,
        view: &mut View<'_>,
        belief: &Particles,
        estimate: &State,
        mut found: Distractors,
        (verdict, t): (&Verdict, u64),
    ) -> Distractors {
        if verdict.is_misled {
            // They were trained on another object.
            self.forget_learned(view.appearance.memory());
        }
        let is_certain = !verdict.is_searching && verdict.confidence.own < CERTAIN;
        if is_certain && view.is_judged && t.is_multiple_of(REMEMBERED_EVERY) {
            self.remember(view, estimate);
        }
        let Some(lesson) = verdict.lesson else { return found };
        let Some(memory) = view.appearance.memory() else { return found };
        if self.distractors.is_none() {
            distractors(&belief.states, &belief.log_weights, estimate, view.target.extent, &mut found.states);
        }
        memory.learn(view.scene.image, estimate, &found.states, lesson);
        found
    }

    /// Initialises the surroundings of the target, at `state` of its first frame: remembers the places there, and trains the models on
    /// those that look most like the target, each if the settings enable it. The places of earlier frames are dropped.
    pub(super) fn init_surroundings(&mut self, view: &mut View<'_>, state: &State) {
        let Some(around) = &mut self.distractors else { return };
        let first_frame = around.first_frame();
        if let Some(surroundings) = &mut self.surroundings {
            surroundings.clear();
            view.scratch.features.reserve(surroundings.places() * view.appearance.width());
        }
        if !first_frame && self.surroundings.is_none() {
            return;
        }
        let places = around.places(view.size(), state, view.target.extent);
        if places.is_empty() {
            return;
        }
        view.appearance.prepare(view.scene.image, places, &[Gaze::CENTRE]);
        let (extent, mut found) = (view.target.extent, vec![]);
        if first_frame {
            distractors(places, view.prepared_scores(places), state, extent, &mut found);
        }
        self.remember(view, state);
        if let Some(memory) = view.appearance.memory().filter(|_| first_frame) {
            memory.init_distractors(view.scene.image, state, &found);
        }
    }
}

/// Returns the standard deviation of the place in template units, or a million if it is not finite.
fn spread(covariance: &Covariance, unit: f64) -> f64 {
    ((0.5 * (covariance[0][0] + covariance[1][1])).sqrt() / unit).min(1e6)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{beside, estimate, evidence, look, weighed};
    use super::super::toy::{Learned, Toy, model, state};
    use super::*;

    fn learning() -> Toy {
        Toy { learned: Some(Learned::default()), ..Toy::at(50.0) }
    }

    /// The evidence of a frame with this deficit.
    fn with_deficit(monitor: &mut Monitor, deficit: f64) -> FrameEvidence {
        let shown = evidence(monitor);
        FrameEvidence { consistency: Consistency { deficit, frame_deficit: deficit, ..shown.consistency }, ..shown }
    }

    /// A place that was beside the target in a remembered frame is evidence of a loss, until the surroundings are dropped.
    #[test]
    fn remembered_surroundings_are_evidence() {
        let mut monitor = beside(true);
        let elsewhere = |monitor: &mut Monitor| {
            look(&mut Toy::at(70.0), 1.0, |view| {
                let (belief, looks) = weighed(view, &[70.0]);
                let percept = view.glimpse(&state(70.0), Gaze::CENTRE, Percept::default());
                let found = (&percept, &Distractors::default());
                monitor.evidence(view, &belief, &looks, &estimate(70.0), found, OtherEvidence::default()).elsewhere
            })
        };
        assert!(elsewhere(&mut monitor) > 0.0);
        monitor.forget_learned(None);
        assert_eq!(elsewhere(&mut monitor), 0.0);
    }

    /// P(lost) changes in judged frames only, and a mostly occluded target has no distractors.
    #[test]
    fn an_occluded_target_is_not_judged() {
        let mut monitor = beside(false);
        let good = evidence(&mut monitor);
        let before = monitor.judge(true, &good, (false, 1)).confidence.own;
        let bad = with_deficit(&mut monitor, 1.0);
        let held = monitor.judge(false, &bad, (false, 2));
        assert_eq!((held.confidence.own, held.lesson, held.follows), (before, None, false));
        assert!(monitor.loss.follows(), "only because it is not judged");
        assert!(monitor.judge(true, &bad, (false, 3)).confidence.own > before);
        for (fraction, searches) in [(1.0, true), (0.3, false)] {
            let found =
                look(&mut Toy::at(50.0), fraction, |view| monitor.search(view, &state(50.0), Distractors::default()));
            assert_eq!(found.best.is_some(), searches, "{fraction} visible");
        }
    }

    /// A judged frame trains on the places among the particles that look like the target, if there is no search around it.
    #[test]
    fn a_judged_frame_is_learned_with_distractors() {
        for (fraction, lessons) in [(1.0, vec![1]), (0.3, vec![])] {
            let (mut monitor, mut toy) = (Monitor::new(Default::default(), model()), learning());
            let shown = evidence(&mut monitor);
            look(&mut toy, fraction, |view| {
                let (mut belief, _) = weighed(view, &[50.0, 80.0]);
                belief.log_weights = vec![0.0; 2];
                let verdict = monitor.judge(view.is_judged, &shown, (false, 1));
                monitor.learn(view, &belief, &state(50.0), Distractors::default(), (&verdict, 1))
            });
            assert_eq!(toy.learned.expect("it learns").lessons, lessons, "{fraction} visible");
        }
    }

    /// The distractors of frame 1 are learned if the settings enable it.
    #[test]
    fn distractors_of_the_first_frame_are_learned() {
        for first_frame in [false, true] {
            let settings = DistractorSettings { reach: 2.0, step: 1.0, remembered: 2, first_frame };
            let mut monitor = Monitor::new(Default::default(), model()).with_distractors(Some(settings));
            let mut toy = learning();
            look(&mut toy, 1.0, |view| monitor.init_surroundings(view, &state(50.0)));
            assert_eq!(toy.learned.expect("it learns").lessons.len(), usize::from(first_frame));
        }
    }
}
