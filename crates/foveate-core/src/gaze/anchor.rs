//! Two looks per frame: a fixed gaze that keeps the track, and the gaze of another policy.
//!
//! Not in the paper. In our trials "centre + chosen" was the only reliable policy of partial information.

use super::{Context, Plan, Policy};
use crate::geometry::Gaze;
use foveate_base::rng::Rng;

/// Uses one fixed gaze, by default the centre, in every frame in addition to those of another policy.
///
/// The other policy learns from the rewards of its own gazes only. If it plans the fixed gaze itself, that gaze is scored once: scoring it
/// twice would count its evidence twice.
pub struct Anchor {
    gaze: Gaze,
    inner: Box<dyn Policy>,
    own: Plan,
}

foveate_base::opaque_debug!(Anchor);

impl Anchor {
    /// Combines the centre with `inner`.
    pub fn centre(inner: Box<dyn Policy>) -> Self {
        Self::new(Gaze::CENTRE, inner)
    }
    /// Combines any gaze with `inner`.
    pub fn new(gaze: Gaze, inner: Box<dyn Policy>) -> Self {
        Self { gaze, inner, own: Plan::new() }
    }
}

impl Policy for Anchor {
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng) {
        self.inner.plan(context, &mut self.own, rng);
        plan.clear();
        self.own.gazes().iter().zip(self.own.weights()).for_each(|(&gaze, &weight)| plan.weigh(gaze, weight));
        plan.mark(self.own.chosen_index());
        match self.own.gazes().iter().position(|g| (g.u, g.v) == (self.gaze.u, self.gaze.v)) {
            Some(k) => plan.use_also(k),
            None => plan.weigh(self.gaze, 1.0),
        }
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        let own = self.own.gazes().len();
        assert_eq!(plan.gazes().get(..own), Some(self.own.gazes()), "an anchor learns from the plan it made");
        self.inner.learn(&self.own, &rewards[..own]);
    }
    learned_by!(inner);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::{Circular, Fixed, Grid, Hedge, Pool, Random};
    use foveate_base::rng::{Purpose, Streams};

    fn hedge() -> Box<dyn Policy> {
        Box::new(Hedge::new(Grid::default().gazes(), 1.0).expect("nine gazes and a positive rate"))
    }

    #[test]
    fn anchors_conform() {
        conformance::policy(&|| Box::new(Anchor::centre(hedge())));
        conformance::policy(&|| Box::new(Anchor::new(Gaze { u: 0.9, v: 0.0, arm: None }, hedge())));
        conformance::policy(&|| Box::new(Anchor::centre(Box::new(Random::new(Grid::default().gazes())))));
        conformance::policy(&|| Box::new(Anchor::centre(Box::new(Circular::new(Grid::default().gazes())))));
        conformance::policy(&|| Box::new(Anchor::centre(Box::new(Fixed::new(Gaze::CENTRE)))));
    }

    #[test]
    fn two_looks_unless_they_are_the_same() {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Look).rng(0);
        let mut plan = Plan::new();
        let mut circular = Anchor::centre(Box::new(Circular::new(Grid::default().gazes())));
        for t in 0..9 {
            circular.plan(&Context::default(), &mut plan, &mut rng);
            assert_eq!(plan.chosen().arm, Some(t), "the choice is the inner policy's");
            assert_eq!(plan.gazes().len(), if t == 4 { 1 } else { 2 });
            assert_eq!(plan.used().count(), plan.gazes().len());
            circular.learn(&plan, &[0.5; 2][..plan.gazes().len()]);
        }
        let mut full = Anchor::centre(hedge());
        for _ in 0..50 {
            full.plan(&Context::default(), &mut plan, &mut rng);
            assert_eq!(plan.gazes().len(), 9, "the centre is one of the nine");
            assert!(plan.weights()[4] > 0.0 && plan.weights()[plan.chosen_index()] > 0.0);
            assert_eq!(plan.used().count(), if plan.chosen_index() == 4 { 1 } else { 2 });
            full.learn(&plan, &[0.5; 9]);
        }
    }

    /// A pool keeps its weights beside the centre, which has a weight of at least 1.
    #[test]
    fn the_inner_policy_weighs_its_own_gazes() {
        let mut rng = Streams::new(3, 0).at(0, Purpose::Look).rng(0);
        let (mut plan, mut bare) = (Plan::new(), Plan::new());
        let pool = || Box::new(Pool::new(Grid::default().gazes(), 1.0, 0.1, 2.0).expect("nine gazes"));
        pool().plan(&Context::default(), &mut bare, &mut rng);
        Anchor::centre(pool()).plan(&Context::default(), &mut plan, &mut rng);
        assert_eq!(plan.gazes(), bare.gazes());
        for (k, (weight, own)) in plan.weights().iter().zip(bare.weights()).enumerate() {
            assert_eq!(*weight, if k == 4 { 1.0 } else { *own }, "gaze {k}");
        }
    }

    #[test]
    fn the_inner_policy_learns_from_its_own_gazes() {
        let mut rng = Streams::new(2, 0).at(0, Purpose::Look).rng(0);
        let (mut plan, mut bare) = (Plan::new(), hedge());
        let mut anchored = Anchor::new(Gaze { u: 0.1, v: 0.0, arm: None }, hedge());
        let rewards: Vec<f64> = (0..10).map(|k| f64::from(k) / 10.0).collect();
        anchored.plan(&Context::default(), &mut plan, &mut rng);
        anchored.learn(&plan, &rewards);
        bare.plan(&Context::default(), &mut plan, &mut rng);
        bare.learn(&plan, &rewards[..9]);
        assert_eq!(anchored.save(), bare.save());
    }
}
