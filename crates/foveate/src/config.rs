//! Names → modules: the only file that knows every implementation.
//!
//! A configuration is TOML. A misspelled key or name, or a number out of range, is answered with the line, the
//! column and what would have been right. Lengths are in template units (1 = half the target's box) a frame, so
//! that one configuration serves targets of every size.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::control::{
    Around, Aspect, Autoregressive, Concentration, Confidence, Guide, LogConcentration, Pace, Resampling, Reward,
    Search, Sighting, VarianceReduction, Vigilance,
};
use crate::identity::calibrate::Calibration;
use crate::identity::discriminant;
use crate::identity::distance;
use crate::identity::encoder::{Encoder, Precision};
use crate::identity::gaze_appearance::{GazeAppearance, Sharpness};
use crate::identity::oriented;
use crate::identity::retina::{Foveal, FovealConfig, Retina};
use crate::rbm::factored::Units;
use crate::start::StartSpread;
use crate::tracker::{Parts, Tracker};
use crate::{Error, Result};

mod bandits;
mod identity;
mod many;
mod policies;
mod proposals;
mod ranges;
mod recogniser;
mod shadow;

pub use bandits::{Exp3AsPrintedConfig, Exp3Config, Exp3IxConfig, Exp3SConfig};
pub use policies::PolicyConfig;
use policies::policy;
pub use proposals::{DetectorConfig, ProposalConfig};
use ranges::{Ranges, in_range, particles};
pub use recogniser::{RECOGNISERS, RecogniserConfig};

/// Everything that can be chosen about a tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Names all randomness: same seed, same track.
    #[serde(default)]
    pub seed: u64,
    /// N, at least 1.
    #[serde(deserialize_with = "particles")]
    pub particles: usize,
    /// The selection step.
    #[serde(default, deserialize_with = "in_range")]
    pub resampling: Resampling,
    /// p(xₜ | xₜ₋₁).
    #[serde(deserialize_with = "in_range")]
    pub dynamics: DynamicsConfig,
    /// Whether the shape of the target's box follows it; left out, it is the first frame's.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub aspect: Option<Aspect>,
    /// Whether the motion noise follows the target's own unrest; left out, it is what the dynamics say.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub pace: Option<Pace>,
    /// Whether the target's centre stays in the picture, at its edge if need be.
    #[serde(default)]
    pub walls: bool,
    /// q(xₜ | xₜ₋₁, scene).
    #[serde(default, deserialize_with = "in_range")]
    pub proposal: ProposalConfig,
    /// p(detections | xₜ), where they are taken to be the target's; left out, they do not weigh.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub sighting: Option<Sighting>,
    /// Whether particles move with the camera, or with the flow where they are; left out, they do not.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub guide: Option<Guide>,
    /// What looks for candidates in every frame, for the proposal and the sighting; left out, nothing does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detector: Option<DetectorConfig>,
    /// p(x₀).
    #[serde(default, deserialize_with = "in_range")]
    pub start: StartSpread,
    /// The retina; a trained encoder brings its own and needs none here.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub retina: Option<RetinaConfig>,
    /// The first layer.
    pub encoder: EncoderConfig,
    /// d and how sharply it counts.
    #[serde(deserialize_with = "in_range")]
    pub likelihood: LikelihoodConfig,
    /// What tells the target from what is around it, learned while tracking; not at all unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub discriminant: Option<discriminant::Settings>,
    /// Where it looks for what the target could be mistaken for; among the particles only unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub rivals: Option<Around>,
    /// πₜ.
    #[serde(deserialize_with = "in_range")]
    pub policy: PolicyConfig,
    /// rₜ.
    #[serde(default, deserialize_with = "in_range")]
    pub reward: RewardConfig,
    /// How the evidence is compared with what the first frame promised.
    #[serde(default, deserialize_with = "in_range")]
    pub vigilance: Vigilance,
    /// How probable it is that the target is lost.
    #[serde(default, deserialize_with = "in_range")]
    pub confidence: Confidence,
    /// What the target is called; left out, nobody asks.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub recogniser: Option<RecogniserConfig>,
    /// How it is looked for then; not at all unless given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub search: Option<Search>,
    /// What happens between targets, where many are followed.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "in_range")]
    pub many: Option<crate::many::Settings>,
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
    /// Concentric windows of ever coarser cells.
    Foveal(FovealConfig),
}

/// The first layers there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum EncoderConfig {
    /// A restricted Boltzmann machine: `weights` is a model file, or `builtin:digits` or `builtin:natural`.
    Rbm {
        /// The model.
        weights: String,
        /// How its weights are rounded: `f32`, not at all, or `bf16`, which is faster.
        #[serde(default)]
        precision: Precision,
    },
    /// A factored RBM, of covariance and mean units: `weights` is a model file, or `builtin:natural-mcrbm`.
    Mcrbm {
        /// The model.
        weights: String,
        /// Which of its units are features.
        #[serde(default)]
        units: Units,
    },
    /// The hidden layer of a denoising autoencoder: `weights` is a model file, or
    /// `builtin:natural-autoencoder`.
    Autoencoder {
        /// The model.
        weights: String,
        /// How its weights are rounded: `f32`, not at all, or `bf16`, which is faster.
        #[serde(default)]
        precision: Precision,
    },
    /// k-means filters convolved with the rings: `weights` is a model file, or `builtin:natural-kmeans`. It serves any retina;
    /// left out, the one it was trained with is taken.
    Kmeans {
        /// The model.
        weights: String,
        /// What filters say is averaged over a grid of this many cells along a side of each ring.
        #[serde(default = "two")]
        pool: usize,
        /// A filter counts for what its product with a whitened patch is above this: 0 unless given.
        #[serde(default)]
        threshold: f32,
    },
    /// Gradients in eight directions, grey and colour of a retina of one ring.
    Oriented {
        /// What each of them counts.
        #[serde(default)]
        weights: oriented::Weights,
    },
    /// The glimpse itself.
    Raw {
        /// Whether its mean is taken out and its contrast brought to 1.
        #[serde(default = "yes")]
        standardise: bool,
    },
}

/// Distance and sharpness.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LikelihoodConfig {
    /// d.
    pub distance: distance::Kind,
    /// Nats per unit of distance; give this, or `calibrate`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<f64>,
    /// The rule to choose the sharpness by on the first frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrate: Option<Calibration>,
    /// Share, 0 to 1, taken off whatever was already there in the first frame; for a fixed camera.
    #[serde(default)]
    pub dim_familiar: f32,
}

/// The rewards there are, each with a temperature of its own: the power the likelihood is raised to first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum RewardConfig {
    /// Σw², the paper's.
    Concentration {
        /// 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// log(N Σw²) / log N.
    LogConcentration {
        /// 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// The share of the uncertainty about place that the look removed.
    VarianceReduction {
        /// 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self::VarianceReduction { temperature: 1.0 / 3.0 }
    }
}

fn yes() -> bool {
    true
}

fn two() -> usize {
    2
}

fn one() -> f64 {
    1.0
}

impl Config {
    /// Reads a configuration; `name` stands for it in errors.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        toml::from_str(text).map_err(|e| Error::Config(format!("{name}: {e}")))
    }

    /// Reads a configuration file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path, "cannot read the configuration"))?;
        Self::parse(&text, &path.display().to_string())
    }

    /// As TOML text, every setting written out.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a configuration is plain data")
    }

    /// A configuration that ships with the program, by name; see [`BUILTIN`].
    pub fn builtin(name: &str) -> Option<Result<Self>> {
        BUILTIN.iter().find(|b| b.0 == name).map(|(name, text)| Self::parse(text, name))
    }

    /// Checks that numbers are in range and the parts fit, reading model files relative to `base`.
    pub fn check(self, base: &Path) -> Result<Blueprint> {
        self.ranges()?;
        let DynamicsConfig::Autoregressive(motion) = &self.dynamics;
        if matches!(self.proposal, ProposalConfig::Mixture(_)) && motion.leaps > 0.0 {
            return Err(Error::Config(format!(
                "proposal: a mixture with detections needs dynamics of normal noise; dynamics.leaps is {}, set it to 0",
                motion.leaps
            )));
        }
        if self.rivals.is_some() && self.discriminant.is_none() {
            return Err(Error::Config(
                "rivals: they are learned by the discriminant; add [discriminant], or leave [rivals] out".into(),
            ));
        }
        let (retina, encoder) = self.identity(base)?;
        let recogniser = self.recogniser.as_ref().map(|r| r.read(base)).transpose()?;
        let blueprint = Blueprint { config: self, retina: Arc::new(retina), encoder, shadow: vec![], recogniser };
        blueprint.tracker(0, 0)?;
        Ok(blueprint)
    }
}

/// A checked configuration: trackers made from it cannot fail to fit.
#[derive(Clone)]
pub struct Blueprint {
    config: Config,
    retina: Arc<Foveal>,
    encoder: Arc<dyn Encoder>,
    shadow: Vec<crate::geometry::Gaze>,
    recogniser: Option<recogniser::Recogniser>,
}

impl Blueprint {
    /// A tracker for one target.
    pub fn tracker(&self, seed: u64, target: u64) -> Result<Tracker> {
        let c = &self.config;
        let DynamicsConfig::Autoregressive(dynamics) = &c.dynamics;
        let appearance = GazeAppearance::new(
            self.retina.clone(),
            self.encoder.clone(),
            c.likelihood.distance,
            sharpness(&c.likelihood)?,
        )?
        .dimming(c.likelihood.dim_familiar);
        let appearance = match c.discriminant {
            Some(settings) => appearance.discriminating(settings),
            None => appearance,
        };
        let parts = Parts {
            proposal: proposals::proposal(&c.proposal, *dynamics, c.pace, c.walls),
            guide: c.guide,
            sighting: c.sighting,
            policy: self.shadowed(policy(&c.policy)?),
            appearance: Box::new(appearance),
            aspect: c.aspect,
            reward: reward(c.reward)?,
            resampling: c.resampling,
            vigilance: c.vigilance.clone(),
            confidence: c.confidence.clone(),
            rivals: c.rivals.clone(),
            search: c.search.clone(),
            start: c.start,
            recognizer: self.recogniser.as_ref().map(recogniser::Recogniser::recognition).transpose()?,
        };
        Tracker::new(parts, c.particles, seed, target)
    }
    /// The same, with another retina and encoder.
    pub fn with(&self, retina: Arc<Foveal>, encoder: Arc<dyn Encoder>) -> Self {
        Self { retina, encoder, ..self.clone() }
    }
    /// What it was made from.
    pub fn config(&self) -> &Config {
        &self.config
    }
    /// The retina in use.
    pub fn retina(&self) -> Arc<dyn Retina> {
        self.retina.clone()
    }
}

fn sharpness(config: &LikelihoodConfig) -> Result<Sharpness> {
    match (config.sharpness, config.calibrate) {
        (Some(sharpness), None) if sharpness.is_finite() && sharpness > 0.0 => Ok(Sharpness::Fixed(sharpness)),
        (None, Some(rule)) => Ok(Sharpness::Calibrated(rule)),
        (given, _) => Err(Error::Config(format!(
            "likelihood needs either sharpness, a number above 0 (nats per unit of distance; it is {given:?}), or calibrate = \
             {{ nats = 12, least = 10, most = 200 }}"
        ))),
    }
}

fn reward(config: RewardConfig) -> Result<Box<dyn Reward>> {
    Ok(match config {
        RewardConfig::Concentration { temperature } => Box::new(Concentration::new(temperature)?),
        RewardConfig::LogConcentration { temperature } => Box::new(LogConcentration::new(temperature)?),
        RewardConfig::VarianceReduction { temperature } => Box::new(VarianceReduction::new(temperature)?),
    })
}

/// Configurations that ship with the program.
pub const BUILTIN: &[(&str, &str)] = &[
    ("digits", include_str!("../../../configs/digits.toml")),
    ("digits-hedge", include_str!("../../../configs/digits-hedge.toml")),
    ("digits-rbm", include_str!("../../../configs/digits-rbm.toml")),
    ("digits-partial", include_str!("../../../configs/digits-partial.toml")),
    ("digits-multi", include_str!("../../../configs/digits-multi.toml")),
    ("digits-closeup", include_str!("../../../configs/digits-closeup.toml")),
    ("printed", include_str!("../../../configs/printed.toml")),
    ("authors", include_str!("../../../configs/authors.toml")),
    ("natural", include_str!("../../../configs/natural.toml")),
    ("many", include_str!("../../../configs/many.toml")),
    ("many-motion", include_str!("../../../configs/many-motion.toml")),
    ("many-boxes", include_str!("../../../configs/many-boxes.toml")),
    ("natural-fast", include_str!("../../../configs/natural-fast.toml")),
    ("natural-accurate", include_str!("../../../configs/natural-accurate.toml")),
    ("natural-raw", include_str!("../../../configs/natural-raw.toml")),
    ("natural-rbm", include_str!("../../../configs/natural-rbm.toml")),
    ("natural-mcrbm", include_str!("../../../configs/natural-mcrbm.toml")),
    ("natural-autoencoder", include_str!("../../../configs/natural-autoencoder.toml")),
    ("natural-kmeans", include_str!("../../../configs/natural-kmeans.toml")),
];
