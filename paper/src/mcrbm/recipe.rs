//! Training settings and their ranges.

use super::MOST;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Training settings. Learning rates are those of the authors' code, all multiplied by `rate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Recipe {
    /// n_f; the square of an even number for pooling over a grid.
    pub factors: usize,
    /// The initial factors of a covariance unit.
    pub pooling: Pooling,
    /// n_m.
    pub means: usize,
    /// Fraction of the glimpses' variance that whitening keeps.
    pub keep: f64,
    /// Passes over the data.
    pub epochs: usize,
    /// Rows in a mini-batch; rows that do not fill one wait for the next epoch.
    pub batch: usize,
    /// Learning rate for the mean gradient of a batch; C moves 2 rates, W 0.2, bᵐ 0.1, P, bᶜ and bᵛ 0.02.
    pub rate: f32,
    /// The epoch (from 1) after which the rate falls as 1 / epoch.
    pub anneal: usize,
    /// The start of the chains of the negative phase.
    pub negative: Negative,
    /// Leapfrog steps of a proposal, at least 1.
    pub leapfrog_steps: usize,
    /// Target rejection rate.
    pub rejection: f32,
    /// The epoch (from 0) from which `l1` applies: not before the filters have settled.
    pub settle: usize,
    /// The epoch (from 0) from which P is learned; `None` for never. Deviation: the authors learn it after 10 epochs. On glimpses every
    /// unit then pools a little of every factor, and all units become alike.
    pub learn_pooling: Option<usize>,
    /// L1 weight decay of C and W.
    pub l1: f32,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// The initial factors of a covariance unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Pooling {
    /// One factor per unit: P = identity.
    Single,
    /// A neighbourhood of 3 × 3 on a torus of factors, one unit for every second row and column: neighbours become alike.
    Grid,
}

/// The start of the chains of the negative phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Negative {
    /// At the rows of the batch (the article).
    Contrastive,
    /// The end of the chains in the previous batch (the authors' code).
    Persistent,
}

impl Recipe {
    /// Returns settings for tests, to be changed field by field.
    #[cfg(test)]
    pub(crate) fn new(factors: usize, means: usize) -> Self {
        Self {
            factors,
            pooling: Pooling::Single,
            means,
            keep: 0.99,
            epochs: 50,
            batch: 128,
            rate: 0.075,
            anneal: 20,
            negative: Negative::Persistent,
            leapfrog_steps: 20,
            rejection: 0.1,
            settle: 10,
            learn_pooling: None,
            l1: 0.001,
            seed: 1,
        }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        let side = self.factors.isqrt();
        let counts = [self.factors, self.means, self.batch, self.leapfrog_steps];
        let problem = if counts.contains(&0) || self.factors > MOST || self.means > MOST {
            format!("factors and mean units are 1 to {MOST}, rows of a batch and leapfrog steps at least 1")
        } else if self.pooling == Pooling::Grid && (side * side != self.factors || side < 4 || !side.is_multiple_of(2))
        {
            format!(
                "pooling over a grid needs the square of an even number of factors (16, 36, 64, ...), got {}",
                self.factors
            )
        } else if !(self.keep > 0.0 && self.keep <= 1.0) {
            "the share of variance to keep is above 0 and at most 1".into()
        } else if ![self.rate, self.l1].iter().all(|x| x.is_finite() && *x >= 0.0) {
            "the rate and l1 must be finite and not negative".into()
        } else if !(self.rejection > 0.0 && self.rejection < 1.0) {
            "the share of rejected proposals is between 0 and 1".into()
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training: {problem}")))
    }
    /// Returns the initial P, n_f × n_c, with columns of sum 1, and n_c.
    pub(super) fn first_pooling(&self) -> (Vec<f32>, usize) {
        let n = self.factors;
        match self.pooling {
            Pooling::Single => ((0..n * n).map(|e| f32::from(u8::from(e / n == e % n))).collect(), n),
            Pooling::Grid => {
                let side = n.isqrt();
                let half = side / 2;
                let near = |a: usize, b: usize| (a + side + 1 - b) % side < 3;
                let entry = |f: usize, k: usize| near(f / side, 2 * (k / half)) && near(f % side, 2 * (k % half));
                let units = half * half;
                ((0..n * units).map(|e| if entry(e / units, e % units) { 1.0 / 9.0 } else { 0.0 }).collect(), units)
            }
        }
    }
}
