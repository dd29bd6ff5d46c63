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
    /// A multi-fixation RBM over the last few looks (section 2.2), with the retina and first layer it was trained on.
    MultiFixation {
        /// A model file of `foveate train fixations`, or `builtin:` and the name of one that ships with the program.
        weights: String,
        /// How frames add up.
        #[serde(default)]
        accumulate: Accumulate,
        /// Where it looks; left out, at random among the places it was trained at.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        policy: Option<PolicyConfig>,
        /// Whether a class that is no longer seen means that the target is lost; without it, the track is the same as without a
        /// recogniser.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        alarm: bool,
    },
    /// A classifier of single looks at the middle, with the retina and first layer it was trained on; its classes have names.
    Classifier {
        /// A model file of `foveate train classifier`.
        weights: String,
        /// How frames add up. The frames of a track are alike, and a classifier that is wrong of one is wrong of the next: unless
        /// told otherwise, no more than the last few count.
        #[serde(default = "a_few")]
        accumulate: Accumulate,
    },
}

fn a_few() -> Accumulate {
    Accumulate::Forgetting { memory: 3.0 }
}

impl RecogniserConfig {
    /// What a model file or a name after `builtin:` stands for, its other settings as usual. A file that
    /// cannot be read is told of when it is used.
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
