//! From the classes of each frame to one decision over time (section 2.2).
//!
//! The paper "accumulates the classification decisions": its authors' program counts how often each class was the
//! most likely one. A sum of log-probabilities also uses the certainty of each frame, and is better with calibrated
//! probabilities.

use crate::saved_state::{Valid, Validate, ensure};
use foveate_base::{Error, Result};
use foveate_kernels::{exp_from, largest_finite};
use serde::{Deserialize, Serialize};

/// Accumulation over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Accumulate {
    /// p(c) ∝ exp Σₜ log pₜ(c), as if frames were independent.
    #[default]
    Sum,
    /// Share of frames with most likely class c, as in the authors' code.
    Count,
    /// As `sum`, but the weight of a frame is (1 − 1/memory)ᵗ after t more frames.
    Forgetting {
        /// Effective number of frames, 1 to a million.
        memory: f64,
    },
}

/// Largest evidence of one frame against a class, in nats.
const MOST: f64 = 1e4;

/// Accumulated evidence for each class.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accumulator {
    rule: Accumulate,
    /// Nats, or frames for `Count`.
    evidence: Vec<f64>,
}

impl Accumulate {
    /// Fails if `memory` is out of range.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Forgetting { memory } if !(1.0..=1e6).contains(memory) => {
                Err(Error::Config(format!("accumulate.forgetting.memory is 1 to 1000000 frames; it is {memory}")))
            }
            _ => Ok(()),
        }
    }
}

impl Accumulator {
    /// Without frames. Fails if the rule's number is out of range, or there are fewer than two classes.
    pub fn new(rule: Accumulate, classes: usize) -> Result<Self> {
        rule.check()?;
        if classes < 2 {
            return Err(Error::Invalid(format!(
                "to recognise is to choose among two classes at least; there are {classes}"
            )));
        }
        Ok(Self { rule, evidence: vec![0.0; classes] })
    }
    /// Takes in log pₜ(c) of one frame, nats.
    pub fn add(&mut self, log_p: &[f64]) {
        assert_eq!(log_p.len(), self.evidence.len(), "a log-probability for each class");
        if self.rule == Accumulate::Count {
            self.evidence[likeliest(log_p)] += 1.0;
            return;
        }
        let kept = if let Accumulate::Forgetting { memory } = self.rule { 1.0 - 1.0 / memory } else { 1.0 };
        for (evidence, q) in self.evidence.iter_mut().zip(log_p) {
            *evidence = kept * *evidence + q.max(-MOST);
        }
    }
    /// p(c | all frames so far); uniform before the first.
    pub fn posterior(&self, out: &mut [f64]) {
        let total: f64 = self.evidence.iter().sum();
        match self.rule {
            Accumulate::Count if total == 0.0 => out.fill(1.0 / out.len() as f64),
            Accumulate::Count => out.iter_mut().zip(&self.evidence).for_each(|(p, count)| *p = count / total),
            _ => {
                let sum = exp_from(&self.evidence, largest_finite(&self.evidence), out);
                out.iter_mut().for_each(|p| *p /= sum);
            }
        }
    }
    /// Discards all frames.
    pub fn reset(&mut self) {
        self.evidence.fill(0.0);
    }
}

impl Validate<Self> for Accumulator {
    /// The settings are an accumulator of the same rule and classes.
    fn validate(&self, of: &Self) -> Valid {
        let n = of.evidence.len();
        let sane = |evidence: &f64| evidence.abs() < 1e18 && (self.rule != Accumulate::Count || *evidence >= 0.0);
        ensure(self.rule == of.rule && self.evidence.len() == n && self.evidence.iter().all(sane), || {
            format!("it is not of {n} classes; continue with the same recogniser")
        })
    }
}

/// The class with the most; the first of several.
pub fn likeliest(values: &[f64]) -> usize {
    (1..values.len()).fold(0, |best, i| if values[i] > values[best] { i } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::saved_state::SavedState;

    /// Three frames of three classes.
    const FRAMES: [[f64; 3]; 3] = [[0.7, 0.2, 0.1], [0.5, 0.3, 0.2], [0.1, 0.8, 0.1]];

    fn after(rule: Accumulate, frames: &[[f64; 3]]) -> [f64; 3] {
        let mut all = Accumulator::new(rule, 3).expect("three classes");
        frames.iter().for_each(|p| all.add(&p.map(f64::ln)));
        let fresh = Accumulator::new(rule, 3).expect("three classes");
        let again: Accumulator = SavedState::new(&all).state("evidence", &fresh).expect("what was saved fits");
        assert_eq!(again, all);
        let mut p = [0.0; 3];
        all.posterior(&mut p);
        p
    }

    fn same(found: [f64; 3], weights: [f64; 3]) {
        let total: f64 = weights.iter().sum();
        assert!(found.iter().zip(weights).all(|(p, w)| (p - w / total).abs() < 1e-12), "{found:?}, not {weights:?}");
    }

    #[test]
    fn a_sum_is_the_product_of_the_frames() {
        same(after(Accumulate::Sum, &FRAMES), [0.7 * 0.5 * 0.1, 0.2 * 0.3 * 0.8, 0.1 * 0.2 * 0.1]);
    }

    #[test]
    fn a_count_is_a_share_of_frames() {
        same(after(Accumulate::Count, &FRAMES), [2.0, 1.0, 0.0]);
        assert_eq!(likeliest(&[0.2, 0.4, 0.4]), 1, "the first of several");
    }

    #[test]
    fn old_frames_fade_by_powers() {
        let rule = Accumulate::Forgetting { memory: 4.0 };
        let weigh = |c: usize| FRAMES[0][c].powf(0.75f64.powi(2)) * FRAMES[1][c].powf(0.75) * FRAMES[2][c];
        same(after(rule, &FRAMES), [weigh(0), weigh(1), weigh(2)]);
        // Of frames that are all alike, as many count as it remembers.
        let same_again = [FRAMES[0]; 400];
        same(after(rule, &same_again), FRAMES[0].map(|p| p.powi(4)));
        same(after(Accumulate::Forgetting { memory: 1.0 }, &FRAMES), FRAMES[2]);
    }

    #[test]
    fn classes_are_uniform_before_the_first_frame_and_errors_are_refused() {
        for rule in [Accumulate::Sum, Accumulate::Count, Accumulate::Forgetting { memory: 9.0 }] {
            same(after(rule, &[]), [1.0; 3]);
        }
        same(after(Accumulate::Sum, &[[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]]), [1.0, 0.0, 0.0]);
        let [three, two] = [3, 2].map(|n| Accumulator::new(Accumulate::Sum, n).expect("classes"));
        assert!(two.validate(&three).is_err());
        assert!(Accumulator::new(Accumulate::Forgetting { memory: 0.5 }, 3).is_err());
        assert!(Accumulator::new(Accumulate::Sum, 1).is_err());
    }
}
