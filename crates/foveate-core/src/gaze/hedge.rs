//! Hedge (section 4.2; Freund & Schapire 1997): full information over a few gazes.
//!
//! pₜ(i) ∝ exp(γ Gₜ₋₁(i)); G is the sum of a gaze's rewards. Every gaze is scored each frame, one is drawn from pₜ and used. With γ = √(8
//! ln K / T) the expected reward over T frames lies within √(T ln K / 2) of that of the best single gaze, for any rewards (Cesa-Bianchi &
//! Lugosi 2006, theorem 2.2).

use super::gains::{Gains, GainsState, draw};
use super::{Context, Plan, Policy, PolicySnapshot, Schedule};
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};

/// Weighs gazes by the exponential of their cumulative rewards.
#[derive(Clone, Debug)]
pub struct Hedge {
    gains: Gains,
    /// Fraction by which the gains decay each frame.
    forget: f64,
}

impl Hedge {
    /// Creates a policy over these gazes (at least one), with learning rate `gamma` > 0 on rewards in [0, 1].
    pub fn new(gazes: Vec<Gaze>, gamma: impl Into<Schedule>) -> Result<Self> {
        let gamma = gamma.into();
        if gazes.is_empty() {
            return Err(Error::Config("hedge needs one gaze at least to choose from".into()));
        }
        gamma.check("hedge: gamma, the learning rate,", 1e9)?;
        Ok(Self { gains: Gains::new(gazes, gamma), forget: 0.0 })
    }
    /// Returns the learning rate with the best bound for `k` gazes over a known number of frames: √(8 ln K / T).
    pub fn gamma_for(k: usize, frames: usize) -> f64 {
        (8.0 * (k.max(2) as f64).ln() / frames.max(1) as f64).sqrt()
    }
    /// Sets the fraction by which the gains decay each frame, 0 to 1; the default is 0.
    pub(super) fn fading(self, forget: f64) -> Self {
        Self { forget, ..self }
    }
    /// Returns the gazes, and the probability of each.
    pub(super) fn shares(&self) -> impl Iterator<Item = (Gaze, f64)> {
        self.gains.gazes.iter().copied().zip(self.gains.p.iter().copied())
    }
    /// Computes pₜ from Gₜ₋₁.
    fn weigh(&mut self) {
        let log_k = (self.gains.gazes.len().max(2) as f64).ln();
        self.gains.weigh(self.gains.rate(8.0 * log_k, 4.0 * log_k));
    }
}

impl Policy for Hedge {
    fn plan(&mut self, _: &Context, plan: &mut Plan, rng: &mut Rng) {
        plan.all(&self.gains.gazes, draw(&self.gains.p, rng));
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        let Gains { gazes, state: GainsState { gain, .. }, .. } = &mut self.gains;
        assert_eq!(plan.gazes(), &gazes[..], "Hedge learns from the plan it made: all its gazes, in their order");
        assert_eq!(rewards.len(), gain.len(), "one reward for each gaze");
        for (gain, reward) in gain.iter_mut().zip(rewards) {
            *gain += reward - self.forget * *gain;
        }
        self.gains.count();
        self.weigh();
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: &self.gains.gazes, probabilities: &self.gains.p }
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
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::Grid;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;
    use serde_json::json;

    fn hedge(gamma: impl Into<Schedule>) -> Hedge {
        Hedge::new(Grid::default().gazes(), gamma).expect("nine gazes and a positive rate")
    }

    #[test]
    fn hedge_conforms() {
        conformance::policy(&|| Box::new(hedge(0.5)));
        conformance::policy(&|| Box::new(hedge(Schedule::Anytime)));
        conformance::policy(&|| Box::new(hedge(Schedule::Frames(50))));
        conformance::policy(&|| Box::new(Hedge::new(vec![Gaze::CENTRE], 5.0).expect("one gaze will do")));
        assert!(Hedge::new(vec![], 1.0).is_err());
        assert!([0.0, -1.0, f64::NAN, f64::INFINITY].iter().all(|&g| Hedge::new(vec![Gaze::CENTRE], g).is_err()));
        let mut policy = hedge(0.5);
        assert!(
            policy.load(&SavedState::new(&json!({ "gain": [1.0, 2.0], "frames": 2 }))).is_err(),
            "nine gazes, two gains"
        );
    }

    /// The theorem holds for every sequence, so there is no slack: adversaries that see pₜ, drifting rewards and random ones.
    #[test]
    fn regret_is_within_the_theorem() {
        const K: usize = 9;
        let pick = |p: &[f64], better: fn(f64, f64) -> bool| {
            (1..K).fold(0, |best, k| if better(p[k], p[best]) { k } else { best })
        };
        type Adversary<'a> = &'a mut dyn FnMut(usize, &[f64], usize) -> f64; // (t, pₜ, arm) to reward
        let mut rng = Streams::new(6, 0).at(0, Purpose::Look).rng(0);
        let adversaries: [(&str, Adversary<'_>); 5] = [
            ("pays the least likely", &mut |_, p, k| f64::from(k == pick(p, |a, b| a < b))),
            ("robs the most likely", &mut |_, p, k| f64::from(k != pick(p, |a, b| a > b))),
            ("coins", &mut |_, _, _| f64::from(rng.random::<bool>())),
            ("one arm, slightly better", &mut |t, _, k| if k == 3 { 0.6 } else { ((t + k) % 2) as f64 }),
            ("switches half-way", &mut |t, _, k| f64::from(k == if t < 500 { 1 } else { 7 })),
        ];
        for (name, adversary) in adversaries {
            for (frames, anytime) in [(10, false), (100, false), (1000, false), (10, true), (100, true), (1000, true)] {
                let known = Schedule::Fixed(Hedge::gamma_for(K, frames));
                let mut policy = hedge(if anytime { Schedule::Anytime } else { known });
                let mut plan = Plan::new();
                let (mut earned, mut gain) = (0.0, [0.0; K]);
                for t in 0..frames {
                    let p = policy.gains.p.clone();
                    policy.plan(&Context::default(), &mut plan, &mut Streams::new(t as u64, 1).rng(0));
                    let rewards: Vec<f64> = (0..K).map(|k| adversary(t, &p, k)).collect();
                    earned += p.iter().zip(&rewards).map(|(p, r)| p * r).sum::<f64>();
                    gain.iter_mut().zip(&rewards).for_each(|(g, r)| *g += r);
                    policy.learn(&plan, &rewards);
                }
                let regret = gain.iter().copied().fold(0.0, f64::max) - earned;
                let bound = (frames as f64 * (K as f64).ln() / if anytime { 1.0 } else { 2.0 }).sqrt();
                assert!(regret <= bound + 1e-9, "{name}, {frames} frames: regret {regret:.3} above {bound:.3}");
            }
        }
    }

    /// 20,000 draws; binomial, 5 deviations: 9 counts fail less than once in 10⁵.
    #[test]
    fn gazes_are_drawn_with_the_published_probabilities() {
        let (mut policy, mut plan) = (hedge(2.0), Plan::new());
        let mut rng = Streams::new(7, 0).at(0, Purpose::Look).rng(0);
        policy.plan(&Context::default(), &mut plan, &mut rng);
        let rewards: Vec<f64> = (0..9).map(|k| f64::from(k) / 8.0).collect();
        policy.learn(&plan, &rewards);
        let sum: f64 = rewards.iter().map(|r| (2.0 * r).exp()).sum();
        let mut counts = [0; 9];
        for _ in 0..20_000 {
            policy.plan(&Context::default(), &mut plan, &mut rng);
            counts[plan.chosen_index()] += 1;
        }
        for (k, (&count, r)) in counts.iter().zip(&rewards).enumerate() {
            let p = (2.0 * r).exp() / sum; // exp(γ G) / Σ exp(γ G), as printed
            assert!((policy.gains.p[k] - p).abs() < 1e-15);
            let (mean, sd) = (2e4 * p, (2e4 * p * (1.0 - p)).sqrt());
            assert!((f64::from(count) - mean).abs() < 5.0 * sd, "gaze {k}: {count} is not {mean} ± 5 × {sd}");
        }
    }

    #[test]
    fn large_gains_do_not_overflow() {
        let (mut policy, mut plan) = (hedge(1e3), Plan::new());
        for t in 0..2000 {
            policy.plan(&Context::default(), &mut plan, &mut Streams::new(t, 0).rng(0));
            let rewards: Vec<f64> = (0..9).map(|k| f64::from(k == 4)).collect();
            policy.learn(&plan, &rewards);
        }
        assert_eq!(policy.gains.p[4], 1.0);
        assert_eq!(plan.chosen_index(), 4);
    }

    #[test]
    fn a_known_number_of_frames_gives_the_theorems_rate() {
        let (mut known, mut fixed) = (hedge(Schedule::Frames(70)), hedge(Hedge::gamma_for(9, 70)));
        let (mut plan, rewards) = (Plan::new(), [0.0, 0.1, 0.9, 0.3, 0.7, 0.2, 1.0, 0.4, 0.5]);
        for policy in [&mut known, &mut fixed] {
            policy.plan(&Context::default(), &mut plan, &mut Streams::new(1, 0).rng(0));
            policy.learn(&plan, &rewards);
        }
        assert_eq!(known.gains.p, fixed.gains.p);
    }
}
