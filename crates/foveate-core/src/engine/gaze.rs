//! WHERE TO LOOK? `foretell` before the first look; `choose`, `weigh`, `learn`; `record` for observers, and `settle`.

use super::Engine;
use super::template::attenuate;
use crate::control::{Belief, Reward, normalize};
use crate::gaze::{Expectation, Policy};
use crate::geometry::{Gaze, State};
use crate::scene::{Detector, Image, Saliency};
use foveate_base::rng::Purpose::Look;

/// How uncertain the target's place is in a rehearsal, template units, and places along a side of the square of ± two such
/// deviations that it could be at.
const REHEARSED: f64 = 0.2;
const PLACES: usize = 9;

/// The policy, and the reward that it learns from.
pub struct GazeControl {
    /// πₜ: where to look.
    pub(crate) policy: Box<dyn Policy>,
    /// rₜ, from the belief.
    pub(super) reward: Box<dyn Reward>,
}

impl GazeControl {
    /// This policy, rewarded like this.
    pub fn new(policy: Box<dyn Policy>, reward: Box<dyn Reward>) -> Self {
        Self { policy, reward }
    }
    /// The same, with gazes chosen by this policy.
    pub fn choosing(self, policy: Box<dyn Policy>) -> Self {
        Self { policy, ..self }
    }
    /// The policy, to look at.
    pub fn policy(&self) -> &dyn Policy {
        &*self.policy
    }
}

impl Engine {
    /// Tells the policy what it wants to know of gazes before the first look.
    pub(super) fn foretell(&mut self, image: &Image) {
        match self.parts.gaze.policy.expects() {
            Some(Expectation::Saliency) => self.expect_salient(image),
            Some(Expectation::Rehearsal) => self.rehearse(image),
            None => {}
        }
    }

    /// How much what a gaze looks at stands out.
    fn expect_salient(&mut self, image: &Image) {
        let (at, extent) = (self.target().state, self.target().extent);
        let mut saliency = Saliency::default();
        saliency.look(image);
        self.parts.gaze.policy.expect(&mut |gaze| {
            let looked_at = at.fixate(gaze, extent);
            f64::from(saliency.map().at_pixel(looked_at.x as f32, looked_at.y as f32))
        });
    }

    /// What a gaze would have earned on this picture, had the target been anywhere near its place. Beyond the paper.
    fn rehearse(&mut self, image: &Image) {
        let (at, extent) = (self.target().state, self.target().extent);
        let off = |k: usize| 4.0 * (k as f64 / (PLACES - 1) as f64 - 0.5);
        let place = |k: usize| {
            let (a, b) = (off(k % PLACES), off(k / PLACES));
            let there = at.fixate(Gaze { u: REHEARSED * a, v: REHEARSED * b, arm: None }, extent);
            (State { x: there.x, y: there.y, ..at }, -0.5 * (a * a + b * b))
        };
        let (states, log_prior): (Vec<State>, Vec<f64>) = (0..PLACES * PLACES).map(place).unzip();
        let mut log_likelihood = vec![0.0; states.len()];
        let appearance = &mut self.parts.appearance;
        let GazeControl { policy, reward } = &mut self.parts.gaze;
        policy.expect(&mut |gaze| {
            appearance.see(image, &states, &[gaze]);
            appearance.log_likelihood(&states, gaze, &mut log_likelihood);
            reward.reward(&states, &log_prior, &log_likelihood, (&at, extent))
        });
    }

    /// The policy plans: some ask about every gaze, some about one.
    pub(super) fn choose(&mut self) {
        let (w, rng) = (&mut self.work, &mut self.streams.at(self.frame, Look).rng(0));
        self.parts.gaze.policy.plan(&self.context, &mut w.plan, rng);
        let home = self.parts.appearance.home();
        w.gazes.clear();
        w.gazes.extend(w.plan.gazes().iter().map(|gaze| gaze.relative_to(home)));
    }

    /// What the plan needs of the picture is taken in, and with it what the search for distractors will most probably need.
    pub(super) fn see(&mut self, image: &Image) {
        let extent = self.target().extent;
        let w = &mut self.work;
        // What was read since the last step, for observers and others who ask, is not this frame's.
        self.parts.appearance.measure(&mut w.meter);
        let n = w.predicted.len();
        if let Some(around) = &self.parts.monitor.distractors {
            around.surround(&mut w.predicted, extent);
        }
        self.parts.appearance.see(image, &w.predicted, &w.gazes);
        w.predicted.truncate(n);
    }

    /// All particles under every gaze of the plan: its evidence and its reward. Then the posterior under the gazes that are
    /// used; their log-likelihoods add, as much of each as it weighs.
    // Deviation: where the paper samples anew for each action, all gazes of a frame weigh the same particles.
    pub(super) fn weigh(&mut self) {
        let (extent, reference) = (self.target().extent, self.reference());
        let (parts, w) = (&mut self.parts, &mut self.work);
        let n = w.predicted.len();
        w.log_likelihood.resize(w.gazes.len() * n, 0.0);
        w.weights.resize(n, 0.0);
        w.gaze_evidence.clear();
        w.rewards.clear();
        for (&gaze, log_likelihood) in w.gazes.iter().zip(w.log_likelihood.chunks_exact_mut(n)) {
            parts.appearance.log_likelihood(&w.predicted, gaze, log_likelihood);
            self.exclusion.apply(&w.predicted, log_likelihood, reference);
            attenuate(log_likelihood, self.visible);
            w.log_posterior.clone_from(&w.log_prior);
            add(&mut w.log_posterior, 1.0, log_likelihood);
            w.gaze_evidence.push(normalize(&w.log_posterior, &mut w.weights));
        }
        w.log_posterior.clone_from(&w.log_prior);
        let used = w.plan.weights().iter().zip(w.log_likelihood.chunks_exact(n)).filter(|(weight, _)| **weight > 0.0);
        used.for_each(|(weight, log_likelihood)| add(&mut w.log_posterior, *weight, log_likelihood));
        w.log_evidence = normalize(&w.log_posterior, &mut w.weights);
        let believed = (&Belief { states: &w.predicted, weights: &w.weights }.mean(), extent);
        let reward = |l: &[f64]| parts.gaze.reward.reward(&w.predicted, &w.log_prior, l, believed);
        w.rewards.extend(w.log_likelihood.chunks_exact(n).map(reward));
    }

    /// The policy learns where to look next.
    pub(super) fn learn(&mut self) {
        self.parts.gaze.policy.learn(&self.work.plan, &self.work.rewards);
    }

    /// Where the policy looks at one place from now on, everything is learned of that place, from the first picture on.
    pub(super) fn settle(&mut self) {
        let Some(gaze) = self.parts.gaze.policy.settles() else { return };
        let home = self.parts.appearance.home();
        if (gaze.u, gaze.v) == (home.u, home.v) || !self.parts.appearance.settle(gaze, self.streams) {
            return;
        }
        self.parts.monitor.forget_evidence();
        let source = self.parts.appearance.template_source().map(|it| (it.image.clone(), *it.state, it.origin));
        if let Some((image, state, (x, y))) = source {
            self.look_around_first(&image, &State { x: state.x - x as f64, y: state.y - y as f64, ..state });
        }
    }

    /// What other gazes would have earned, by the belief at the end of the frame: where particles were drawn again, not that by which the
    /// planned ones were scored. No later look at the frame depends on it.
    pub(super) fn record(&mut self, image: &Image) {
        let (extent, reference) = (self.target().extent, self.reference());
        let (parts, w) = (&mut self.parts, &mut self.work);
        w.recorded.clear();
        if w.plan.recorded().is_empty() {
            return;
        }
        let believed = (&Belief { states: &w.predicted, weights: &w.weights }.mean(), extent);
        w.gazes.clear();
        let home = parts.appearance.home();
        w.gazes.extend(w.plan.recorded().iter().map(|gaze| gaze.relative_to(home)));
        parts.appearance.see(image, &w.predicted, &w.gazes);
        for &gaze in &w.gazes {
            parts.appearance.log_likelihood(&w.predicted, gaze, &mut w.log_posterior);
            self.exclusion.apply(&w.predicted, &mut w.log_posterior, reference);
            attenuate(&mut w.log_posterior, self.visible);
            w.recorded.push(parts.gaze.reward.reward(&w.predicted, &w.log_prior, &w.log_posterior, believed));
        }
    }
}

fn add(to: &mut [f64], factor: f64, what: &[f64]) {
    to.iter_mut().zip(what).for_each(|(a, b)| *a += factor * b);
}
