//! A short-term memory: learns from frames that are not consistent enough for the long-term memory.
//!
//! A target that turns looks less like frame 1 for a while, and so does one that is being occluded. A discriminant
//! that learns from both follows the first and drifts onto the occluder; one that learns from neither loses the
//! first. So there are two: the short-term discriminant learns from more frames and moves the box; the long-term one
//! learns from consistent frames only, and decides whether the target is lost, so that doubtful frames cannot confirm
//! themselves. Once the target is reported as occluded or lost, the short-term memory is reset. While both have
//! learned the same frames, only one is stored.
//!
//! Deviation: the paper has one template. Short-term and long-term stores: Hong et al., MUSTer (2015); filters of two rates: Ma et
//! al. (2015).

use serde::{Deserialize, Serialize};

use super::ridge::{Learning, Regression, STEPS, Sums};
use crate::identity::numbers::floats;
use foveate_base::Result;
use foveate_base::error::within;

/// Settings of the short-term memory: from which frames it learns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShortTerm {
    /// Smoothed deficit above which it does not learn, 0 to 100.
    pub threshold: f64,
    /// Deficit of one frame above which it does not learn, 0 to 2.
    pub gate: f64,
}

impl Default for ShortTerm {
    fn default() -> Self {
        Self { threshold: 0.7, gate: 1.5 }
    }
}

impl ShortTerm {
    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        within("short_term.threshold", self.threshold, 0.0, 100.0)?;
        within("short_term.gate", self.gate, 0.0, 2.0)
    }
}

/// Weight of the difference below which both are treated as equal again.
const SAME: f64 = 0.01;

/// The sums of more frames, and the weights they give.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Recent {
    pub sums: Sums,
    #[serde(with = "floats")]
    pub weights: Vec<f32>,
    /// Weight of the difference of both; `None` while they are equal.
    pub apart: Option<f64>,
    /// Whether it is suspended: the long-term one is then used.
    #[serde(skip)]
    pub aside: bool,
}

impl Recent {
    /// With room for as much as there is.
    pub(super) fn new(sums: &Sums, weights: &[f32]) -> Self {
        Self { sums: sums.clone(), weights: weights.to_vec(), apart: None, aside: false }
    }

    pub(super) fn forget(&mut self) {
        self.apart = None;
    }

    /// Learns the frame that the long-term one has just learned.
    pub(super) fn learn_too(&mut self, regression: &Regression, begun: &Sums, learning: &mut Learning) {
        let Some(apart) = self.apart else { return };
        self.learn(regression, begun, learning);
        let left = apart * (1.0 - regression.settings.learning_rate);
        self.apart = (left > SAME).then_some(left);
    }

    pub(super) fn learn(&mut self, regression: &Regression, begun: &Sums, learning: &mut Learning) {
        self.sums.learn(learning, self.weights.len(), regression.settings.fading());
        regression.solve(begun, &self.sums, &mut self.weights, learning, STEPS.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_checked() {
        assert!(ShortTerm::default().check().is_ok());
        let wrong = ShortTerm { gate: 3.0, ..ShortTerm::default() };
        assert!(wrong.check().expect_err("out of range").to_string().contains("short_term.gate"));
    }
}
