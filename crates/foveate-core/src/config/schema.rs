//! The content of a configuration file: names of components, and their numbers.

use serde::{Deserialize, Serialize};

use super::encoders::EncoderConfig;
use super::own::OwnPart;
use super::parts::Parts;
use super::policies::PolicyConfig;
use super::proposals::{DetectorConfig, ProposalConfig};
use super::ranges::{Ranges, alone, committee, in_range, is_alone, particles};
use super::recogniser::RecogniserConfig;
use super::rewards::RewardConfig;
use crate::control::{
    Autoregressive, CameraMotion, ConfidenceModel, ConsistencySettings, DetectionLikelihood, DistractorSettings,
    LocalSearchSettings, RedetectionSettings, Resampling,
};
use crate::identity::calibrate::Calibration;
use crate::identity::gaze_appearance::Sharpness;
use crate::identity::retina::{Foveal, FovealConfig};
use crate::identity::{box_regression, colour, discriminant, distance};
use crate::start::StartSpread;
use foveate_base::error::within;
use foveate_base::{Error, Result};

/// Everything that can be chosen about a tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Seed of all random streams. The same seed gives the same track.
    #[serde(default)]
    pub seed: u64,
    /// Number of particles N, at least 1.
    #[serde(deserialize_with = "particles")]
    pub particles: usize,
    /// The selection step.
    #[serde(default, deserialize_with = "in_range")]
    pub resampling: Resampling,
    /// p(xₜ | xₜ₋₁).
    #[serde(deserialize_with = "in_range")]
    pub dynamics: DynamicsConfig,
    /// Whether the target's centre is clamped to the picture.
    #[serde(default)]
    pub clamp_to_frame: bool,
    /// Whether a first box that is too large shrinks to the region of it that moves as one; the reported box keeps its size.
    #[serde(default)]
    pub shrink_first_box: bool,
    /// q(xₜ | xₜ₋₁, scene).
    #[serde(default, deserialize_with = "in_range")]
    pub proposal: ProposalConfig,
    /// p(detections | xₜ), for detections of the target; without it they do not change the weights.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub detection_likelihood: Option<DetectionLikelihood>,
    /// Whether particles move with the camera, or with the flow where they are; left out, they do not.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub camera_motion: Option<CameraMotion>,
    /// What looks for candidates in every frame, for the proposal and the detection likelihood; left out, nothing does.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub detector: Option<DetectorConfig>,
    /// p(x₀).
    #[serde(default, deserialize_with = "in_range")]
    pub start: StartSpread,
    /// The retina; a trained encoder brings its own and needs none here.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub retina: Option<RetinaConfig>,
    /// The first layer.
    pub encoder: EncoderConfig,
    /// An observation model of your own, in the place of retina, encoder and distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub observation_model: Option<OwnPart>,
    /// d and how sharply it counts.
    #[serde(deserialize_with = "in_range")]
    pub likelihood: LikelihoodConfig,
    /// The discriminant: it separates the target from its surroundings, and learns while tracking. Off unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub discriminant: Option<discriminant::Settings>,
    /// Covariance of a target's features along a track, a prior for the discriminant.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub variation: Option<discriminant::Variation>,
    /// The colour model: colours of the target against those of its surroundings, learned while tracking. Off unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub colour: Option<colour::Settings>,
    /// Trains the first layer, an RBM, while tracking.
    #[cfg(feature = "learn")]
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub online_training: Option<crate::identity::online::Settings>,
    /// The box regression: it moves the reported box to the borders of the target. Off unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub box_regression: Option<box_regression::Settings>,
    /// The search for distractors; among the particles only unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub distractors: Option<DistractorSettings>,
    /// The sensor that limits reads of each picture; all of it unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub sensor: Option<crate::scene::SensorSettings>,
    /// πₜ.
    #[serde(deserialize_with = "in_range")]
    pub policy: PolicyConfig,
    /// rₜ.
    #[serde(default, deserialize_with = "in_range")]
    pub reward: RewardConfig,
    /// How the evidence is compared with the reference likelihood of frame 1.
    #[serde(default, deserialize_with = "in_range")]
    pub consistency: ConsistencySettings,
    /// How probable it is that the target is lost.
    #[serde(default, deserialize_with = "in_range")]
    pub confidence: ConfidenceModel,
    /// Number of trackers of this configuration that follow the target and vote, 1 to 64.
    #[serde(default = "alone", skip_serializing_if = "is_alone", deserialize_with = "committee")]
    pub committee: usize,
    /// Configuration of a second tracker of the target, a file or `builtin:NAME`. Its agreement changes the reported P(lost).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second_opinion: Option<String>,
    /// The recogniser; left out, nothing is recognised.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub recogniser: Option<RecogniserConfig>,
    /// How a lost target is looked for; not at all unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub redetection: Option<RedetectionSettings>,
    /// How a target that has leapt is looked for around the estimate; not at all unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub local_search: Option<LocalSearchSettings>,
    /// What happens between targets, where many are followed.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub multi_target: Option<crate::multi::Settings>,
    /// The components that its sections may name beside those of the library; see [`Config::with_parts`].
    #[serde(skip, default = "super::sections::parts")]
    pub parts: Parts,
}

/// The transition models there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum DynamicsConfig {
    /// A classical autoregressive process (section 3.1).
    Autoregressive(Autoregressive),
}

/// The retinas there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum RetinaConfig {
    /// Concentric windows with coarser cells outside.
    Foveal(FovealConfig),
}

/// Distance and sharpness.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LikelihoodConfig {
    /// Distance d between features.
    pub distance: distance::Kind,
    /// Nats per unit of distance. Give this or `calibrate`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
    /// Rule that chooses the sharpness on frame 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrate: Option<Calibration>,
    /// Share of brightness removed from pixels that have not changed since frame 1. For a fixed camera, 0 to 1.
    #[serde(default)]
    pub background_discount: f32,
}

impl Ranges for Config {
    fn ranges(&self) -> Result<()> {
        if !(1..=1_000_000).contains(&self.particles) {
            return Err(Error::Config(format!("particles is a number from 1 to 1000000; it is {}", self.particles)));
        }
        self.resampling.ranges()?;
        self.dynamics.ranges()?;
        self.proposal.ranges()?;
        self.detection_likelihood.ranges()?;
        self.camera_motion.ranges()?;
        self.detector.ranges()?;
        self.start.ranges()?;
        self.retina.ranges()?;
        self.likelihood.ranges()?;
        self.policy.ranges()?;
        self.reward.ranges()?;
        self.consistency.ranges()?;
        self.confidence.ranges()?;
        self.recogniser.ranges()?;
        self.discriminant.ranges()?;
        self.variation.ranges()?;
        self.colour.ranges()?;
        #[cfg(feature = "learn")]
        self.online_training.ranges()?;
        self.box_regression.ranges()?;
        self.distractors.ranges()?;
        self.sensor.ranges()?;
        self.redetection.ranges()?;
        self.local_search.ranges()?;
        self.multi_target.ranges()
    }
}

impl Ranges for DynamicsConfig {
    fn ranges(&self) -> Result<()> {
        let Self::Autoregressive(motion) = self;
        motion.check()
    }
}

impl Ranges for RetinaConfig {
    fn ranges(&self) -> Result<()> {
        let Self::Foveal(config) = self;
        Foveal::new(config.clone()).map(|_| ())
    }
}

impl Ranges for LikelihoodConfig {
    fn ranges(&self) -> Result<()> {
        self.rule()?;
        within("likelihood.background_discount", self.background_discount.into(), 0.0, 1.0)?;
        if let Some(sharpness) = self.sharpness {
            within("likelihood.sharpness", sharpness, 1e-9, 1e9)?;
        }
        if let Some(rule) = self.calibrate {
            within("likelihood.calibrate.nats", rule.nats, 1e-9, 1e9)?;
            within("likelihood.calibrate.least", rule.least, 1e-9, 1e9)?;
            within("likelihood.calibrate.most", rule.most, rule.least, 1e9)?;
        }
        if let distance::Kind::Presence { extra, cap } = self.distance {
            within("likelihood.distance.presence.extra", extra.into(), 0.0, 1.0)?;
            within("likelihood.distance.presence.cap", cap.into(), 1e-6, 1e6)?;
        }
        Ok(())
    }
}

impl LikelihoodConfig {
    /// How sharply distances count.
    pub(super) fn rule(&self) -> Result<Sharpness> {
        match (self.sharpness, self.calibrate) {
            (Some(sharpness), None) if sharpness.is_finite() && sharpness > 0.0 => Ok(Sharpness::Fixed(sharpness)),
            (None, Some(rule)) => Ok(Sharpness::Calibrated(rule)),
            _ => Err(Error::Config(
                "likelihood needs either sharpness, a number above 0 (nats per unit of distance), or calibrate = \
                 { nats = 12, least = 10, most = 200 }"
                    .into(),
            )),
        }
    }
}
