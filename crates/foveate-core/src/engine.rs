//! Algorithm 1 of Denil et al. (2012): particle filtering with gaze control, one frame at a time.
//!
//! [`Engine::step`] is the paper's loop. Each verb of it is one function: `predict` and `select` in `engine/filter.rs`,
//! `choose`, `weigh`, `learn`, `record` and `settle` in `engine/gaze.rs`, `redetect` and `search_around` in `engine/redetect.rs`, `monitor` and `adapt` in
//! `engine/monitor.rs`, `regress` in `engine/regress.rs`. What belongs together is kept together: [`Filter`], [`GazeControl`], [`Monitor`].

mod exclusion;
mod filter;
mod gaze;
mod monitor;
mod redetect;
mod regress;
mod saved;
mod second_opinion;
mod template;

pub(crate) use exclusion::Claim;
pub use filter::Filter;
pub use gaze::GazeControl;
pub use monitor::Monitor;

use exclusion::Exclusion;

use crate::control::{Belief, TrackConfidence};
use crate::gaze::{Context, Plan};
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::identity::box_regression::{Answer, BoxRegression};
use crate::identity::{self, Appearance, Percept};
use crate::recognition::{Recognition, Recognized};
use crate::reference::ReferenceLikelihood;
use crate::scene::{Image, Meter, Scene};
use crate::seen::{Phase, Seen, best};
use foveate_base::rng::Purpose::Recognize;
use foveate_base::rng::Streams;
use serde::{Deserialize, Serialize};

/// The replaceable parts of a tracker, grouped as the paper is.
#[non_exhaustive]
pub struct Parts {
    /// WHERE is it? Prediction, selection, the search for a lost target.
    pub filter: Filter,
    /// WHERE TO LOOK? The policy and its reward.
    pub gaze: GazeControl,
    /// WHAT is it? p(hₜ | xₜ, aₜ).
    pub appearance: Box<dyn Appearance>,
    /// Is it lost?
    pub monitor: Monitor,
    /// p(cₜ | all looks at the estimate): what the target is called. It never changes the track, unless it has an alarm.
    pub recognition: Option<Recognition>,
    /// Where the target's borders are, told of the box at the estimate.
    pub box_regression: Option<BoxRegression>,
    /// A tracker whose box is compared with this one's.
    pub second_opinion: Option<Box<Parts>>,
}

impl Parts {
    /// These parts, without a recogniser, box regression and a second opinion.
    pub fn new(filter: Filter, gaze: GazeControl, appearance: Box<dyn Appearance>, monitor: Monitor) -> Self {
        Self { filter, gaze, appearance, monitor, recognition: None, box_regression: None, second_opinion: None }
    }
    /// The same, with a recogniser.
    pub fn recognising(self, recognition: Option<Recognition>) -> Self {
        Self { recognition, ..self }
    }
    /// The same, telling boxes that this has moved.
    pub fn regressing(self, box_regression: Option<BoxRegression>) -> Self {
        Self { box_regression, ..self }
    }
    /// The same, with a tracker of these parts beside it, whose box is compared with this one's.
    pub fn seconded(self, second_opinion: Option<Self>) -> Self {
        Self { second_opinion: second_opinion.map(Box::new), ..self }
    }
}

/// What the number of a target is changed by for its second opinion, which shares no draw with it.
const SECOND: u64 = 1 << 63;

/// One target being followed.
pub(crate) struct Engine {
    parts: Parts,
    /// Of the second opinion's parts.
    second: Option<Box<Engine>>,
    streams: Streams,
    target: Option<Target>,
    /// Steps since the target was given.
    frame: u64,
    /// What the policy is told: how the last frame ended.
    context: Context,
    /// Share of the target that nothing else covers, 0 to 1.
    visible: f64,
    /// Whose the places of this frame are.
    exclusion: Exclusion,
    work: Work,
}

/// What was given to follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Target {
    state: State,
    /// Half the size of its box at scale 1.
    extent: Extent,
    /// Pixels per template unit at scale 1.
    unit: f64,
}

/// What is believed after a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    /// Mean of the belief.
    pub mean: State,
    /// Its covariance over x, y, vx, vy, log scale, angle.
    pub covariance: [[f64; 6]; 6],
    /// Effective sample size, 1 to N.
    pub ess: f64,
}

/// What one step computes, in buffers that are grown once.
#[derive(Default)]
pub(crate) struct Work {
    /// x̃: the predicted particles.
    pub predicted: Vec<State>,
    /// Their mean.
    pub expected: State,
    /// log wₜ₋₁ p/q and the detection likelihood, and what was added to it for the sum of the weights to stay.
    pub log_prior: Vec<f64>,
    pub detected: f64,
    pub plan: Plan,
    /// Its gazes as the appearance has them: from the one it has settled on.
    pub gazes: Vec<Gaze>,
    /// A row of N a gaze of the plan.
    pub log_likelihood: Vec<f64>,
    pub log_posterior: Vec<f64>,
    pub weights: Vec<f64>,
    pub log_evidence: f64,
    pub gaze_evidence: Vec<f64>,
    pub rewards: Vec<f64>,
    pub recorded: Vec<f64>,
    pub ancestors: Vec<usize>,
    pub percept: Percept,
    pub redetected: Vec<usize>,
    pub drawn: Vec<State>,
    pub scores: Vec<f64>,
    pub distractors: Vec<State>,
    /// Where it was looked for distractors in this frame, and the log-likelihood of the best.
    pub around: Option<(State, f64)>,
    /// What the box regression said of the estimate, where it was asked already.
    pub answer: Option<Answer>,
    /// Of places, to be remembered or compared with those that are.
    pub features: Vec<f32>,
    /// What is told of the frame.
    pub told: Option<(Estimate, TrackConfidence)>,
    /// Pixels of the frame that were used.
    pub meter: Meter,
    pub pixels: usize,
}

/// What engines need only during a step: as many targets as threads are looked at at a time.
#[derive(Default)]
pub(crate) struct Buffers {
    work: Work,
    identity: identity::Buffers,
}

impl Engine {
    /// An engine of these parts, with its own streams of randomness named by `seed` and `target`.
    pub fn new(mut parts: Parts, seed: u64, target: u64) -> Self {
        let second = parts.second_opinion.take();
        Self {
            second: second.map(|parts| Box::new(Self::new(*parts, seed, target ^ SECOND))),
            parts,
            streams: Streams::new(seed, target),
            target: None,
            frame: 0,
            context: Context::default(),
            visible: 1.0,
            exclusion: Exclusion::default(),
            work: Work::default(),
        }
    }

    /// One frame of Algorithm 1. Panics before [`Engine::init`].
    pub fn step<'a>(&'a mut self, scene: Scene<'a>) -> Seen<'a> {
        self.aim(scene);
        self.look(scene)
    }

    /// The first half of a step: where the target is expected, and where to look. Of the picture it needs the size alone.
    pub fn aim(&mut self, scene: Scene<'_>) {
        self.frame += 1;
        self.predict(scene);
        self.expect();
        self.choose();
    }

    /// The second half, after [`Engine::aim`], with the picture: what was seen, and what follows.
    pub fn look<'a>(&'a mut self, scene: Scene<'a>) -> Seen<'a> {
        let image = scene.image;
        self.work.around = None;
        self.see(image);
        self.weigh();
        self.learn();
        self.redetect(scene);
        self.search_around(scene);
        let estimate = self.estimate();
        let confidence = self.monitor(image, &estimate);
        self.recognise(image, &estimate);
        self.adapt(image, &estimate);
        self.select(&estimate);
        let told = self.regress(image, &estimate);
        self.work.told = Some((told, confidence));
        self.measure();
        self.record(image);
        self.settle();
        self.report(scene)
    }

    /// Mean, covariance and effective sample size of the weighted particles.
    fn estimate(&mut self) -> Estimate {
        let belief = Belief { states: &self.work.predicted, weights: &self.work.weights };
        Estimate { mean: belief.mean(), covariance: belief.covariance(), ess: belief.ess() }
    }

    /// Looks at the estimate once more, to say what the target is called.
    fn recognise(&mut self, image: &Image, estimate: &Estimate) {
        let (extent, rng) = (self.target().extent, &mut self.streams.at(self.frame, Recognize).rng(0));
        if let Some(recognition) = &mut self.parts.recognition {
            recognition.look(image, &estimate.mean, extent, &self.context, rng);
        }
    }

    /// Counts what was used of the picture; what is recorded for observers is not in it.
    fn measure(&mut self) {
        let (parts, w) = (&mut self.parts, &mut self.work);
        w.meter.clear();
        parts.appearance.measure(&mut w.meter);
        parts.recognition.iter().for_each(|recognition| recognition.measure(&mut w.meter));
        parts.box_regression.iter_mut().for_each(|it| it.measure(&mut w.meter));
        self.second.iter().for_each(|second| w.meter.add_all(&second.work.meter));
        w.pixels = w.meter.pixels();
    }

    /// The box that was told of the last frame, and what was believed of the track. Panics before the first step.
    pub fn told(&self) -> (BBox, TrackConfidence) {
        let (estimate, confidence) = self.work.told.expect("a step was made");
        (estimate.mean.bbox(self.target().extent), confidence)
    }

    /// What was read of the last frame.
    pub fn meter(&self) -> &Meter {
        &self.work.meter
    }

    /// Everything that the last frame, which is `scene`, computed. Panics before the first step.
    pub fn report<'a>(&'a self, scene: Scene<'a>) -> Seen<'a> {
        let (parts, w) = (&self.parts, &self.work);
        let (estimate, confidence) = w.told.expect("a step was made");
        let recognized = parts.recognition.as_ref().map_or(Recognized::default(), Recognition::recognized);
        let extent = self.target().extent;
        let TrackConfidence { p_lost, own, status, cues } = confidence;
        Seen {
            phase: Phase::of(status),
            status,
            p_lost,
            state: estimate.mean,
            covariance: estimate.covariance,
            extent,
            gaze: w.plan.chosen(),
            visible: self.visible,
            consistency: parts.monitor.consistency(),
            class: best(recognized.classes),
            own_p_lost: own,
            cues,
            ess: estimate.ess,
            log_evidence: w.log_evidence,
            localisation_noise: parts.monitor.model().localisation_noise,
            values: w.pixels * scene.image.planes(),
            picture: Some(scene.image),
            detections: scene.detections,
            particles: &w.predicted,
            weights: &w.weights,
            ancestors: &w.ancestors,
            plan: &w.plan,
            rewards: &w.rewards,
            recorded: &w.recorded,
            gaze_evidence: &w.gaze_evidence,
            percept: &w.percept,
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

    fn reference(&self) -> ReferenceLikelihood {
        self.parts.appearance.reference()
    }

    /// Where the target is expected after [`Engine::aim`], and where to look.
    pub fn aimed(&self) -> (State, &Plan) {
        (self.work.expected, &self.work.plan)
    }

    /// The mean of the predicted particles.
    fn expect(&mut self) {
        let states = &self.work.predicted;
        let each = 1.0 / states.len() as f64;
        let sum = states.iter().fold([0.0; 6], |mut sum, s| {
            sum.iter_mut().zip(s.to_array()).for_each(|(sum, x)| *sum += each * x);
            sum
        });
        self.work.expected = State::from_array(sum);
    }

    /// Exchanges what it needs only during a step with `buffers`, which other engines may use between steps.
    pub fn exchange(&mut self, buffers: &mut Buffers) {
        std::mem::swap(&mut self.work, &mut buffers.work);
        self.parts.appearance.exchange(&mut buffers.identity);
    }

    /// Frees what is not needed until the next step.
    pub fn compact(&mut self) {
        self.parts.appearance.compact();
        self.parts.box_regression.iter_mut().for_each(BoxRegression::compact);
        self.second.iter_mut().for_each(|second| second.compact());
    }

    /// Whether there is a target: it was given, or the state of a tracker that had one was loaded.
    pub fn has_target(&self) -> bool {
        self.target.is_some()
    }

    /// Whether detections move or weigh its particles.
    pub fn uses_detections(&self) -> bool {
        self.parts.filter.uses_detections()
    }

    /// Whether it searches for the target: what it acts on, which is not the reported status.
    pub fn is_searching(&self) -> bool {
        self.parts.monitor.loss.is_searching()
    }

    /// Half the size of the target's box at scale 1, pixels; `None` before there is a target.
    pub fn extent(&self) -> Option<Extent> {
        self.target.map(|target| target.extent)
    }

    /// The parts, to look at.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }
}
