//! Names → rewards.

use serde::{Deserialize, Serialize};

use super::own::OwnPart;
use super::parts::Parts;
use super::ranges::Ranges;
use crate::control::{Agreement, Concentration, LogConcentration, Reward, VarianceReduction};
use foveate_base::Result;

/// The rewards there are, each with a temperature of its own: the power the likelihood is raised to first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields, remote = "Self")]
#[non_exhaustive]
pub enum RewardConfig {
    /// Σw², the paper's.
    Concentration {
        /// Exponent of the likelihood in the reward, 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// log(N Σw²) / log N.
    LogConcentration {
        /// Exponent of the likelihood in the reward, 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// Overlap of the box from one look with that from all looks of the frame. For several gazes a frame.
    Agreement {
        /// Exponent of the likelihood in the reward, 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// Share of the positional variance that the look removed.
    VarianceReduction {
        /// Exponent of the likelihood in the reward, 0 to 1.
        #[serde(default = "one")]
        temperature: f64,
    },
    /// A registered one.
    #[serde(skip)]
    Own(OwnPart),
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self::VarianceReduction { temperature: 1.0 / 3.0 }
    }
}

fn one() -> f64 {
    1.0
}

impl Ranges for RewardConfig {
    fn ranges(&self) -> Result<()> {
        if matches!(self, Self::Own(_)) {
            return Ok(());
        }
        self.reward(&Parts::new()).map(|_| ())
    }
}

impl RewardConfig {
    /// The reward that it names; registered ones are among `parts`.
    pub(super) fn reward(&self, parts: &Parts) -> Result<Box<dyn Reward>> {
        Ok(match *self {
            Self::Own(ref part) => parts.reward(part)?,
            Self::Agreement { temperature } => Box::new(Agreement::new(temperature)?),
            Self::Concentration { temperature } => Box::new(Concentration::new(temperature)?),
            Self::LogConcentration { temperature } => Box::new(LogConcentration::new(temperature)?),
            Self::VarianceReduction { temperature } => Box::new(VarianceReduction::new(temperature)?),
        })
    }
}
