//! Names → modules: the only file that names every implementation.
//!
//! A configuration is TOML. A misspelled key or name, or a number out of range, gives an error with the line, the
//! column and the valid values. Lengths are in template units (1 = half the target's box) a frame, so
//! that one configuration serves targets of every size.

use std::path::Path;
use std::sync::Arc;

use crate::control::{LocalSearch, Redetection};
use crate::engine::{Filter, GazeControl, Monitor};
use crate::identity::Appearance;
use crate::identity::box_regression::{self, BoxRegression};
use crate::identity::discriminant::Layout;
use crate::identity::encoder::Encoder;
use crate::identity::gaze_appearance::GazeAppearance;
use crate::identity::oriented::Oriented;
use crate::identity::retina::{Foveal, Retina};
use crate::origin::Origin;
use crate::tree::Node;
use foveate_base::files::Files;
use foveate_base::{Error, Result};

mod bandits;
mod builtin;
mod choose;
mod encoders;
mod identity;
mod kinds;
#[cfg(feature = "learn")]
mod learned;
mod memory_estimate;
mod multi;
#[cfg(feature = "onnx")]
mod onnx;
#[cfg(not(feature = "onnx"))]
#[path = "config/no_onnx.rs"]
mod onnx;
mod own;
mod parts;
mod places;
mod policies;
mod probe;
mod proposals;
mod ranges;
#[cfg(feature = "learn")]
mod reading;
#[cfg(not(feature = "learn"))]
#[path = "config/no_reading.rs"]
mod reading;
#[cfg(feature = "learn")]
mod recogniser;
#[cfg(not(feature = "learn"))]
#[path = "config/no_recogniser.rs"]
mod recogniser;
mod rewards;
mod schema;
mod second;
mod sections;
mod set;
mod shadow;
mod toml_errors;

pub use bandits::{Exp3AsPrintedConfig, Exp3Config, Exp3IxConfig, Exp3SConfig};
pub use builtin::{BUILTIN, OFFERED, about};
pub use choose::{Configure, Profile};
pub use encoders::EncoderConfig;
pub use kinds::POLICIES;
pub use own::OwnPart;
pub use parts::{EncoderSite, ObservationSite, Parts, ProposalSite};
pub use policies::PolicyConfig;
use policies::policy;
pub use proposals::{DetectorConfig, DetectorParts, ProposalConfig};
use ranges::Ranges;
#[cfg(feature = "learn")]
pub use reading::RECOGNISERS;
pub use recogniser::RecogniserConfig;
pub use rewards::RewardConfig;
pub use schema::{Config, DynamicsConfig, LikelihoodConfig, RetinaConfig};
#[doc(hidden)]
pub use set::{changed, parse};

impl Config {
    /// Reads a configuration; `name` stands for it in errors.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        Self::parse_with(text, name, &Parts::new())
    }

    /// Reads a configuration whose sections may name `parts` beside those of the library; `name` stands for it in errors.
    pub fn parse_with(text: &str, name: &str, parts: &Parts) -> Result<Self> {
        sections::reading(parts, || parse(text, name))
    }

    /// The same configuration, whose sections may name `parts` from now on.
    pub fn with_parts(self, parts: &Parts) -> Self {
        Self { parts: parts.clone(), ..self }
    }

    /// A parser's error in plain words, with what helps.
    fn problem(e: &str) -> String {
        let unlearned = ["rbm", "kmeans"].iter().any(|k| e.contains(&format!("unknown kind `{k}`")));
        let feature = if unlearned { "\nencoders with learned weights need the feature `learn`" } else { "" };
        format!("{}{feature}", toml_errors::without_types(e))
    }

    /// Reads a configuration file.
    pub fn read(files: &dyn Files, path: &Path) -> Result<Self> {
        Self::read_with(files, path, &Parts::new())
    }

    /// Reads a configuration file whose sections may name `parts` beside those of the library.
    pub fn read_with(files: &dyn Files, path: &Path, parts: &Parts) -> Result<Self> {
        let not_text = |e| Error::malformed(path, format!("a configuration is UTF-8 text ({e})"));
        Self::parse_with(&String::from_utf8(files.read(path)?).map_err(not_text)?, &path.display().to_string(), parts)
    }

    /// As TOML text, every setting written out.
    pub fn to_toml(&self) -> String {
        Node::of(self).to_toml()
    }

    /// A configuration that ships with the program, by name; see [`BUILTIN`].
    pub fn builtin(name: &str) -> Option<Result<Self>> {
        BUILTIN.iter().find(|b| b.0 == name).map(|(name, text)| Self::parse(text, name))
    }

    /// The names of those that ship, as [`BUILTIN`] has them.
    pub fn names() -> Vec<&'static str> {
        BUILTIN.iter().map(|b| b.0).collect()
    }

    /// Checks that numbers are in range and the components fit; model files are read from `files`.
    pub fn check(self, files: &dyn Files) -> Result<Blueprint> {
        self.ranges()?;
        let DynamicsConfig::Autoregressive(motion) = &self.dynamics;
        if matches!(self.proposal, ProposalConfig::Mixture(_)) && motion.tail_probability > 0.0 {
            return Err(Error::Config(format!(
                "proposal: a mixture with detections needs dynamics of normal noise; dynamics.tail_probability is {}, set it to 0",
                motion.tail_probability
            )));
        }
        if self.distractors.is_some() && self.discriminant.is_none() {
            return Err(Error::Config(
                "distractors: they are learned by the discriminant; add [discriminant], or leave [distractors] out"
                    .into(),
            ));
        }
        if self.local_search.is_some() && self.distractors.is_none() {
            return Err(Error::Config(
                "local_search: it looks at distractors more closely; add [distractors], or leave [local_search] out"
                    .into(),
            ));
        }
        if self.variation.is_some() && self.discriminant.is_none() {
            return Err(Error::Config(
                "variation: it is the discriminant that expects it; add [discriminant], or leave [variation] out"
                    .into(),
            ));
        }
        #[cfg(feature = "learn")]
        if self.online_training.is_some() && !matches!(self.encoder, EncoderConfig::Rbm { .. }) {
            return Err(Error::Config(
                "online_training: it trains an RBM; set encoder.kind to \"rbm\", or leave [online_training] out".into(),
            ));
        }
        if self.sensor.is_some() && (self.detector.is_some() || self.multi_target.is_some()) {
            return Err(Error::Config(
                "sensor: detectors and many targets need whole pictures; leave out [detector] and [multi_target], or [sensor]".into(),
            ));
        }
        if self.sensor.is_some() && self.policy.looks_often() {
            return Err(Error::Config(
                "sensor: its fovea is at one gaze a frame; policy.kind may be explore-then-commit, fixed, random, circular, exp3 or gp-ucb"
                    .into(),
            ));
        }
        if self.sensor.is_some() && self.policy.rehearses() {
            return Err(Error::Config(
                "policy.rehearsal: behind a sensor a gaze has no reward before it was read; use policy.saliency, or leave [sensor] out"
                    .into(),
            ));
        }
        if self.committee > 1 && (self.sensor.is_some() || self.multi_target.is_some()) {
            return Err(Error::Config(
                "committee: it is of one target in whole pictures; leave committee out, or [sensor] and [multi_target]"
                    .into(),
            ));
        }
        if self.colour.is_some() && self.likelihood.background_discount > 0.0 {
            return Err(Error::Config(
                "likelihood.background_discount: it changes the colours that [colour] compares; leave one of them out"
                    .into(),
            ));
        }
        for (section, given) in [
            ("discriminant", self.discriminant.is_some()),
            ("colour", self.colour.is_some()),
            ("sensor", self.sensor.is_some()),
        ] {
            if given && self.observation_model.is_some() {
                return Err(Error::Config(format!(
                    "{section}: it is a part of the library's observation model; leave out [{section}], or [observation_model]"
                )));
            }
        }
        let (retina, encoder) = self.identity(files)?;
        let variation = self.variation.as_ref().map(|it| it.penalty(files, &*encoder)).transpose()?.flatten();
        let recogniser = self.recogniser.as_ref().map(|r| r.read(files, &self.parts)).transpose()?;
        let detector = self.detector.as_ref().map(|d| d.read_with(files, &self.parts)).transpose()?;
        let boxes = self.box_regression.as_ref().map(|it| it.read(files).map(Arc::new)).transpose()?;
        let second = self.second(files)?.map(Box::new);
        let (retina, shadow) = (Arc::new(retina), vec![]);
        let blueprint =
            Blueprint { config: self, retina, encoder, variation, boxes, shadow, detector, recogniser, second };
        blueprint.fits()?;
        blueprint.parts()?;
        if matches!(blueprint.config.encoder, EncoderConfig::Own(_)) && blueprint.config.observation_model.is_none() {
            let distance = blueprint.config.likelihood.distance;
            probe::encoder(&*blueprint.retina, &*blueprint.encoder, distance, &mut *blueprint.observation_model()?)?;
        }
        Ok(blueprint)
    }
}

/// Returns whether a retina at the centre of the box covers all of it: then a sensor's gaze need not move it.
fn covers_the_box(retina: &Foveal) -> bool {
    retina.footprints().iter().any(|f| f.reach + 0.5 * f.side >= 1.0)
}

/// A checked configuration: trackers made from it cannot fail to fit.
#[derive(Clone)]
pub struct Blueprint {
    config: Config,
    retina: Arc<Foveal>,
    encoder: Arc<dyn Encoder>,
    /// The covariance of the features for the discriminant, if it is known.
    variation: Option<Arc<[f32]>>,
    /// What regresses boxes.
    boxes: Option<Arc<box_regression::Network>>,
    shadow: Vec<crate::geometry::Gaze>,
    detector: Option<DetectorParts>,
    recogniser: Option<reading::Recogniser>,
    /// Of the second opinion.
    second: Option<Box<Blueprint>>,
}

impl std::fmt::Debug for Blueprint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Blueprint").field("config", &self.config).finish_non_exhaustive()
    }
}

impl Blueprint {
    /// The components of a tracker of this seed and target.
    pub(crate) fn origin(&self, seed: u64, target: u64) -> Origin {
        let chain = std::iter::successors(Some(self), |blueprint| blueprint.second.as_deref());
        let value = |blueprint: &Self| {
            serde_json::to_value(Node::of(&blueprint.config)).expect("a configuration is plain data")
        };
        Origin { seed, target, configurations: chain.map(value).collect() }
    }
    /// The components of all trackers that vote on one target.
    pub(crate) fn members(&self) -> Result<Vec<crate::engine::Parts>> {
        (0..self.config.committee).map(|_| self.parts()).collect()
    }
    /// The components of a tracker.
    ///
    /// # Errors
    /// None for a checked configuration; [`Error::Config`] where a component cannot be made after all.
    pub fn parts(&self) -> Result<crate::engine::Parts> {
        let c = &self.config;
        let DynamicsConfig::Autoregressive(dynamics) = &c.dynamics;
        let site = ProposalSite::new(*dynamics, c.clamp_to_frame);
        let filter = Filter::new(proposals::proposal(&c.proposal, site, &c.parts)?, c.particles)?
            .with_resampling(c.resampling)
            .with_start(c.start)
            .with_camera_motion(c.camera_motion)
            .with_detection_likelihood(c.detection_likelihood)
            .with_redetection(c.redetection.clone().map(Redetection::new))
            .with_local_search(c.local_search.map(LocalSearch::new));
        let gaze = GazeControl::new(self.shadowed(policy(&c.policy, &c.parts)?), c.reward.reward(&c.parts)?);
        let monitor = Monitor::new(c.consistency.clone(), c.confidence.clone()).with_distractors(c.distractors.clone());
        let recognition = self.recogniser.as_ref().map(reading::Recogniser::recognition).transpose()?;
        let second = self.second.as_ref().map(|second| second.parts()).transpose()?;
        let regression = self.boxes.clone().zip(c.box_regression.clone());
        Ok(crate::engine::Parts::new(filter, gaze, self.observation_model()?, monitor)
            .with_recognition(recognition)
            .with_shrinking_first_box(c.shrink_first_box)
            .with_box_regression(regression.map(|(network, settings)| BoxRegression::new(network, settings)))
            .with_second_tracker(second))
    }
    /// log p(hₜ | xₜ, aₜ): retina, encoder and distance with all that is learned while tracking, or one of the user's own.
    fn observation_model(&self) -> Result<Box<dyn Appearance>> {
        let c = &self.config;
        let (retina, encoder) = (self.retina.clone(), self.encoder.clone());
        if let Some(own) = &c.observation_model {
            let site = ObservationSite::new(retina, encoder, c.likelihood.distance, c.likelihood.rule()?);
            return c.parts.observation_model(own, site);
        }
        let appearance = GazeAppearance::new(retina, encoder, c.likelihood.distance, c.likelihood.rule()?)?
            .with_background_discount(c.likelihood.background_discount)
            .with_steady_gaze(self.has_steady_gaze())
            .with_colour(c.colour);
        let appearance = match c.discriminant {
            Some(settings) => {
                appearance.with_discriminant(settings).with_layout(self.layout()).with_variation(self.variation.clone())
            }
            None => appearance,
        };
        #[cfg(feature = "learn")]
        let appearance = appearance.training(c.online_training)?;
        Ok(Box::new(appearance))
    }
    /// Whether gazes move the sensor's window, and the retina stays at the centre.
    fn has_steady_gaze(&self) -> bool {
        self.config.sensor.is_some() && covers_the_box(&self.retina)
    }
    /// The features of all gazes that the policy may commit to, in one discriminant. `None` if it serves the committed gaze alone: then the
    /// policy has no choice, it is known for the centre only how features vary, or features have no known places.
    pub(crate) fn layout(&self) -> Option<Layout> {
        let c = &self.config;
        let learned = c.discriminant.is_some() && c.observation_model.is_none();
        let encoder = self.encoder.downcast::<Oriented>().filter(|_| learned && self.variation.is_none())?;
        let gazes = c.policy.gazes_to_commit_to();
        let several = gazes.len() > 1 && !self.has_steady_gaze();
        several.then(|| Layout::new(&gazes, &encoder.parts(), &encoder.places(self.retina.cells())))
    }
    /// The same, with another retina and encoder, of whose features it is not known how they vary.
    pub fn with(&self, retina: Arc<Foveal>, encoder: Arc<dyn Encoder>) -> Self {
        Self { retina, encoder, variation: None, ..self.clone() }
    }
    /// Its configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }
    /// The retina in use.
    pub fn retina(&self) -> Arc<dyn Retina> {
        self.retina.clone()
    }
}
