//! The cumulative rewards of gazes and their probabilities: the state of Hedge, the pool and EXP3.

use super::{Schedule, misfit};
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::Result;
use foveate_base::rng::Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A gain for each gaze, and p(i) ∝ exp(η G(i)).
#[derive(Clone, Debug)]
pub(super) struct Gains {
    pub(super) gazes: Vec<Gaze>,
    schedule: Schedule,
    /// G, or an estimate of it.
    pub(super) gain: Vec<f64>,
    /// Number of frames learned from.
    frames: u64,
    /// p.
    pub(super) p: Vec<f64>,
}

impl Gains {
    /// Creates gains of 0.
    pub(super) fn new(gazes: Vec<Gaze>, schedule: Schedule) -> Self {
        let (gain, p) = (vec![0.0; gazes.len()], vec![1.0 / gazes.len() as f64; gazes.len()]);
        Self { gazes, schedule, gain, frames: 0, p }
    }
    /// Returns [`Schedule::rate`] of the next frame.
    pub(super) fn rate(&self, known: f64, anytime: f64) -> f64 {
        self.schedule.rate(self.frames.saturating_add(1), known, anytime)
    }
    /// Counts one frame.
    pub(super) fn count(&mut self) {
        self.frames = self.frames.saturating_add(1);
    }
    /// Computes p from the gains. The largest gain is subtracted, so that nothing overflows.
    pub(super) fn weigh(&mut self, eta: f64) {
        let max = self.gain.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (p, gain) in self.p.iter_mut().zip(&self.gain) {
            *p = (eta * (gain - max)).exp();
        }
        let sum: f64 = self.p.iter().sum();
        self.p.iter_mut().for_each(|p| *p /= sum);
    }
    /// Returns gains and frames; p follows from them.
    pub(super) fn save(&self) -> SavedState {
        SavedState::new(&Saved { gain: self.gain.clone(), frames: self.frames })
    }
    /// Restores the gains and frames that [`Gains::save`] returned, but not p.
    pub(super) fn load(&mut self, saved: &SavedState) -> Result<()> {
        let k = self.gazes.len();
        let Saved { gain, frames } = saved
            .read()
            .ok()
            .filter(|it: &Saved| it.gain.len() == k && it.gain.iter().all(|g| g.is_finite()))
            .ok_or_else(|| misfit(&format!("the gains of {k} gazes and a number of frames"), saved))?;
        (self.gain, self.frames) = (gain, frames);
        Ok(())
    }
    /// Resets everything except p.
    pub(super) fn reset(&mut self) {
        self.gain.fill(0.0);
        self.frames = 0;
    }
}

/// The saved state of [`Gains`].
#[derive(Serialize, Deserialize)]
struct Saved {
    gain: Vec<f64>,
    frames: u64,
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
