//! Names → recognisers.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::policies::PolicyConfig;
use super::ranges::Ranges;
use crate::identity::Classifier;
use crate::identity::accumulate::Accumulate;
use foveate_base::Result;
use foveate_base::files::Files;

/// The recognisers there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum RecogniserConfig {
    /// A multi-fixation RBM over the last looks (section 2.2), with the retina and first layer of its training.
    MultiFixation {
        /// A file of `foveate train fixations`, or `builtin:NAME`.
        weights: String,
        /// Accumulation over frames.
        #[serde(default)]
        accumulate: Accumulate,
        /// Its gaze policy; by default random among the places of its training.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        policy: Option<PolicyConfig>,
        /// Whether a change of class counts as evidence of loss.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        alarm: bool,
    },
    /// A classifier of single looks at the middle, with the retina and first layer of its training.
    Classifier {
        /// A file of `foveate train classifier`.
        weights: String,
        /// Accumulation over frames; by default over a few, because errors of neighbouring frames are correlated.
        #[serde(default = "a_few")]
        accumulate: Accumulate,
    },
}

fn a_few() -> Accumulate {
    Accumulate::Forgetting { memory: 3.0 }
}

impl RecogniserConfig {
    /// Returns the settings for a model file or a name after `builtin:`, with defaults for the others. A file that cannot be read causes
    /// an error when the recogniser is made.
    pub fn of_model(weights: &str, files: &dyn Files) -> Self {
        let bytes = match weights.starts_with("builtin:") {
            true => vec![],
            false => files.read(Path::new(weights)).unwrap_or_default(),
        };
        if Classifier::is_one(&bytes) {
            return Self::Classifier { weights: weights.into(), accumulate: a_few() };
        }
        Self::multi_fixation(weights)
    }

    /// This model, summing log-probabilities, looking at random among its places.
    pub fn multi_fixation(weights: impl Into<String>) -> Self {
        Self::MultiFixation { weights: weights.into(), accumulate: Accumulate::Sum, policy: None, alarm: false }
    }
}

impl Ranges for RecogniserConfig {
    fn ranges(&self) -> Result<()> {
        match self {
            Self::MultiFixation { accumulate, policy, .. } => {
                accumulate.check()?;
                policy.as_ref().map_or(Ok(()), PolicyConfig::recognises)?;
                policy.ranges()
            }
            Self::Classifier { accumulate, .. } => accumulate.check(),
        }
    }
}
