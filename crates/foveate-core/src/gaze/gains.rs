//! The cumulative rewards of gazes and their probabilities: the state of Hedge, the pool and EXP3.

use super::Schedule;
use crate::geometry::Gaze;
use crate::saved_state::{Valid, Validate, ensure};
use foveate_base::rng::Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A gain for each gaze, and p(i) ∝ exp(η G(i)).
#[derive(Clone, Debug)]
pub(super) struct Gains {
    pub(super) gazes: Vec<Gaze>,
    schedule: Schedule,
    pub(super) state: GainsState,
    /// p.
    pub(super) p: Vec<f64>,
}

/// The learned gains; p follows from them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct GainsState {
    /// G, or an estimate of it.
    pub(super) gain: Vec<f64>,
    /// Number of frames learned from.
    frames: u64,
}

impl Validate<Gains> for GainsState {
    fn validate(&self, of: &Gains) -> Valid {
        let (k, found) = (of.gazes.len(), self.gain.len());
        ensure(k == found, || format!("expected the gains of {k} gazes, found {found}"))
    }
}

impl Gains {
    /// Creates gains of 0.
    pub(super) fn new(gazes: Vec<Gaze>, schedule: Schedule) -> Self {
        let (gain, p) = (vec![0.0; gazes.len()], vec![1.0 / gazes.len() as f64; gazes.len()]);
        Self { gazes, schedule, state: GainsState { gain, frames: 0 }, p }
    }
    /// Returns [`Schedule::rate`] of the next frame.
    pub(super) fn rate(&self, known: f64, anytime: f64) -> f64 {
        self.schedule.rate(self.state.frames.saturating_add(1), known, anytime)
    }
    /// Counts one frame.
    pub(super) fn count(&mut self) {
        self.state.frames = self.state.frames.saturating_add(1);
    }
    /// Computes p from the gains. The largest gain is subtracted, so that nothing overflows.
    pub(super) fn weigh(&mut self, eta: f64) {
        let max = self.state.gain.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (p, gain) in self.p.iter_mut().zip(&self.state.gain) {
            *p = (eta * (gain - max)).exp();
        }
        let sum: f64 = self.p.iter().sum();
        self.p.iter_mut().for_each(|p| *p /= sum);
    }
    /// Resets everything except p.
    pub(super) fn reset(&mut self) {
        self.state.gain.fill(0.0);
        self.state.frames = 0;
    }
}

/// Draws an index with these probabilities, which sum to 1 up to rounding.
pub(super) fn draw(probabilities: &[f64], rng: &mut Rng) -> usize {
    let mut left: f64 = rng.random();
    for (k, p) in probabilities.iter().enumerate() {
        left -= p;
        if left < 0.0 {
            return k;
        }
    }
    probabilities.iter().rposition(|&p| p > 0.0).expect("probabilities sum to 1")
}
