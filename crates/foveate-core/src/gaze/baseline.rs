//! Policies without learning (section 4.1), as baselines.

use super::{Context, Plan, Policy, PolicySnapshot};
use crate::geometry::Gaze;
use crate::saved_state::{SavedState, Valid, Validate, ensure};
use foveate_base::Result;
use foveate_base::rng::Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Always the same gaze, under which the appearance is learned. The paper has no such baseline; it is a strong one.
#[derive(Clone, Debug)]
pub struct Fixed {
    gaze: Gaze,
}

impl Fixed {
    /// Always plans this gaze.
    pub fn new(gaze: Gaze) -> Self {
        Self { gaze }
    }
}

impl Policy for Fixed {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.gaze);
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {}
    fn committed_gaze(&self) -> Option<Gaze> {
        Some(self.gaze)
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: std::slice::from_ref(&self.gaze), probabilities: &[1.0] }
    }
}

/// Any of a few gazes, with equal probability.
#[derive(Clone, Debug)]
pub struct Random {
    gazes: Vec<Gaze>,
    probabilities: Vec<f64>,
}

impl Random {
    /// Plans one of these gazes per frame. Panics if there are none.
    pub fn new(gazes: Vec<Gaze>) -> Self {
        assert!(!gazes.is_empty(), "a policy needs gazes to choose from");
        Self { probabilities: vec![1.0 / gazes.len() as f64; gazes.len()], gazes }
    }
}

impl Policy for Random {
    fn plan(&mut self, _: &Context, plan: &mut Plan, rng: &mut Rng) {
        plan.only(self.gazes[rng.random_range(..self.gazes.len())]);
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {}
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: &self.gazes, probabilities: &self.probabilities }
    }
}

/// A few gazes in turn, from the first.
#[derive(Clone, Debug)]
pub struct Circular {
    gazes: Vec<Gaze>,
    turn: usize,
    /// 1 at the present gaze, 0 elsewhere.
    probabilities: Vec<f64>,
}

impl Circular {
    /// Plans these gazes in order, cyclically. Panics if there are none.
    pub fn new(gazes: Vec<Gaze>) -> Self {
        assert!(!gazes.is_empty(), "a policy needs gazes to choose from");
        let mut policy = Self { probabilities: vec![0.0; gazes.len()], gazes, turn: 0 };
        policy.turn_to(0);
        policy
    }
    fn turn_to(&mut self, turn: usize) {
        self.probabilities[self.turn] = 0.0;
        self.turn = turn;
        self.probabilities[turn] = 1.0;
    }
}

/// The saved state of [`Circular`].
#[derive(Serialize, Deserialize)]
struct Turn {
    turn: usize,
}

impl Validate<[Gaze]> for Turn {
    fn validate(&self, gazes: &[Gaze]) -> Valid {
        ensure(self.turn < gazes.len(), || format!("expected a turn among {} gazes, found {}", gazes.len(), self.turn))
    }
}

impl Policy for Circular {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.gazes[self.turn]);
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {
        self.turn_to((self.turn + 1) % self.gazes.len());
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: &self.gazes, probabilities: &self.probabilities }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&Turn { turn: self.turn })
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        let Turn { turn } = saved.state("policy", &self.gazes[..])?;
        self.turn_to(turn);
        Ok(())
    }
    fn reset(&mut self) {
        self.turn_to(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::Grid;
    use foveate_base::rng::{Purpose, Streams};

    #[test]
    fn baselines_conform() {
        conformance::policy(&|| Box::new(Fixed::new(Gaze::CENTRE)));
        conformance::policy(&|| Box::new(Random::new(Grid::default().gazes())));
        conformance::policy(&|| Box::new(Circular::new(Grid::default().gazes())));
        conformance::policy(&|| Box::new(Circular::new(vec![Gaze::CENTRE])));
    }

    /// 9,000 draws, seed 5; binomial, 5 deviations: 9 counts fail less than once in 10⁵.
    #[test]
    fn random_is_uniform_and_circular_is_cyclic() {
        let mut rng = Streams::new(5, 0).at(0, Purpose::Look).rng(0);
        let (mut plan, mut counts) = (Plan::new(), [0; 9]);
        let arm = |plan: &Plan| plan.chosen().arm.expect("gazes of a grid are arms");
        let mut random = Random::new(Grid::default().gazes());
        for _ in 0..9000 {
            random.plan(&Context::default(), &mut plan, &mut rng);
            counts[arm(&plan)] += 1;
        }
        let sd = (9000.0 * 8.0 / 81.0f64).sqrt();
        assert!(counts.iter().all(|&c| (f64::from(c) - 1000.0).abs() < 5.0 * sd), "{counts:?}");
        let mut circular = Circular::new(Grid::default().gazes());
        for t in 0..20 {
            circular.plan(&Context::default(), &mut plan, &mut rng);
            assert_eq!(arm(&plan), t % 9);
            circular.learn(&plan, &[0.5]);
        }
    }
}
