//! EXP3 and its relatives: bandits that receive the reward of one gaze per frame; their bounds hold for any rewards.
//!
//! All keep an estimate Ĝ of each gaze's total reward, weigh gazes by p(i) ∝ exp(η Ĝ(i)) and draw one, i, with p̂(i):
//!
//! | [`Variant`] | drawn with p̂(j) | Ĝ(i) grows by | η |
//! | --- | --- | --- | --- |
//! | `Unbiased` (Auer et al. 2002, section 3) | (1 − γ) p(j) + γ/K | r / p̂(i) | γ/K |
//! | `AsPrinted` (section 4.3) | the same | r / p(i) | γ |
//! | `Implicit` (Neu 2015, EXP3-IX) | p(j) | −(1 − r) / (p(i) + γ) | 2γ |
//! | `Sharing` (Auer et al. 2002, section 8, EXP3.S) | as `Unbiased` | r / p̂(i), then all share eα/K of the sum of weights | γ/K |
//!
//! Regret against the best single gaze over T frames, with γ for T frames: expected 2 √((e − 1) T K ln K) for `Unbiased`; `Implicit` 2 √(2
//! T K ln K) + (√(2 T K / ln K) + 1) ln(2/δ) with probability 1 − δ. `Sharing` competes with the best sequence of gazes that changes
//! occasionally.

use super::gains::{Gains, GainsState, draw};
use super::{Context, Plan, Policy, PolicySnapshot, Schedule};
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};
use std::f64::consts::E;

/// Least divisor for the paper's p(i), which underflows within minutes and would make the reward infinite.
const LEAST: f64 = 1e-12;

/// Rule that turns a reward into an estimate; see the table above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variant {
    /// EXP3: divides by the probability of the draw, so that the mean of the estimate is the reward.
    Unbiased,
    /// Deviation, the paper's: Algorithm 2 divides by Hedge's p instead; the estimate explodes if p is small.
    AsPrinted,
    /// EXP3-IX: explores by damping the estimates instead of by random draws. Its bound holds with high probability, not only in
    /// expectation.
    Implicit,
    /// EXP3.S: no weight falls below a share α of the sum, above 0 to 1, for rewards that change.
    Sharing(f64),
}

/// Weighs gazes by the exponential of their estimated rewards.
#[derive(Clone, Debug)]
pub struct Exp3 {
    variant: Variant,
    /// Ĝ and p; for `Sharing`, Ĝ is the logarithm of weights whose largest is 1.
    gains: Gains,
    /// p̂.
    mixed: Vec<f64>,
}

impl Exp3 {
    /// Creates a policy over these gazes (at least one), with γ above 0 to 1 on rewards in [0, 1].
    ///
    /// `AsPrinted` needs a fixed γ, because no theorem gives one. `Sharing` takes γ as `Unbiased` does; for a known number of changes see
    /// [`Exp3::sharing_for`].
    pub fn new(gazes: Vec<Gaze>, variant: Variant, gamma: impl Into<Schedule>) -> Result<Self> {
        let gamma = gamma.into();
        gamma.check("exp3: gamma, the share of exploration,", 1.0)?;
        let wrong = match variant {
            _ if gazes.is_empty() => "exp3 needs one gaze at least to choose from".into(),
            Variant::Sharing(share) if !(1e-9..=1.0).contains(&share) => {
                format!("exp3-s: share, what all gazes get of the weight, is from 1e-9 to 1; it is {share}")
            }
            Variant::AsPrinted if !matches!(gamma, Schedule::Fixed(_)) => {
                "exp3-as-printed: gamma is a number from 1e-9 to 1, for no theorem chooses one".into()
            }
            _ => {
                let mixed = vec![0.0; gazes.len()];
                let mut policy = Self { variant, gains: Gains::new(gazes, gamma), mixed };
                policy.weigh();
                return Ok(policy);
            }
        };
        Err(Error::Config(wrong))
    }
    /// Returns γ and share of EXP3.S for `k` gazes, if the best gaze changes `changes` times in `frames` frames. The regret against the
    /// best such sequence is 2 √((e − 1) K T ((changes + 1) ln(KT) + e)) (Auer et al. 2002, corollary 8.3).
    pub fn sharing_for(k: usize, frames: usize, changes: usize) -> (f64, f64) {
        let (k, t) = (k as f64, frames.max(1) as f64);
        let gamma = (k * ((changes + 1) as f64 * (k * t).ln() + E) / ((E - 1.0) * t)).sqrt();
        (gamma.min(1.0), 1.0 / t)
    }
    /// Returns γ and η of the next frame.
    fn rates(&self) -> (f64, f64) {
        let k = self.gains.gazes.len() as f64;
        let log_k = k.max(2.0).ln();
        match self.variant {
            Variant::Implicit => {
                let gamma = self.gains.rate(log_k / (2.0 * k), log_k / (4.0 * k));
                (gamma, 2.0 * gamma)
            }
            // Deviation: Auer et al. start again with each guess of the rewards' sum (section 4). A γ that falls as 1/√t also has regret K
            // ln K/γ + (e − 1) Σγ at most, here 2 √(2 (e − 1) T K ln K), and never restarts.
            _ => {
                let gamma = self.gains.rate(k * log_k / (E - 1.0), k * log_k / (2.0 * (E - 1.0))).min(1.0);
                (gamma, if self.variant == Variant::AsPrinted { gamma } else { gamma / k })
            }
        }
    }
    /// Computes p and p̂ of the next frame.
    fn weigh(&mut self) {
        let (gamma, eta) = self.rates();
        self.gains.weigh(if let Variant::Sharing(_) = self.variant { 1.0 } else { eta });
        let gamma = if self.variant == Variant::Implicit { 0.0 } else { gamma };
        let k = self.mixed.len() as f64;
        for (p, mixed) in self.gains.p.iter().zip(&mut self.mixed) {
            *mixed = (1.0 - gamma) * *p + gamma / k;
        }
    }
}

impl Policy for Exp3 {
    fn plan(&mut self, _: &Context, plan: &mut Plan, rng: &mut Rng) {
        plan.only(self.gains.gazes[draw(&self.mixed, rng)]);
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        let (&[gaze], &[reward]) = (plan.gazes(), rewards) else { panic!("EXP3 learns from the one gaze it planned") };
        let drawn = self.gains.gazes.iter().position(|&g| g == gaze).expect("EXP3 plays only the gazes it was given");
        let (gamma, eta) = self.rates();
        let Gains { state: GainsState { gain, .. }, p, .. } = &mut self.gains;
        match self.variant {
            Variant::Unbiased => gain[drawn] += reward / self.mixed[drawn],
            Variant::AsPrinted => gain[drawn] += reward / p[drawn].max(LEAST),
            Variant::Implicit => gain[drawn] -= (1.0 - reward) / (p[drawn] + gamma),
            Variant::Sharing(share) => {
                // In logarithms, because weights may underflow or overflow.
                let log_sum = gain.iter().map(|gain| gain.exp()).sum::<f64>().ln();
                let log_shared = (E * share / gain.len() as f64).ln() + log_sum;
                gain[drawn] += eta * reward / self.mixed[drawn];
                for gain in &mut *gain {
                    *gain = gain.max(log_shared) + (-(*gain - log_shared).abs()).exp().ln_1p();
                }
                let max = gain.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                gain.iter_mut().for_each(|gain| *gain -= max);
            }
        }
        self.gains.count();
        self.weigh();
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: &self.gains.gazes, probabilities: &self.mixed }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&self.gains.state)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        self.gains.state = saved.state("policy", &self.gains)?;
        self.weigh();
        Ok(())
    }
    fn reset(&mut self) {
        self.gains.reset();
        self.weigh();
    }
}

#[cfg(test)]
mod oracle_tests;

#[cfg(test)]
mod tests {
    use super::oracle_tests::{VARIANTS, exp3};
    use super::*;
    use crate::conformance;

    #[test]
    fn all_variants_conform() {
        for variant in VARIANTS {
            conformance::policy(&move || Box::new(exp3(variant, 0.2)));
            conformance::policy(&move || Box::new(exp3(variant, 1.0)));
            conformance::policy(&move || {
                Box::new(Exp3::new(vec![Gaze::CENTRE], variant, 0.5).expect("one gaze will do"))
            });
            for gamma in
                [Schedule::Anytime, Schedule::Frames(100)].into_iter().filter(|_| variant != Variant::AsPrinted)
            {
                conformance::policy(&move || Box::new(exp3(variant, gamma)));
            }
            assert!(Exp3::new(vec![], variant, 0.5).is_err());
            for wrong in [0.0, -1.0, 1.1, f64::NAN, f64::INFINITY] {
                assert!(Exp3::new(vec![Gaze::CENTRE], variant, wrong).is_err());
            }
        }
        assert!(Exp3::new(vec![Gaze::CENTRE], Variant::AsPrinted, Schedule::Anytime).is_err());
        assert!([0.0, 1.5, f64::NAN].iter().all(|&s| Exp3::new(vec![Gaze::CENTRE], Variant::Sharing(s), 0.1).is_err()));
    }
}
