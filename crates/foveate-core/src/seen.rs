//! The result of one frame for one target: its box, its confidence, and views of the frame's intermediate quantities.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::control::{Belief, Consistency, Cues, PlaceEvidence, Status};
use crate::gaze::{Plan, PolicySnapshot};
use crate::geometry::{BBox, Covariance, Extent, Gaze, State};
use crate::identity::Percept;
use crate::identity::accumulate::likeliest;
use crate::scene::{Detection, Image};

/// The phase in the life of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Phase {
    /// Its box was given or detected in this frame, and the picture there is its template.
    Initiated,
    /// It was re-identified after its termination, and has its old id again.
    ReIdentified,
    /// It is tracked, and its box is a result.
    Tracked,
    /// Another target occludes most of it: its motion predicts the box, which is a result.
    Occluded,
    /// The box is a guess: the target is probably lost, or another target has occluded it for more than a second of video.
    Lost,
}

impl Phase {
    /// Returns the name in files and pictures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Initiated => "initiated",
            Self::ReIdentified => "re-identified",
            Self::Tracked => "tracked",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
        }
    }

    /// Returns the phase of the only target of a tracker in a frame with this status.
    pub(crate) fn of(status: Status) -> Self {
        if status.is_usable() { Self::Tracked } else { Self::Lost }
    }

    /// Returns the status of a target in this phase.
    fn status(self) -> Status {
        match self {
            Self::Initiated | Self::Tracked | Self::Occluded => Status::Tracking,
            Self::ReIdentified => Status::Reacquired,
            Self::Lost => Status::Lost,
        }
    }
}

/// One target in one frame.
///
/// The fields up to `values` are plain data. The others are views of the tracker's buffers, which the next frame overwrites: copy what
/// you keep, or call [`Seen::without_views`]. The views are empty in a frame whose box was given, and for the targets of a
/// [`MultiTracker`](crate::MultiTracker).
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct Seen<'a> {
    /// The number of the target: 1, 2, ... in order of initiation, or as given; 1 for a tracker of one target.
    pub id: u64,
    /// The picture in which the target was first given or detected, counted in updates from 0; 0 for a tracker of one target.
    pub born: usize,
    /// The phase in the life of the target.
    pub phase: Phase,
    /// The upright box; left and top from 0, pixels.
    pub bbox: BBox,
    /// The status, which follows from `p_lost` for one target and from `phase` for one of many.
    pub status: Status,
    /// The probability, 0 to 1, that the box is not on the target (IoU below 0.1) or that the target is not visible.
    pub p_lost: f64,
    /// Mean of the belief, corrected by the box regression if there is one: centre, velocity per frame, log scale relative to the first
    /// frame, angle.
    pub state: State,
    /// Covariance over x, y, vx, vy, log scale, angle, log aspect: that of the belief; with box regression plus the squares of its expected
    /// errors of size and shape; of place by [`Localisation`](crate::control::Localisation).
    pub covariance: Covariance,
    /// Half the size of the target's box at scale 1, pixels: `state.fixate(gaze, extent)` is the place of a gaze.
    pub extent: Extent,
    /// The chosen gaze, template units.
    pub gaze: Gaze,
    /// The fraction of the target that is not occluded, 0 to 1.
    pub visible: f64,
    /// How the evidence compares with the reference.
    pub consistency: Consistency,
    /// Frames since the target was last looked at; 0 if it was in this frame.
    pub waited: usize,
    /// The detection of this frame that was assigned to the target or started it.
    pub detection: Option<Detection>,
    /// The index of `detection` among those passed to [`MultiTracker::update`](crate::MultiTracker::update), from 0; `None` if the
    /// configuration's own detector found it.
    pub detection_index: Option<usize>,
    /// The class of the last detection that had one.
    pub detected_class: Option<usize>,
    /// The most likely class over all frames so far and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
    /// P(lost) without the second tracker, which decides when to search and what to learn.
    pub own_p_lost: f64,
    /// The evidence from which P(lost) follows.
    pub cues: Cues,
    /// Effective sample size 1/Σw², 1 to N; 0 without views.
    pub ess: f64,
    /// log Σ w̃, nats, up to the likelihood's constant; NaN without views.
    pub log_evidence: f64,
    /// The inputs of the covariance of the place.
    pub place: PlaceEvidence,
    /// Width, height and planes of the picture.
    pub shape: [usize; 3],
    /// Values read from the picture: pixels times planes, each once. With a sensor: all bins and tiles that it read, with overlaps. Looks
    /// recorded for observers do not count.
    pub values: usize,
    /// The picture that the tracker used: with a sensor, the parts that it read, painted in place.
    pub picture: Option<&'a Image>,
    /// The detections that the tracker used in this frame.
    pub detections: &'a [Detection],
    /// x̃ₜ: the predicted particles.
    pub particles: &'a [State],
    /// wₜ: the weights of the particles; they sum to 1.
    pub weights: &'a [f64],
    /// For each particle of the next frame, the index of its parent in this one.
    pub ancestors: &'a [usize],
    /// The gazes that were scored, and those that were used.
    pub plan: &'a Plan,
    /// The reward of each gaze of the plan.
    pub rewards: &'a [f64],
    /// The reward of each gaze that the plan records for observers.
    pub recorded: &'a [f64],
    /// The log evidence of each gaze of the plan.
    pub gaze_evidence: &'a [f64],
    /// The glimpse at the estimate.
    pub percept: &'a Percept,
    /// p(c | all frames so far), one for each class; empty without a recogniser.
    pub classes: &'a [f64],
    /// The names of the classes; empty if they have numbers only.
    pub class_names: &'a [String],
    /// p(c | the last few looks): the decision of this frame alone.
    pub own_classes: &'a [f64],
    /// The gazes of the recogniser.
    pub recognition_gazes: &'a [Gaze],
    /// The learned state of the policy.
    pub snapshot: PolicySnapshot<'a>,
}

/// Degrees of freedom of the errors of place, as a bivariate Student distribution: more of them are large than in a normal one. By halves,
/// 2.5 and 2.7 fit 159 targets best.
const FREEDOM: f64 = 2.5;

/// Returns the squared Mahalanobis distance within which this share (0 to below 1) of the errors of place lies, by the reported covariance.
/// Every credible region takes its size from here. At 90 % it is that of a normal distribution, −2 ln 0.1: the covariance of a Student
/// distribution itself is that of its farthest errors.
pub fn credible(share: f64) -> f64 {
    stretch() * student(share)
}

/// Returns the squared radius that contains a share of a bivariate Student distribution of scale 1.
fn student(share: f64) -> f64 {
    FREEDOM * ((1.0 - share).powf(-2.0 / FREEDOM) - 1.0)
}

/// Returns the squared scale of the errors, relative to the reported covariance.
fn stretch() -> f64 {
    -2.0 * 0.1_f64.ln() / student(0.9)
}

/// The empty plan and glimpse of a frame without views.
static NO_PLAN: Plan = Plan::new();
static NO_LOOK: Percept =
    Percept { gaze: Gaze::CENTRE, glimpse: Vec::new(), features: Vec::new(), distance: 0.0, colour: 0.0 };

/// An ellipse on the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Centre, pixels.
    pub x: f64,
    /// Centre, pixels.
    pub y: f64,
    /// Half axes, the longer one first, pixels.
    pub half: [f64; 2],
    /// Direction of the longer half axis, radians from x towards y.
    pub turn: f64,
}

impl Seen<'static> {
    /// Creates the result of a frame in which the target's box was given, in a picture of this width, height and number of planes: nothing
    /// was estimated.
    pub fn given(shape: [usize; 3], bbox: &BBox) -> Self {
        Self {
            id: 1,
            born: 0,
            phase: Phase::Initiated,
            bbox: *bbox,
            status: Status::Tracking,
            p_lost: 0.0,
            state: State::of(bbox),
            covariance: Covariance::default(),
            extent: Extent::of(bbox),
            gaze: Gaze::CENTRE,
            visible: 1.0,
            consistency: Consistency::default(),
            waited: 0,
            detection: None,
            detection_index: None,
            detected_class: None,
            class: None,
            own_p_lost: 0.0,
            cues: Cues::default(),
            ess: 0.0,
            log_evidence: f64::NAN,
            place: PlaceEvidence::default(),
            shape,
            values: 0,
            picture: None,
            detections: &[],
            particles: &[],
            weights: &[],
            ancestors: &[],
            plan: &NO_PLAN,
            rewards: &[],
            recorded: &[],
            gaze_evidence: &[],
            percept: &NO_LOOK,
            classes: &[],
            class_names: &[],
            own_classes: &[],
            recognition_gazes: &[],
            snapshot: PolicySnapshot::Blank,
        }
    }
}

impl<'a> Seen<'a> {
    /// Returns the plain data alone, to keep.
    pub fn without_views(&self) -> Seen<'static> {
        let Self {
            id, born, phase, bbox, status, p_lost, state, covariance, extent, gaze, visible, consistency, ..
        } = *self;
        let Self { waited, detection, detection_index, detected_class, class, shape, .. } = *self;
        let Self { own_p_lost, cues, ess, log_evidence, place, values, .. } = *self;
        let given = Seen::given(shape, &bbox);
        let life = Seen { id, born, phase, waited, detection, detection_index, detected_class, class, ..given };
        let belief = Seen { state, covariance, extent, gaze, visible, consistency, ess, log_evidence, ..life };
        Seen { status, p_lost, own_p_lost, cues, place, values, ..belief }
    }
    /// Returns the same target in another phase, with the status that follows from it.
    #[must_use]
    pub fn in_phase(self, phase: Phase) -> Self {
        Self { phase, status: phase.status(), ..self }
    }
    /// Returns whether the box was given or detected in this frame, not tracked.
    pub fn is_given(&self) -> bool {
        self.phase == Phase::Initiated
    }
    /// Returns the covariance of the centre (xx, xy, yy), px²; `None` if the box was given.
    pub fn centre_covariance(&self) -> Option<[f64; 3]> {
        let [[xx, xy, ..], [_, yy, ..], ..] = self.covariance;
        (!self.is_given()).then_some([xx, xy, yy])
    }
    /// Returns the values read as a fraction of those of the picture: 0 to 1, or more with a sensor that reads places twice.
    pub fn share_read(&self) -> f64 {
        self.values as f64 / self.shape.iter().product::<usize>() as f64
    }
    /// Returns the pixels per template unit at the estimate's size.
    pub fn unit(&self) -> f64 {
        self.extent.mean() * self.state.log_scale.exp()
    }
    /// Returns the credible region of the target's centre that contains this share (0 to below 1) of the probability: an ellipse of the
    /// covariance, of the size that [`credible`] gives.
    pub fn region(&self, share: f64) -> Region {
        let ([[a, b, ..], [_, d, ..], ..], size) = (self.covariance, credible(share));
        let (middle, apart) = (0.5 * (a + d), (0.5 * (a - d)).hypot(b));
        let half = [middle + apart, middle - apart].map(|v| (size * v).max(0.0).sqrt());
        Region { x: self.state.x, y: self.state.y, half, turn: 0.5 * (2.0 * b).atan2(a - d) }
    }
    /// Returns the weighted sample.
    pub fn belief(&self) -> Belief<'a> {
        Belief { states: self.particles, weights: self.weights }
    }
    /// Returns the reward of a gaze; `None` if it was neither scored nor recorded.
    pub fn reward_of(&self, gaze: Gaze) -> Option<f64> {
        let of = |gazes: &[Gaze], rewards: &[f64]| {
            gazes.iter().position(|g| (g.u, g.v) == (gaze.u, gaze.v)).map(|k| rewards[k])
        };
        of(self.plan.gazes(), self.rewards).or_else(|| of(self.plan.recorded(), self.recorded))
    }
    /// Returns whether the box is a result: the status is tracking or reacquired. Otherwise the box is a guess.
    pub fn is_usable(&self) -> bool {
        self.status.is_usable()
    }
    /// Returns whether the status is lost. An occluded target is not lost: see [`Seen::is_usable`].
    pub fn is_lost(&self) -> bool {
        self.status.is_lost()
    }
    /// Returns the name of a class, or its number if it has none.
    pub fn class_name(&self, class: usize) -> Cow<'a, str> {
        self.class_names.get(class).map_or_else(|| class.to_string().into(), |name| name.as_str().into())
    }
    /// Returns the most likely class by the decision of this frame alone, and its probability.
    pub fn own_class(&self) -> Option<(usize, f64)> {
        best(self.own_classes)
    }
}

/// Returns the most likely class and its probability.
pub(crate) fn best(probabilities: &[f64]) -> Option<(usize, f64)> {
    let class = likeliest(probabilities);
    probabilities.get(class).map(|p| (class, *p))
}

/// Compares the plain data.
impl PartialEq for Seen<'_> {
    fn eq(&self, other: &Self) -> bool {
        let life =
            |s: &Self| (s.id, s.born, s.phase, s.status, s.waited, s.detection, s.detection_index, s.detected_class);
        let belief = |s: &Self| (s.bbox, s.state, s.covariance, s.extent, s.gaze, s.visible, s.consistency, s.class);
        (life(self), belief(self), self.p_lost) == (life(other), belief(other), other.p_lost)
    }
}

impl fmt::Debug for Seen<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { id, phase, bbox, status, p_lost, state, visible, detection, class, .. } = self;
        let mut seen = f.debug_struct("Seen");
        seen.field("id", id).field("phase", phase).field("bbox", bbox).field("status", status).field("p_lost", p_lost);
        seen.field("state", state).field("visible", visible).field("detection", detection).field("class", class);
        seen.finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_and_statuses_agree_on_results() {
        let given = Seen::given([40, 30, 3], &BBox::new(4.0, 6.0, 10.0, 12.0));
        assert!(given.is_given() && given.is_usable() && given.share_read() == 0.0 && given.weights.is_empty());
        let usable = |phase| given.in_phase(phase).is_usable();
        let all = [Phase::Initiated, Phase::ReIdentified, Phase::Tracked, Phase::Occluded, Phase::Lost];
        assert_eq!(all.map(usable), [true, true, true, true, false]);
        for status in [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired] {
            assert_eq!(usable(Phase::of(status)), status.is_usable(), "{status:?}");
        }
    }

    /// The share that the region promises, by integrating the density over rings.
    #[test]
    fn regions_have_their_share_of_the_density() {
        let log_density = |squares: f64| -(0.5 * FREEDOM + 1.0) * (squares / (stretch() * FREEDOM)).ln_1p();
        let ring = |r: f64| r * log_density(r * r).exp();
        let (step, within) = (1e-3, |most: f64| (0..).map(|i| (i as f64 + 0.5) * 1e-3).take_while(move |r| *r < most));
        let all: f64 = within(200.0).map(|r| ring(r) * step).sum();
        assert!((credible(0.9) - 4.605).abs() < 1e-3, "that of a normal distribution");
        for share in [0.1, 0.5, 0.9, 0.99] {
            let part: f64 = within(credible(share).sqrt()).map(|r| ring(r) * step).sum();
            assert!((part / all - share).abs() < 1e-3, "{share}: {}", part / all);
        }
    }

    #[test]
    fn without_views_the_plain_data_stay() {
        let weights = [0.25, 0.75];
        let mut seen = Seen::given([40, 30, 3], &BBox::new(4.0, 6.0, 10.0, 12.0)).in_phase(Phase::Tracked);
        (seen.id, seen.p_lost, seen.own_p_lost, seen.ess, seen.values) = (3, 0.25, 0.5, 1.5, 1800);
        let kept = Seen { weights: &weights, ..seen }.without_views();
        assert!(kept == seen && kept.weights.is_empty());
        assert_eq!((kept.own_p_lost, kept.ess, kept.share_read()), (0.5, 1.5, 0.5));
    }
}
