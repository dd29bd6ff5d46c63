//! How to learn: the numbers of a training, and their ranges.

use super::Visible;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// The most hidden units, rows of a batch, and chains.
const MOST: usize = 1 << 16;

/// How to learn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The kind of the visible units.
    pub visible: Visible,
    /// n_h.
    pub hidden: usize,
    /// Passes over the data.
    pub epochs: usize,
    /// Rows in a mini-batch.
    pub batch: usize,
    /// Whether every epoch takes the rows in an order of its own; else in the order of the data.
    pub shuffle: bool,
    /// Step along the mean gradient of a batch.
    pub rate: f32,
    /// 0 to 1 (exclusive): velocity = momentum · velocity + (1 − momentum) · rate · gradient, so that the rate means the same
    /// with any momentum. At most 0.5 in the first 5 epochs.
    pub momentum: f32,
    /// How the model's own statistics are estimated.
    pub negative: Negative,
    /// Pull of the weights towards 0, in proportion to them.
    pub l2: f32,
    /// Pull of the weights towards 0, of constant size.
    pub l1: f32,
    /// Pull of the hidden units' mean activity towards a target.
    pub sparsity: Option<Sparsity>,
    /// The epoch, from 0, at which averaging of the parameters over all batches begins (Polyak & Juditsky 1992). The
    /// learned machine is that mean.
    pub average_from: Option<usize>,
    /// Standard deviation of the first weights.
    pub initial_sd: f32,
    /// Names all random numbers.
    pub seed: u64,
}

/// How the model's own statistics are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Negative {
    /// CD: from the data's hidden states. Reconstructions are means, as is usual; only hidden units are drawn.
    Contrastive {
        /// k, at least 1.
        steps: usize,
    },
    /// SML: from chains that continue from batch to batch. All units are drawn.
    Persistent {
        /// Number of chains.
        chains: usize,
        /// Gibbs steps a batch, at least 1.
        steps: usize,
    },
}

/// A target for the mean activity of every hidden unit; moves the hidden biases (Lee, Ekanadham & Ng 2008).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sparsity {
    /// Mean activity aimed at, in (0, 1).
    pub target: f32,
    /// Weight of (target − activity) beside the gradient of the log-likelihood.
    pub cost: f32,
}

impl Recipe {
    /// CD-1 in the usual settings, to be changed field by field.
    pub fn new(visible: Visible, hidden: usize) -> Self {
        Self {
            visible,
            hidden,
            epochs: 15,
            batch: 100,
            shuffle: true,
            rate: if visible == Visible::Bernoulli { 0.1 } else { 0.02 },
            momentum: 0.9,
            negative: Negative::Contrastive { steps: 1 },
            l2: 2e-4,
            l1: 0.0,
            sparsity: None,
            average_from: None,
            initial_sd: 0.01,
            seed: 1,
        }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        let positive = |x: f32| x.is_finite() && x >= 0.0;
        let (chains, steps) = match self.negative {
            Negative::Contrastive { steps } => (1, steps),
            Negative::Persistent { chains, steps } => (chains, steps),
        };
        let problem = if self.hidden == 0 || self.batch == 0 || chains == 0 || steps == 0 {
            "hidden units, rows of a batch, chains and Gibbs steps must be at least 1"
        } else if self.hidden.max(self.batch).max(chains) > MOST {
            "hidden units, rows of a batch and chains must be at most 65536"
        } else if !(0.0..1.0).contains(&self.momentum) {
            "momentum must be at least 0 and under 1"
        } else if ![self.rate, self.l1, self.l2, self.initial_sd].into_iter().all(positive) {
            "the rate, l1, l2 and the first weights' deviation must be finite and not negative"
        } else if !self.sparsity.is_none_or(|s| s.target > 0.0 && s.target < 1.0 && positive(s.cost)) {
            "sparsity needs a target between 0 and 1 and a cost that is not negative"
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training: {problem}")))
    }
}
