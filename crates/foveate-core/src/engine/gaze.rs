//! WHERE TO LOOK? The prior of the gazes, their plan, and the reward of each look.

use super::particles::Particles;
use super::target::Target;
use super::view::Looks;
use crate::control::Reward;
use crate::gaze::{Context, Expectation, Plan, Policy};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::Appearance;
use crate::scene::{Detector, Image, Saliency};
use foveate_base::rng::Streams;

/// Standard deviation of the target's place in a rehearsal, template units. The rehearsal covers ± two deviations with `PLACES` places
/// along a side.
const REHEARSED: f64 = 0.2;
const PLACES: usize = 9;

/// The policy, and the reward that it learns from.
pub struct GazeControl {
    /// πₜ: where to look.
    pub(crate) policy: Box<dyn Policy>,
    /// rₜ, from the belief.
    pub(super) reward: Box<dyn Reward>,
}

foveate_base::opaque_debug!(GazeControl);

impl GazeControl {
    /// Combines a policy and its reward.
    pub fn new(policy: Box<dyn Policy>, reward: Box<dyn Reward>) -> Self {
        Self { policy, reward }
    }
    /// Sets the policy that chooses the gazes.
    pub fn with_policy(self, policy: Box<dyn Policy>) -> Self {
        Self { policy, ..self }
    }
    /// Returns the policy.
    pub fn policy(&self) -> &dyn Policy {
        &*self.policy
    }

    /// k* ~ πₜ: returns the gazes of this frame, in the buffer `plan`. Some policies plan one gaze, others all.
    pub(super) fn plan(&mut self, context: &Context, streams: Streams, mut plan: Plan) -> Plan {
        self.policy.plan(context, &mut plan, &mut streams.rng(0));
        plan
    }

    /// Returns the reward rₜ of every look, in the buffer `rewards`.
    pub(super) fn rewards(
        &mut self,
        belief: &Particles,
        looks: &Looks,
        extent: Extent,
        mut rewards: Vec<f64>,
    ) -> Vec<f64> {
        let believed = (&belief.belief().mean(), extent);
        let reward = |l: &[f64]| self.reward.reward(&belief.states, &belief.log_importance, l, believed);
        rewards.clear();
        rewards.extend(looks.rows().map(reward));
        rewards
    }

    /// Sets the prior of the policy before the first look, if it has one: from saliency, or from the reward of a gaze on this picture.
    pub(super) fn init_prior(&mut self, image: &Image, target: &Target, appearance: &mut dyn Appearance) {
        match self.policy.expectation() {
            Some(Expectation::Saliency) => self.init_saliency(image, target),
            Some(Expectation::Rehearsal) => self.rehearse(image, target, appearance),
            None => {}
        }
    }

    /// Sets the prior from the saliency at the place of each gaze.
    fn init_saliency(&mut self, image: &Image, target: &Target) {
        let mut saliency = Saliency::default();
        saliency.look(image);
        self.policy.init_prior(&mut |gaze| {
            let looked_at = target.state.fixate(gaze, target.extent);
            f64::from(saliency.map().at_pixel(looked_at.x as f32, looked_at.y as f32))
        });
    }

    /// Sets the prior from the reward of each gaze on this picture with the target near its place. Beyond the paper.
    fn rehearse(&mut self, image: &Image, target: &Target, appearance: &mut dyn Appearance) {
        let Target { state: at, extent, .. } = *target;
        let off = |k: usize| 4.0 * (k as f64 / (PLACES - 1) as f64 - 0.5);
        let place = |k: usize| {
            let (a, b) = (off(k % PLACES), off(k / PLACES));
            let there = at.fixate(Gaze { u: REHEARSED * a, v: REHEARSED * b, arm: None }, extent);
            (State { x: there.x, y: there.y, ..at }, -0.5 * (a * a + b * b))
        };
        let (states, log_importance): (Vec<State>, Vec<f64>) = (0..PLACES * PLACES).map(place).unzip();
        let mut log_likelihood = vec![0.0; states.len()];
        let Self { policy, reward } = self;
        policy.init_prior(&mut |gaze| {
            appearance.prepare(image, &states, &[gaze]);
            appearance.log_likelihood(&states, gaze, &mut log_likelihood);
            reward.reward(&states, &log_importance, &log_likelihood, (&at, extent))
        });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::super::toy::{EXTENT, Toy, given, picture};
    use super::*;
    use foveate_base::rng::Rng;

    /// A policy that receives the prior of one gaze.
    struct Rehearsed(Arc<Mutex<Vec<f64>>>);

    impl Policy for Rehearsed {
        fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
            plan.only(Gaze::CENTRE);
        }
        fn learn(&mut self, _: &Plan, _: &[f64]) {}
        fn expectation(&self) -> Option<Expectation> {
            Some(Expectation::Rehearsal)
        }
        fn init_prior(&mut self, value: &mut dyn FnMut(Gaze) -> f64) {
            self.0.lock().expect("no panic").push(value(Gaze::CENTRE));
        }
    }

    /// A reward that keeps the places of the rehearsal with their log weights and log-likelihoods.
    struct Places(Arc<Mutex<Vec<(State, f64, f64)>>>);

    impl Reward for Places {
        fn reward(&mut self, states: &[State], log_prior: &[f64], l: &[f64], _: (&State, Extent)) -> f64 {
            let all = states.iter().zip(log_prior).zip(l).map(|((state, prior), l)| (*state, *prior, *l));
            self.0.lock().expect("no panic").extend(all);
            0.75
        }
    }

    /// The places form a grid over two deviations to each side of the target, with the log density of a normal distribution, and the
    /// prior of a gaze is its reward there.
    #[test]
    fn a_rehearsal_covers_the_places_around_the_target() {
        let (priors, places) = (Arc::default(), Arc::default());
        let mut control =
            GazeControl::new(Box::new(Rehearsed(Arc::clone(&priors))), Box::new(Places(Arc::clone(&places))));
        let (target, mut appearance) = (given(), Toy::at(50.0));
        control.init_prior(&picture(), &target, &mut appearance);
        assert_eq!(*priors.lock().expect("no panic"), [0.75]);
        let places = places.lock().expect("no panic");
        let deviation = REHEARSED * EXTENT.half_w;
        let mut grid = std::collections::BTreeSet::new();
        for (place, log_prior, fit) in &*places {
            let (a, b) = ((place.x - target.state.x) / deviation, (place.y - target.state.y) / deviation);
            assert!((log_prior + 0.5 * (a * a + b * b)).abs() < 1e-9 && a.abs() <= 2.0 + 1e-9 && b.abs() <= 2.0 + 1e-9);
            let mut likelihood = [0.0];
            appearance.log_likelihood(&[*place], Gaze::CENTRE, &mut likelihood);
            assert_eq!(likelihood[0], *fit);
            grid.insert(((2.0 * a).round() as i32, (2.0 * b).round() as i32));
        }
        assert_eq!((grid.len(), places.len()), (PLACES * PLACES, PLACES * PLACES), "half a deviation apart");
    }
}
