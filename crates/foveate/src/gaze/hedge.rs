//! Hedge (section 4.2, Algorithm 2; Freund & Schapire 1997): full information over a few gazes.
//!
//! pₜ(i) ∝ exp(γ Gₜ₋₁(i)), with G the sum of a gaze's rewards. Every gaze is scored each frame, one is drawn
//! from pₜ and used. With γ = √(8 ln K / T) the expected reward over T frames lies within √(T ln K / 2) of the
//! best single gaze's, whatever the rewards (Cesa-Bianchi & Lugosi 2006, theorem 2.2).

use super::{Plan, Policy, Portrait, misfit};
use crate::geometry::Gaze;
use crate::rng::Rng;
use crate::{Error, Result};
use rand::RngExt;
use serde_json::{Value, json};

/// Weighs gazes by the exponential of what they earned.
#[derive(Clone, Debug)]
pub struct Hedge {
    gazes: Vec<Gaze>,
    gamma: f64,
    gain: Vec<f64>,
    probabilities: Vec<f64>,
}

impl Hedge {
    /// Over these gazes (one at least), with learning rate `gamma` > 0 on rewards in [0, 1].
    pub fn new(gazes: Vec<Gaze>, gamma: f64) -> Result<Self> {
        if gazes.is_empty() {
            return Err(Error::Config("hedge needs one gaze at least to choose from".into()));
        }
        if !(gamma > 0.0 && gamma.is_finite()) {
            return Err(Error::Config(format!("hedge: gamma, the learning rate, is above 0; it is {gamma}")));
        }
        let k = gazes.len();
        Ok(Self { gazes, gamma, gain: vec![0.0; k], probabilities: vec![1.0 / k as f64; k] })
    }
    /// The learning rate with the best bound for `k` gazes over a known number of frames: √(8 ln K / T).
    pub fn gamma_for(k: usize, frames: usize) -> f64 {
        (8.0 * (k.max(2) as f64).ln() / frames.max(1) as f64).sqrt()
    }
    /// pₜ from Gₜ₋₁; the largest gain is subtracted, so nothing overflows.
    fn weigh(&mut self) {
        let max = self.gain.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (p, gain) in self.probabilities.iter_mut().zip(&self.gain) {
            *p = (self.gamma * (gain - max)).exp();
        }
        let sum: f64 = self.probabilities.iter().sum();
        self.probabilities.iter_mut().for_each(|p| *p /= sum);
    }
}

/// Draws an index with these probabilities, which sum to 1 but for rounding.
fn draw(probabilities: &[f64], rng: &mut Rng) -> usize {
    let mut left: f64 = rng.random();
    for (k, p) in probabilities.iter().enumerate() {
        left -= p;
        if left < 0.0 {
            return k;
        }
    }
    probabilities.iter().rposition(|&p| p > 0.0).expect("probabilities sum to 1")
}

impl Policy for Hedge {
    fn plan(&mut self, plan: &mut Plan, rng: &mut Rng) {
        plan.all(&self.gazes, draw(&self.probabilities, rng));
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        assert_eq!(plan.gazes(), &self.gazes[..], "Hedge learns from the plan it made: all its gazes, in their order");
        assert_eq!(rewards.len(), self.gain.len(), "one reward for each gaze");
        for (gain, reward) in self.gain.iter_mut().zip(rewards) {
            *gain += reward;
        }
        self.weigh();
    }
    fn portrait(&self) -> Portrait<'_> {
        Portrait::Arms { gazes: &self.gazes, probabilities: &self.probabilities }
    }
    fn save(&self) -> Value {
        json!({ "gain": self.gain })
    }
    fn load(&mut self, saved: &Value) -> Result<()> {
        let numbers = |v: &Value| v.as_array()?.iter().map(|g| g.as_f64().filter(|g| g.is_finite())).collect();
        let gain: Option<Vec<f64>> = numbers(&saved["gain"]);
        let gain = gain.filter(|gain| gain.len() == self.gazes.len());
        self.gain = gain.ok_or_else(|| misfit(&format!("the gains of {} gazes", self.gazes.len()), saved))?;
        self.weigh();
        Ok(())
    }
    fn reset(&mut self) {
        self.gain.fill(0.0);
        self.weigh();
    }
}
