//! Where the next particles are put, and what is known of the scene for it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::ranges::Ranges;
use crate::Result;
use crate::control::{Autoregressive, Mixing, Mixture, Prior, Proposal, Sighting};

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

/// The proposal of a configuration.
pub(super) fn proposal(config: &ProposalConfig, motion: Autoregressive, walls: bool) -> Box<dyn Proposal> {
    match config {
        ProposalConfig::Prior => Box::new(Prior::new(Arc::new(motion)).walls(walls)),
        ProposalConfig::Mixture(mixing) => Box::new(Mixture::new(motion, *mixing).walls(walls)),
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

impl Ranges for Option<Sighting> {
    fn ranges(&self) -> Result<()> {
        self.as_ref().map_or(Ok(()), Sighting::check)
    }
}
