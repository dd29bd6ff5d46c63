//! Where the next particles are put, and what is known of the scene for it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Blueprint;
use super::ranges::Ranges;
use crate::Result;
use crate::control::{Autoregressive, Mixing, Mixture, Pace, Prior, Proposal};
use crate::scene::{Detector, Flow, Motion, Saliency, Scout};

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

/// The detectors there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum DetectorConfig {
    /// What differs from the background learned so far; for a camera that stands still.
    Motion,
    /// What is unlike its surroundings (Itti and Koch).
    Saliency,
    /// What moves otherwise than the camera.
    Flow,
}

impl DetectorConfig {
    /// A detector that has seen nothing yet.
    pub fn detector(self) -> Box<dyn Detector> {
        match self {
            Self::Motion => Box::<Motion>::default(),
            Self::Saliency => Box::<Saliency>::default(),
            Self::Flow => Box::<Flow>::default(),
        }
    }
}

impl Blueprint {
    /// What looks at every frame beside the trackers, as the configuration has it.
    pub fn scout(&self) -> Scout {
        let config = self.config();
        Scout::new(config.detector.map(DetectorConfig::detector), config.guide.map(|guide| guide.finest()))
    }
}

/// The proposal of a configuration.
pub(super) fn proposal(
    config: &ProposalConfig,
    motion: Autoregressive,
    pace: Option<Pace>,
    walls: bool,
) -> Box<dyn Proposal> {
    match config {
        ProposalConfig::Prior => Box::new(Prior::new(Arc::new(motion)).paced(pace).walls(walls)),
        ProposalConfig::Mixture(mixing) => Box::new(Mixture::new(motion, *mixing).paced(pace).walls(walls)),
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
