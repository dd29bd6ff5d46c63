//! All gazes in every frame, with their likelihoods weighted by past rewards: a logarithmic opinion pool.
//!
//! With wₜ(k) ∝ exp(γ Gₜ₋₁(k)) that sum to `looks`, and G(k) the sum of a gaze's rewards, which decays by a fraction `forget` each frame,
//! ```text
//! log p(h₁..ₖ | x) = Σₖ wₜ(k) log p(hₖ | x, aₖ)
//! ```
//! (Genest & Zidek 1986; the weights are those of Hedge). With equal weights and `looks` = K it is the product of the likelihoods, as for
//! K looks with independent errors; with `looks` = 1 it is their geometric mean, as sharp as one look.
//!
//! Deviation: the paper moves the belief by one gaze per frame, which Hedge draws.

use super::{Context, Hedge, Plan, Policy, Schedule};
use crate::geometry::Gaze;
use foveate_base::Result;
use foveate_base::error::within;
use foveate_base::rng::Rng;

/// Uses all gazes at once, with the largest weights on those with the largest recent rewards.
#[derive(Clone, Debug)]
pub struct Pool {
    /// Learns the weights; nothing is drawn from them here.
    hedge: Hedge,
    looks: f64,
}

impl Pool {
    /// Creates a policy over these gazes (at least one), with learning rate `gamma` > 0 on rewards in [0, 1]; their sum decays by a
    /// fraction `forget` (0 to 1) each frame. The weights sum to `looks`, above 0: the effective number of looks.
    pub fn new(gazes: Vec<Gaze>, gamma: impl Into<Schedule>, forget: f64, looks: f64) -> Result<Self> {
        within("pool: forget", forget, 0.0, 1.0)?;
        within("pool: looks", looks, 1e-3, 1e3)?;
        Ok(Self { hedge: Hedge::new(gazes, gamma)?.fading(forget), looks })
    }
}

impl Policy for Pool {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.clear();
        let (mut heaviest, mut most) = (0, f64::NEG_INFINITY);
        for (k, (gaze, p)) in self.hedge.shares().enumerate() {
            plan.weigh(gaze, self.looks * p);
            if p > most {
                (heaviest, most) = (k, p);
            }
        }
        plan.mark(heaviest);
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        self.hedge.learn(plan, rewards);
    }
    learned_by!(hedge);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::{Grid, PolicySnapshot};
    use foveate_base::rng::Streams;

    fn pool(gamma: impl Into<Schedule>, forget: f64, looks: f64) -> Pool {
        Pool::new(Grid::default().gazes(), gamma, forget, looks).expect("nine gazes and settings in range")
    }

    fn weights(pool: &mut Pool) -> Vec<f64> {
        let mut plan = Plan::new();
        pool.plan(&Context::default(), &mut plan, &mut Streams::new(1, 0).rng(0));
        assert_eq!(plan.gazes(), Grid::default().gazes());
        plan.weights().to_vec()
    }

    fn learn(pool: &mut Pool, rewards: &[f64]) {
        let mut plan = Plan::new();
        pool.plan(&Context::default(), &mut plan, &mut Streams::new(1, 0).rng(0));
        pool.learn(&plan, rewards);
    }

    #[test]
    fn pools_conform() {
        conformance::policy(&|| Box::new(pool(0.5, 0.05, 9.0)));
        conformance::policy(&|| Box::new(pool(Schedule::Anytime, 0.0, 1.0)));
        conformance::policy(&|| Box::new(Pool::new(vec![Gaze::CENTRE], 5.0, 0.1, 1.0).expect("one gaze will do")));
        for (gamma, forget, looks, word) in
            [(0.0, 0.1, 1.0, "gamma"), (1.0, 1.5, 1.0, "forget"), (1.0, 0.1, f64::NAN, "looks")]
        {
            let refusal = Pool::new(vec![Gaze::CENTRE], gamma, forget, looks).expect_err(word).to_string();
            assert!(refusal.contains(word), "{refusal}");
        }
        assert!(Pool::new(vec![], 1.0, 0.1, 1.0).is_err());
    }

    #[test]
    fn weights_begin_equal_and_sum_to_the_looks() {
        for looks in [1.0, 4.5, 9.0] {
            let mut pool = pool(2.0, 0.1, looks);
            assert!(weights(&mut pool).iter().all(|w| (w - looks / 9.0).abs() < 1e-12));
            learn(&mut pool, &[0.9, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]);
            assert!((weights(&mut pool).iter().sum::<f64>() - looks).abs() < 1e-12);
        }
    }

    /// Without decay they are Hedge's. With it, constant rewards r give weights exp(γ r / forget), from any start.
    #[test]
    fn weights_have_a_closed_form() {
        let rewards = [0.1, 0.4, 0.2, 0.9, 0.5, 0.0, 0.3, 0.7, 1.0];
        let (mut pool_, mut hedge) =
            (pool(0.3, 0.0, 1.0), Hedge::new(Grid::default().gazes(), 0.3).expect("nine gazes"));
        let mut plan = Plan::new();
        for _ in 0..7 {
            hedge.plan(&Context::default(), &mut plan, &mut Streams::new(1, 0).rng(0));
            hedge.learn(&plan, &rewards);
            learn(&mut pool_, &rewards);
        }
        let PolicySnapshot::Arms { probabilities, .. } = hedge.snapshot() else { panic!("hedge has arms") };
        assert_eq!(weights(&mut pool_), probabilities);

        let mut fading = pool(0.2, 0.1, 1.0);
        (0..300).for_each(|_| learn(&mut fading, &[1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0]));
        (0..300).for_each(|_| learn(&mut fading, &rewards));
        let exact: Vec<f64> = rewards.iter().map(|r| (0.2 * r / 0.1f64).exp()).collect();
        let sum: f64 = exact.iter().sum();
        for (w, e) in weights(&mut fading).iter().zip(&exact) {
            assert!((w - e / sum).abs() < 1e-9, "{w} is not {}", e / sum);
        }
    }
}
