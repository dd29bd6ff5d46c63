//! How to learn a multi-fixation RBM: the numbers of a training, and their ranges.

use super::Places;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// The objective to minimise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cost {
    /// −log p(x₁..K, y), by CD-1, as in the paper (without y), layer by layer, before a separate classifier.
    Generative,
    /// −log p(y | x₁..K) − α log p(x₁..K, y), the first exact, the second by CD-1 (Larochelle & Hinton 2010, equation 8).
    Hybrid,
    /// Σₖ −log p(y | x₁..k) − α log p(xₖ, y | x₁..k₋₁): every beginning of a sequence counts (equation 9).
    HybridSequential,
}

/// What keeps the gates V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gates {
    /// Any real numbers: the paper's V z.
    Linear,
    /// 0 to 1, by a logistic function of the parameters (Larochelle & Hinton 2010).
    Logistic,
}

/// How to learn: by Adam (Kingma & Ba 2015), with a step that falls linearly to 0, and an exponential mean of the parameters.
///
/// Deviation: Larochelle & Hinton step along the gradient itself at a constant rate (100 times larger for V), and keep the
/// parameters that did best on held-out digits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// n_h.
    pub hidden: usize,
    /// D.
    pub factors: usize,
    /// n_c, 0 for none.
    pub classes: usize,
    /// K (the paper's Δ): fixations of a sequence.
    pub window: usize,
    /// Where fixations fall.
    pub places: Places,
    /// The objective to minimise.
    pub cost: Cost,
    /// α, at least 0; of no effect on [`Cost::Generative`].
    pub alpha: f32,
    /// What keeps V.
    pub gates: Gates,
    /// Passes over the data.
    pub epochs: usize,
    /// Sequences in a mini-batch.
    pub batch: usize,
    /// Adam's first step.
    pub rate: f32,
    /// Pull of F, P and U towards 0, in proportion to them and to the step, apart from Adam's scaling (weight decay as
    /// Loshchilov & Hutter 2019 have it).
    pub l2: f32,
    /// Share of the past in the mean of the parameters that is learned in the end; 0 for the last ones.
    pub average: f32,
    /// Whether the fixations of a sequence are taken in an order of their own every time.
    pub reorder: bool,
    /// Names all random numbers.
    pub seed: u64,
}

impl Recipe {
    /// Larochelle & Hinton's sizes and α, and steps that suit Adam; to be changed field by field.
    pub fn new(cost: Cost, window: usize, classes: usize, places: Places) -> Self {
        Self {
            hidden: 500,
            factors: 250,
            classes,
            window,
            places,
            cost,
            alpha: 0.1,
            gates: Gates::Logistic,
            epochs: 30,
            batch: 100,
            rate: 1e-3,
            l2: 0.01,
            average: 0.999,
            reorder: true,
            seed: 1,
        }
    }
    /// Weights of −log p(y | x) and of −log p(x, y).
    pub(super) fn shares(&self) -> (f32, f32) {
        match self.cost {
            Cost::Generative => (0.0, 1.0),
            Cost::Hybrid | Cost::HybridSequential => (1.0, self.alpha),
        }
    }
    /// Whether every beginning of a sequence counts.
    pub(super) fn sequential(&self) -> bool {
        self.cost == Cost::HybridSequential
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        let fine = |x: f32| x.is_finite() && x >= 0.0;
        let problem = if self.hidden == 0 || self.factors == 0 || self.window == 0 || self.batch == 0 {
            "hidden units, factors, fixations and sequences of a batch must be at least 1"
        } else if self.hidden > 1 << 16 || self.factors > 1 << 16 || self.window > 256 || self.classes > 256 {
            "at most 65536 hidden units and factors, 256 fixations and 256 classes"
        } else if self.classes < 2 && self.cost != Cost::Generative {
            "the hybrid costs need at least two classes"
        } else if ![self.alpha, self.rate, self.l2].into_iter().all(fine) {
            "alpha, the rate and l2 must be finite and not negative"
        } else if !(0.0..1.0).contains(&self.average) {
            "the share of the past in the mean must be at least 0 and under 1"
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training on fixations: {problem}")))
    }
}
