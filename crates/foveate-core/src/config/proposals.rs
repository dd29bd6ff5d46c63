//! Where the next particles are put, and what is known of the scene for it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Blueprint;
use super::ranges::Ranges;
use crate::control::{Autoregressive, Mixing, Mixture, Prior, Proposal};
use crate::scene::{Detector, Flow, Image, Motion, Preprocessor, Saliency, Walkers};
use foveate_base::Result;

/// The proposals there are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ProposalConfig {
    /// The transition prior (section 6.1).
    #[default]
    Prior,
    /// Some particles start at what a detector found (section 6.3).
    Mixture(Mixing),
}

/// The detectors there are; none needs a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum DetectorConfig {
    /// What differs from the background learned so far; for a camera that stands still.
    Motion,
    /// The same, with boxes for upright walkers: parts above each other are joined, what is too wide is cut.
    Walkers,
    /// What is unlike its surroundings (Itti and Koch).
    Saliency,
    /// What moves otherwise than the camera.
    Flow,
}

impl DetectorConfig {
    /// All of them, by name.
    pub const ALL: [(&str, Self); 4] =
        [("motion", Self::Motion), ("walkers", Self::Walkers), ("saliency", Self::Saliency), ("flow", Self::Flow)];

    /// A detector that has seen nothing yet.
    pub fn detector(self) -> Box<dyn Detector> {
        match self {
            Self::Motion => Box::<Motion>::default(),
            Self::Walkers => Box::<Walkers>::default(),
            Self::Saliency => Box::<Saliency>::default(),
            Self::Flow => Box::<Flow>::default(),
        }
    }
    /// A detector that has seen these pictures of the background, and keeps what it learned from them for long; those that
    /// need no background have seen nothing yet.
    pub fn knowing(self, background: &[Image]) -> Box<dyn Detector> {
        match self {
            Self::Motion => {
                let mut motion = Motion::default();
                motion.patience = u8::MAX;
                motion.learn_background(background);
                Box::new(motion)
            }
            Self::Walkers => {
                let mut walkers = Walkers::default();
                walkers.learn_background(background);
                Box::new(walkers)
            }
            Self::Saliency | Self::Flow => self.detector(),
        }
    }
}

impl Blueprint {
    /// What looks at every picture beside the trackers, as the configuration has it.
    pub fn preprocessor(&self) -> Preprocessor {
        let config = self.config();
        let detector = config.detector.map(DetectorConfig::detector);
        Preprocessor::new(detector, config.camera_motion.map(|camera_motion| camera_motion.finest()))
    }
}

/// The proposal of a configuration.
pub(super) fn proposal(config: &ProposalConfig, motion: Autoregressive, clamp_to_frame: bool) -> Box<dyn Proposal> {
    match config {
        ProposalConfig::Prior => Box::new(Prior::new(Arc::new(motion)).clamp_to_frame(clamp_to_frame)),
        ProposalConfig::Mixture(mixing) => Box::new(Mixture::new(motion, *mixing).clamp_to_frame(clamp_to_frame)),
    }
}

impl Ranges for ProposalConfig {
    fn ranges(&self) -> Result<()> {
        match self {
            Self::Prior => Ok(()),
            Self::Mixture(mixing) => mixing.check(),
        }
    }
}
