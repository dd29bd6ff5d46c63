//! Gazes that are scored for the record only, to compute the reward that each would have earned.
//!
//! Regret against the best fixed gaze needs the rewards of gazes that the policy did not plan. [`Shadow`] has them scored each frame, for
//! observers; neither the belief nor the inner policy uses them. The track is the same with and without it, bit for bit; it costs as much
//! time as a policy with full information.

use super::{Context, Plan, Policy};
use crate::geometry::Gaze;
use foveate_base::rng::Rng;

/// Records some gazes in every frame in addition to those that another policy plans ([`Plan::record`]).
///
/// Gazes that the other policy plans itself are not recorded, because their rewards are known already.
pub struct Shadow {
    gazes: Vec<Gaze>,
    inner: Box<dyn Policy>,
}

foveate_base::opaque_debug!(Shadow);

impl Shadow {
    /// Records these gazes in addition to the plan of `inner`.
    pub fn new(gazes: Vec<Gaze>, inner: Box<dyn Policy>) -> Self {
        Self { gazes, inner }
    }
}

impl Policy for Shadow {
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng) {
        self.inner.plan(context, plan, rng);
        for &gaze in &self.gazes {
            if !plan.gazes().iter().any(|asked| (asked.u, asked.v) == (gaze.u, gaze.v)) {
                plan.record(gaze);
            }
        }
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        self.inner.learn(plan, rewards);
    }
    fn committed_gaze(&self) -> Option<Gaze> {
        self.inner.committed_gaze()
    }
    learned_by!(inner);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::{Anchor, Circular, Fixed, Grid, Hedge, Random};
    use foveate_base::rng::{Purpose, Streams};

    fn gazes() -> Vec<Gaze> {
        Grid::default().gazes()
    }

    fn hedge() -> Box<dyn Policy> {
        Box::new(Hedge::new(gazes(), 1.0).expect("nine gazes and a positive rate"))
    }

    #[test]
    fn shadows_conform() {
        conformance::policy(&|| Box::new(Shadow::new(gazes(), hedge())));
        conformance::policy(&|| {
            Box::new(Shadow::new(Grid { n: 2, reach: 0.9 }.gazes(), Box::new(Random::new(gazes()))))
        });
        conformance::policy(&|| Box::new(Shadow::new(gazes(), Box::new(Anchor::centre(hedge())))));
        conformance::policy(&|| Box::new(Shadow::new(vec![], Box::new(Fixed::new(Gaze::CENTRE)))));
    }

    #[test]
    fn each_gaze_is_scored_once_and_the_plan_stays() {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Look).rng(0);
        let mut plan = Plan::new();
        let mut circular = Shadow::new(gazes(), Box::new(Anchor::centre(Box::new(Circular::new(gazes())))));
        for t in 0..18 {
            circular.plan(&Context::default(), &mut plan, &mut rng);
            let asked = if t % 9 == 4 { 1 } else { 2 };
            assert_eq!((plan.gazes().len(), plan.recorded().len()), (asked, 9 - asked));
            assert!(plan.recorded().iter().all(|gaze| !plan.gazes().contains(gaze)));
            assert_eq!(plan.chosen().arm, Some(t % 9), "the choice is the inner policy's");
            circular.learn(&plan, &[0.5; 2][..asked]);
        }
        plan.clear();
        assert!(plan.recorded().is_empty());
    }

    #[test]
    fn the_inner_policy_is_unaffected() {
        let rng = || Streams::new(3, 0).at(0, Purpose::Look).rng(0);
        let (mut a, mut b) = (rng(), rng());
        let (mut bare, mut shadowed) = (hedge(), Shadow::new(Grid { n: 4, reach: 0.8 }.gazes(), hedge()));
        let (mut plan, mut more) = (Plan::new(), Plan::new());
        for t in 0..50 {
            bare.plan(&Context::default(), &mut plan, &mut a);
            shadowed.plan(&Context::default(), &mut more, &mut b);
            assert_eq!((more.gazes(), more.chosen_index()), (plan.gazes(), plan.chosen_index()));
            assert_eq!(more.recorded().len(), 16);
            let rewards: Vec<f64> = (0..9).map(|k| f64::from((7 * k + t) % 10) / 10.0).collect();
            bare.learn(&plan, &rewards);
            shadowed.learn(&more, &rewards);
            assert_eq!(shadowed.save(), bare.save());
        }
    }
}
