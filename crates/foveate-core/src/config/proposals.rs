//! Proposals of the next particles, and the detectors that they use.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Blueprint;
use super::onnx::Network;
use super::own::OwnPart;
use super::parts::{Parts, ProposalSite};
use super::ranges::Ranges;
use crate::control::{Mixing, Mixture, Prior, Proposal};
use crate::scene::{Detector, Flow, Image, Motion, Preprocessor, Saliency, Walkers, object_detector};
use foveate_base::Result;
use foveate_base::files::Files;

/// The proposals there are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields, remote = "Self")]
#[non_exhaustive]
pub enum ProposalConfig {
    /// The motion model (section 6.1).
    #[default]
    Prior,
    /// Some particles start at detections (section 6.3).
    Mixture(Mixing),
    /// A registered one.
    #[serde(skip)]
    Own(OwnPart),
}

/// The detectors there are; all but `onnx` need no model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields, remote = "Self")]
#[non_exhaustive]
pub enum DetectorConfig {
    /// Differences from a learned background. For a fixed camera.
    Motion,
    /// As `motion`, with boxes of upright pedestrians: regions above each other are joined, wide ones split.
    Walkers,
    /// Salient regions (Itti and Koch).
    Saliency,
    /// Regions that move differently from the camera.
    Flow,
    /// Objects of known classes, by a network in an ONNX file. It needs a build with `--features onnx`.
    Onnx(object_detector::Settings),
    /// A registered one.
    #[serde(skip)]
    Own(OwnPart),
}

impl DetectorConfig {
    /// Those that need no model, by name.
    pub const ALL: [(&str, Self); 4] =
        [("motion", Self::Motion), ("walkers", Self::Walkers), ("saliency", Self::Saliency), ("flow", Self::Flow)];

    /// Its name in a configuration.
    pub fn name(&self) -> &str {
        if let Self::Own(part) = self {
            return part.kind();
        }
        Self::ALL.into_iter().find(|(_, one)| one == self).map_or("onnx", |(name, _)| name)
    }

    /// What detectors are made of, once a model that it needs is read from `files`.
    ///
    /// # Errors
    /// Fails if its model cannot be read, is no detector, or needs a feature that this build is without.
    pub fn read(&self, files: &dyn Files) -> Result<DetectorParts> {
        self.read_with(files, &Parts::new())
    }
    /// The same; registered detectors are among `parts`.
    pub(super) fn read_with(&self, files: &dyn Files, parts: &Parts) -> Result<DetectorParts> {
        self.ranges()?;
        let network = match self {
            Self::Onnx(settings) => Some(super::onnx::detector(settings, files)?),
            Self::Own(part) => parts.detector(part).map(|_| None)?,
            _ => None,
        };
        Ok(DetectorParts { config: self.clone(), network, parts: parts.clone() })
    }
}

/// A detector whose model is read: as many as there are videos can be made of it.
#[derive(Clone, Debug)]
pub struct DetectorParts {
    config: DetectorConfig,
    network: Option<Network>,
    parts: Parts,
}

impl DetectorParts {
    /// A detector that has seen nothing yet.
    pub fn detector(&self) -> Box<dyn Detector> {
        match (&self.config, &self.network) {
            (DetectorConfig::Motion, _) => Box::<Motion>::default(),
            (DetectorConfig::Walkers, _) => Box::<Walkers>::default(),
            (DetectorConfig::Saliency, _) => Box::<Saliency>::default(),
            (DetectorConfig::Flow, _) => Box::<Flow>::default(),
            (DetectorConfig::Own(part), _) => self.parts.detector(part).expect("one was made with the same settings"),
            (DetectorConfig::Onnx(_), network) => {
                super::onnx::boxed(network.as_ref().expect("it is read where the parts are made"))
            }
        }
    }
    /// A detector that has seen these pictures of the background, and keeps the background that it learned from them; those that
    /// need no background have seen nothing yet.
    pub fn knowing(&self, background: &[Image]) -> Box<dyn Detector> {
        match self.config {
            DetectorConfig::Motion => {
                let mut motion = Motion::default();
                motion.patience = u8::MAX;
                motion.learn_background(background);
                Box::new(motion)
            }
            DetectorConfig::Walkers => {
                let mut walkers = Walkers::default();
                walkers.learn_background(background);
                Box::new(walkers)
            }
            DetectorConfig::Saliency | DetectorConfig::Flow | DetectorConfig::Onnx(_) | DetectorConfig::Own(_) => {
                self.detector()
            }
        }
    }
}

impl Blueprint {
    /// What looks at every picture beside the trackers, as the configuration has it.
    pub fn preprocessor(&self) -> Preprocessor {
        let detector = self.detector.as_ref().map(DetectorParts::detector);
        Preprocessor::new(detector, self.config().camera_motion.map(|camera_motion| camera_motion.finest()))
    }
}

impl Ranges for DetectorConfig {
    fn ranges(&self) -> Result<()> {
        match self {
            Self::Onnx(settings) => settings.check(),
            Self::Motion | Self::Walkers | Self::Saliency | Self::Flow | Self::Own(_) => Ok(()),
        }
    }
}

/// The proposal of a configuration.
pub(super) fn proposal(config: &ProposalConfig, site: ProposalSite, parts: &Parts) -> Result<Box<dyn Proposal>> {
    let ProposalSite { dynamics: motion, clamp_to_frame } = site;
    Ok(match config {
        ProposalConfig::Prior => Box::new(Prior::new(Arc::new(motion)).clamp_to_frame(clamp_to_frame)),
        ProposalConfig::Mixture(mixing) => Box::new(Mixture::new(motion, *mixing).clamp_to_frame(clamp_to_frame)),
        ProposalConfig::Own(part) => parts.proposal(part, site)?,
    })
}

impl Ranges for ProposalConfig {
    fn ranges(&self) -> Result<()> {
        match self {
            Self::Prior | Self::Own(_) => Ok(()),
            Self::Mixture(mixing) => mixing.check(),
        }
    }
}
