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
