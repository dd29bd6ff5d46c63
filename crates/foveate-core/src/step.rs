//! Everything one frame computed, by reference: views of the tracker's buffers.

use std::borrow::Cow;

use crate::control::{Belief, Consistency, TrackConfidence};
use crate::gaze::{Plan, PolicySnapshot};
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::identity::Percept;
use crate::identity::accumulate::likeliest;
use crate::scene::{Detection, Image};

/// One frame's results. Views of buffers that the next step overwrites.
#[non_exhaustive]
pub struct Step<'a> {
    /// Steps since the target was given: 1 for the first picture after that.
    pub number: u64,
    /// The picture it is about.
    pub image: &'a Image,
    /// Values read of the picture: pixels times planes, each once; with a sensor all bins and tiles that it read, overlaps as often as
    /// they were read. Looks recorded for observers do not count.
    pub values: usize,
    /// What the tracker was told that a detector found in it.
    pub detections: &'a [Detection],
    /// Mean of the belief, moved by the box regression where the configuration has one.
    pub estimate: State,
    /// Covariance of the belief over x, y, vx, vy, log scale, angle.
    pub covariance: [[f64; 6]; 6],
    /// Effective sample size 1/Σw², 1 to N.
    pub ess: f64,
    /// log Σ w̃: how well this frame was foreseen, nats, up to the likelihood's constant.
    pub log_evidence: f64,
    /// How the evidence compares with what was promised.
    pub consistency: Consistency,
    /// P(lost), and the status that follows from it.
    pub confidence: TrackConfidence,
    /// What credible regions are wider by than the belief, standard deviation in template units.
    pub localisation_noise: f64,
    /// Half the size of the target's box at scale 1.
    pub extent: Extent,
    /// x̃ₜ: the predicted particles.
    pub predicted: &'a [State],
    /// wₜ: their weights; sum to 1.
    pub weights: &'a [f64],
    /// The gazes that were scored, and those that were used.
    pub plan: &'a Plan,
    /// For each gaze of the plan: its reward.
    pub rewards: &'a [f64],
    /// For each gaze that the plan asks to record: its reward.
    pub recorded: &'a [f64],
    /// For each gaze of the plan: its own log evidence.
    pub gaze_evidence: &'a [f64],
    /// For each particle that starts the next frame: the index of its parent here.
    pub ancestors: &'a [usize],
    /// What was seen at the estimate.
    pub percept: &'a Percept,
    /// p(c | all frames so far), one a class; empty without a recogniser.
    pub classes: &'a [f64],
    /// What the classes are called; empty where they have numbers alone.
    pub class_names: &'a [String],
    /// p(c | the last few looks): this frame's own decision.
    pub own_classes: &'a [f64],
    /// Where the recogniser looked.
    pub recognition_gazes: &'a [Gaze],
    /// What the policy has learned.
    pub snapshot: PolicySnapshot<'a>,
}

/// An ellipse on the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Centre, pixels.
    pub x: f64,
    /// Centre, pixels.
    pub y: f64,
    /// Half axes, the longer one first, pixels.
    pub half: [f64; 2],
    /// Direction of the longer one, radians from x towards y.
    pub turn: f64,
}

impl<'a> Step<'a> {
    /// The target's box.
    pub fn bbox(&self) -> BBox {
        self.estimate.bbox(self.extent)
    }
    /// Values read, as a share of those that the picture has: 0 to 1, with a sensor that reads places twice also more.
    pub fn share_read(&self) -> f64 {
        self.values as f64 / self.image.bytes().len() as f64
    }
    /// Pixels per template unit at the estimate's size.
    pub fn unit(&self) -> f64 {
        self.extent.mean() * self.estimate.log_scale.exp()
    }
    /// The credible region of the target's centre that holds this share (0 to below 1) of the probability, as of a normal
    /// belief: its covariance and the localisation noise.
    pub fn region(&self, share: f64) -> Region {
        let (c, localisation_noise) = (&self.covariance, self.localisation_noise * self.unit());
        let (a, b, d) = (
            c[0][0] + localisation_noise * localisation_noise,
            c[0][1],
            c[1][1] + localisation_noise * localisation_noise,
        );
        let (middle, apart) = (0.5 * (a + d), (0.5 * (a - d)).hypot(b));
        let size = -2.0 * (1.0 - share).ln();
        let half = [middle + apart, middle - apart].map(|v| (size * v).max(0.0).sqrt());
        Region { x: self.estimate.x, y: self.estimate.y, half, turn: 0.5 * (2.0 * b).atan2(a - d) }
    }
    /// The weighted sample itself.
    pub fn belief(&self) -> Belief<'a> {
        Belief { states: self.predicted, weights: self.weights }
    }
    /// The reward of a gaze; `None` where it was neither scored nor recorded.
    pub fn reward_of(&self, gaze: Gaze) -> Option<f64> {
        let of = |gazes: &[Gaze], rewards: &[f64]| {
            gazes.iter().position(|g| (g.u, g.v) == (gaze.u, gaze.v)).map(|k| rewards[k])
        };
        of(self.plan.gazes(), self.rewards).or_else(|| of(self.plan.recorded(), self.recorded))
    }
    /// Whether the box is a result: the status is tracking or reacquired. Else the box is a guess.
    pub fn is_usable(&self) -> bool {
        self.confidence.status.is_usable()
    }
    /// Whether the status is lost. It is not while the target is occluded: see [`Step::is_usable`].
    pub fn is_lost(&self) -> bool {
        self.confidence.status.is_lost()
    }
    /// The likeliest class over all frames so far, and its probability; `None` without a recogniser.
    pub fn class(&self) -> Option<(usize, f64)> {
        best(self.classes)
    }
    /// What a class is called: its name, or else its number.
    pub fn class_name(&self, class: usize) -> Cow<'a, str> {
        self.class_names.get(class).map_or_else(|| class.to_string().into(), |name| name.as_str().into())
    }
    /// The likeliest class by this frame's own decision, and its probability.
    pub fn own_class(&self) -> Option<(usize, f64)> {
        best(self.own_classes)
    }
}

fn best(probabilities: &[f64]) -> Option<(usize, f64)> {
    let class = likeliest(probabilities);
    probabilities.get(class).map(|p| (class, *p))
}
