//! Algorithm 1 of Denil et al. (2012): particle filtering with gaze control, one frame at a time.
//!
//! [`Engine::step`] is the paper's loop. Each operation is one function that takes the data it reads and returns the data it makes:
//! `predict` and `select` in `engine/filter.rs`, `plan` and `rewards` in `engine/gaze.rs`, `log_likelihoods` in `engine/view.rs`, `weigh`
//! in `engine/particles.rs`, and beyond the paper `search` in `engine/search.rs` and `judge` and `learn` in `engine/monitor.rs`.

mod coast;
mod distractors;
mod extras;
mod filter;
mod first_box;
mod gaze;
mod monitor;
mod particles;
mod saved;
mod search;
mod second;
mod target;
mod template;
#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) mod toy;
mod view;
mod visibility;
mod waiting;

pub use filter::Filter;
pub use gaze::GazeControl;
pub use monitor::Monitor;
pub(crate) use visibility::Claim;

use distractors::Distractors;
use extras::Extras;
use monitor::OtherEvidence;
use particles::Particles;
pub(crate) use target::{Estimate, Target};
use view::{Looks, Scratch, View};
use visibility::Visibility;

use crate::control::{Leap, TrackConfidence};
use crate::gaze::{Context, Plan};
use crate::geometry::{BBox, Extent, State};
use crate::identity::box_regression::BoxRegression;
use crate::identity::{self, Appearance, Percept};
use crate::recognition::{Recognition, Recognized};
use crate::scene::{Meter, Scene, World};
use crate::seen::{Phase, Seen, best};
use foveate_base::Result;
use foveate_base::rng::Purpose::{Look, Recognize, Select};
use foveate_base::rng::Streams;

/// The replaceable parts of a tracker, grouped as in the paper.
#[non_exhaustive]
pub struct Parts {
    /// WHERE is it? Prediction, selection, and the search for a lost target.
    pub filter: Filter,
    /// WHERE TO LOOK? The policy and its reward.
    pub gaze: GazeControl,
    /// WHAT is it? p(hₜ | xₜ, aₜ).
    pub appearance: Box<dyn Appearance>,
    /// Is it lost?
    pub monitor: Monitor,
    extras: Extras,
    /// The parts of a second tracker; the overlap of the two boxes is a cue of P(lost).
    pub(crate) second: Option<Box<Self>>,
}

foveate_base::opaque_debug!(Parts);

impl Parts {
    /// Combines these parts, without a recogniser, box regression or second tracker.
    pub fn new(filter: Filter, gaze: GazeControl, appearance: Box<dyn Appearance>, monitor: Monitor) -> Self {
        Self { filter, gaze, appearance, monitor, extras: Extras::default(), second: None }
    }
    /// Sets the recogniser of the target's class. It never changes the track, unless it has an alarm.
    pub fn with_recognition(mut self, recognition: Option<Recognition>) -> Self {
        self.extras.recognition = recognition;
        self
    }
    /// Sets the box regression, which estimates the borders of the target from the box at the estimate.
    pub fn with_box_regression(mut self, box_regression: Option<BoxRegression>) -> Self {
        self.extras.box_regression = box_regression;
        self
    }
    /// Sets whether a first box that is too large shrinks to the part of it that moves as one. The reported box keeps its size.
    pub fn with_shrinking_first_box(mut self, shrinks: bool) -> Self {
        self.extras.shrinks_first_box = shrinks;
        self
    }
    /// Sets the parts of a second tracker; the overlap of the two boxes is a cue of P(lost). A second tracker has no second tracker itself.
    pub fn with_second_tracker(self, second: Option<Self>) -> Self {
        Self { second: second.map(Box::new), ..self }
    }
}

/// The filter of one target.
pub(crate) struct Engine {
    parts: Parts,
    streams: Streams,
    target: Option<Target>,
    /// Steps since the target was set.
    frame: u64,
    /// The state at the end of the last frame, for the policy.
    context: Context,
    visibility: Visibility,
    record: Record,
}

/// The results of one frame. Their buffers are allocated once.
#[derive(Default)]
struct Record {
    belief: Particles,
    plan: Plan,
    looks: Looks,
    /// The log evidence of each gaze of the plan, nats, and its reward.
    gaze_evidence: Vec<f64>,
    rewards: Vec<f64>,
    /// The reward of each gaze that the plan records.
    recorded: Vec<f64>,
    percept: Percept,
    found: Distractors,
    ancestors: Vec<usize>,
    /// The reported estimate and P(lost).
    reported: Option<(Estimate, TrackConfidence)>,
    /// The pixels of the picture that were read.
    meter: Meter,
    /// The number of values read: pixels times planes, or the values that a sensor read.
    values: usize,
    scratch: Scratch,
}

/// Buffers that an engine needs only during a step. At most as many are in use as there are threads.
#[derive(Default)]
pub(crate) struct Buffers {
    record: Record,
    identity: identity::Buffers,
}

impl Engine {
    /// Creates an engine of these parts, with random streams that are named by `seed` and `target`.
    pub(crate) fn new(parts: Parts, seed: u64, target: u64) -> Self {
        Self {
            parts,
            streams: Streams::new(seed, target),
            target: None,
            frame: 0,
            context: Context::default(),
            visibility: Visibility::default(),
            record: Record::default(),
        }
    }

    /// Runs one frame of Algorithm 1, and of the second tracker, which reads the same picture. Panics before [`Engine::init`].
    ///
    /// # Errors
    /// If a sensor cannot read its source. The caller must then set the target again.
    pub(crate) fn step<'a>(&'a mut self, world: World<'a, '_>, mut second: Option<&mut Self>) -> Result<Seen<'a>> {
        let (t, target, streams, mut last) = self.begin(&world, second.as_deref_mut());
        let Self { parts, context, visibility, .. } = self;
        let Parts { filter, gaze, appearance, monitor, extras, .. } = parts;
        // Importance sampling
        let held = monitor.held_size(context);
        let mut belief = filter.predict(world.scene(), target.extent, held, (streams, t), last.belief); // x̃ ~ q, log wₜ₋₁ p/q
        let plan = gaze.plan(context, streams.at(t, Look), last.plan); // k* ~ πₜ
        let (scene, values) = world.read(&belief.expected, target.extent, plan.gazes())?; // vₜ
        let mut view = View::new(&mut **appearance, scene, target, visibility, &belief.expected, &mut last.scratch);
        let looked = (plan.gazes(), plan.weights(), monitor.distractors.as_ref());
        let mut looks = view.log_likelihoods(&belief.states, looked, last.looks); // log p(h | x, a)
        let gaze_evidence = belief.weigh(&looks, last.gaze_evidence); // w̃ₜ
        // Gaze control
        let rewards = gaze.rewards(&belief, &looks, target.extent, last.rewards); // rₜ
        gaze.policy.learn(&plan, &rewards); // πₜ₊₁
        // Beyond the paper: search, judge, learn
        let found = filter.search(&mut view, &mut belief, &mut looks, monitor, (context.lost, streams, t), last.found);
        let estimate = belief.estimate();
        let percept = view.glimpse(&estimate.mean, plan.chosen(), last.percept);
        let found = monitor.search(&mut view, &estimate.mean, found);
        let agreement = second::agreement(second.as_deref_mut(), &view, &estimate);
        let answer = extras.ask(&view, &estimate, monitor.model(), context.lost);
        let others = OtherEvidence { agreement, absent: answer.map(|it| it.lost.into()), alarm: extras.alarm() };
        let evidence = monitor.evidence(&mut view, &belief, &looks, &estimate, (&percept, &found), others);
        let verdict = monitor.judge(view.is_judged, &evidence, (context.lost, t));
        *context = verdict.context(&evidence, &belief, &estimate);
        let found = monitor.learn(&mut view, &belief, &estimate.mean, found, (&verdict, t));
        extras.recognise(&view, &estimate, context, streams.at(t, Recognize));
        // Selection
        let ancestors = filter.select(&belief, &estimate, streams.at(t, Select), last.ancestors);
        // Report
        let (reported, change) = extras.regress(&view, &estimate, answer, verdict.follows);
        filter.reshape(change);
        second::follow(second.as_deref_mut(), &view, &estimate, &verdict, change);
        let reported = Some((reported, verdict.confidence));
        self.record =
            Record { belief, plan, looks, gaze_evidence, rewards, found, percept, ancestors, reported, ..last };
        Ok(self.finish(scene, values, second.as_deref()))
    }

    /// Runs one frame of Algorithm 1 on a picture in memory. Panics before [`Engine::init`].
    pub(crate) fn step_on<'a>(&'a mut self, scene: Scene<'a>) -> Seen<'a> {
        self.step(World::Picture(scene), None).expect("a picture in memory can be read")
    }

    /// Starts a frame: shrinks a first box that is too large. Returns the number of the frame, the target, the random streams, and the
    /// results of the last frame, whose buffers are used again.
    fn begin(&mut self, world: &World<'_, '_>, second: Option<&mut Self>) -> (u64, Target, Streams, Record) {
        if let World::Picture(scene) = world {
            self.shrink_first_box(scene.image, second);
        }
        self.frame += 1;
        let mut last = std::mem::take(&mut self.record);
        // Drops the reads since the last step, which were for observers and similarities.
        self.parts.appearance.measure(&mut last.meter);
        (self.frame, *self.target(), self.streams, last)
    }

    /// Ends a frame: counts the values read, scores the gazes that are recorded for observers, and commits to a gaze if the policy does.
    fn finish<'a>(&'a mut self, scene: Scene<'a>, values: Option<usize>, second: Option<&Self>) -> Seen<'a> {
        self.measure(scene.image.planes(), values, second);
        self.record_gazes(scene);
        self.commit_gaze();
        self.report(scene)
    }

    /// Counts the pixels that were read, each once; `values` is the number that a sensor read.
    fn measure(&mut self, planes: usize, values: Option<usize>, second: Option<&Self>) {
        let (parts, Record { meter, values: counted, .. }) = (&mut self.parts, &mut self.record);
        meter.clear();
        parts.appearance.measure(meter);
        parts.extras.measure(meter);
        if let Some(second) = second {
            meter.add_all(second.meter());
        }
        *counted = values.unwrap_or_else(|| meter.pixels() * planes);
    }

    /// Computes the rewards of the gazes that the plan records for observers, from the belief at the end of the frame. If a search drew
    /// particles again, this belief differs from the one that scored the planned gazes.
    fn record_gazes(&mut self, scene: Scene<'_>) {
        let (target, Record { belief, plan, looks, recorded, scratch, .. }) = (*self.target(), &mut self.record);
        recorded.clear();
        if plan.recorded().is_empty() {
            return;
        }
        let Parts { appearance, gaze, .. } = &mut self.parts;
        let mut view = View::new(&mut **appearance, scene, target, &self.visibility, &belief.expected, scratch);
        *looks = view.log_likelihoods(&belief.states, (plan.recorded(), &[], None), std::mem::take(looks));
        *recorded = gaze.rewards(belief, looks, target.extent, std::mem::take(recorded));
    }

    /// If the policy has committed to one gaze, the appearance takes it, and is trained again from frame 1 on if it was not trained for it.
    fn commit_gaze(&mut self) {
        let (streams, Parts { appearance, gaze, monitor, .. }) = (self.streams, &mut self.parts);
        let Some(gaze) = gaze.policy.committed_gaze() else { return };
        let committed = appearance.committed_gaze();
        if (gaze.u, gaze.v) == (committed.u, committed.v) {
            return;
        }
        let Some(reference) = appearance.commit_gaze(gaze, streams) else { return };
        self.target = self.target.map(|target| Target { reference, ..target });
        monitor.forget_evidence();
        let source = appearance.template_source().map(|it| (it.image.clone(), *it.state, it.origin));
        if let Some((image, state, (x, y))) = source {
            self.init_surroundings(&image, &State { x: state.x - x as f64, y: state.y - y as f64, ..state });
        }
    }

    /// Returns the reported box of the last frame and P(lost). Panics before the first step.
    pub(crate) fn reported(&self) -> (BBox, TrackConfidence) {
        let (estimate, confidence) = self.record.reported.expect("a step was made");
        (estimate.mean.bbox(self.target().drawn()), confidence)
    }

    /// Returns the pixels that were read in the last frame.
    pub(crate) fn meter(&self) -> &Meter {
        &self.record.meter
    }

    /// Returns the results of the last frame, which is `scene`. Panics before the first step.
    pub(crate) fn report<'a>(&'a self, scene: Scene<'a>) -> Seen<'a> {
        let (parts, last) = (&self.parts, &self.record);
        let (estimate, confidence) = last.reported.expect("a step was made");
        let recognized = parts.extras.recognition.as_ref().map_or(Recognized::default(), Recognition::recognized);
        let (tracked, extent) = (self.target().extent, self.target().drawn());
        let TrackConfidence { p_lost, own, status, cues } = confidence;
        let (model, place) = (parts.monitor.model(), parts.extras.evidence(&estimate, tracked));
        let mut covariance = estimate.covariance;
        model.localisation.apply(model.localisation_noise, &place, &mut covariance);
        Seen {
            phase: Phase::of(status),
            status,
            p_lost,
            state: estimate.mean,
            covariance,
            extent,
            gaze: last.plan.chosen(),
            visible: self.visibility.fraction(),
            consistency: parts.monitor.consistency(),
            class: best(recognized.classes),
            own_p_lost: own,
            cues,
            ess: estimate.ess,
            log_evidence: last.belief.log_evidence,
            place,
            values: last.values,
            picture: Some(scene.image),
            detections: scene.detections,
            particles: &last.belief.states,
            weights: &last.belief.weights,
            ancestors: &last.ancestors,
            plan: &last.plan,
            rewards: &last.rewards,
            recorded: &last.recorded,
            gaze_evidence: &last.gaze_evidence,
            percept: &last.percept,
            classes: recognized.classes,
            class_names: recognized.names,
            own_classes: recognized.own,
            recognition_gazes: recognized.gazes,
            snapshot: parts.gaze.policy.snapshot(),
            ..Seen::given(scene.image.shape(), &estimate.mean.bbox(extent))
        }
    }

    fn target(&self) -> &Target {
        self.target.as_ref().expect("a target is given before the first step")
    }

    /// Exchanges the buffers that the engine needs only during a step with `buffers`, which other engines may use between steps.
    pub(crate) fn exchange(&mut self, buffers: &mut Buffers) {
        std::mem::swap(&mut self.record, &mut buffers.record);
        self.parts.appearance.exchange(&mut buffers.identity);
    }

    /// Frees memory that is not needed until the next step.
    pub(crate) fn compact(&mut self) {
        self.parts.appearance.compact();
        self.parts.extras.compact();
    }

    /// Returns whether there is a target: `init` was called, or the state of a tracker with a target was loaded.
    pub(crate) fn has_target(&self) -> bool {
        self.target.is_some()
    }

    /// Returns whether another target may be visible at the place where this one was expected in the last frame.
    pub(crate) fn is_contested(&self) -> bool {
        self.visibility.is_contested(&self.record.belief.expected)
    }

    /// Returns whether another target claims places where this one may be.
    pub(crate) fn meets_another(&self) -> bool {
        self.visibility.meets_another()
    }

    /// Returns whether detections move or weigh the particles.
    pub(crate) fn uses_detections(&self) -> bool {
        self.parts.filter.uses_detections()
    }

    /// Returns the mean and covariance of several frames of motion; `None` without a closed form.
    pub(crate) fn moments(&self, frames: usize) -> Option<Leap> {
        self.parts.filter.proposal.moments(frames)
    }

    /// Returns whether the engine searches for the target. The search follows its own P(lost), not the reported status.
    pub(crate) fn is_searching(&self) -> bool {
        self.parts.monitor.loss.is_searching()
    }

    /// Returns half the size of the reported box at scale 1, pixels; `None` before there is a target.
    pub(crate) fn extent(&self) -> Option<Extent> {
        self.target.as_ref().map(Target::drawn)
    }

    /// Returns the parts.
    pub(crate) fn parts(&self) -> &Parts {
        &self.parts
    }
}
