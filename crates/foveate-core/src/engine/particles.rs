//! The particles of one frame: predicted states, and their weights before and after the looks.

use super::target::Estimate;
use super::view::{Looks, View};
use crate::control::{Belief, DetectionLikelihood, normalize};
use crate::geometry::State;

/// The farthest that the sizes of particles go from that of a confident frame while the target is lost: log size, and log of width / height.
const MOST_CHANGE: f64 = 0.25;

/// The states of one frame and their weights. If a search draws some states again, the weights are updated.
#[derive(Default)]
pub(super) struct Particles {
    /// x̃⁽ⁱ⁾: the predicted states.
    pub states: Vec<State>,
    /// Their mean: the expected state before the looks.
    pub expected: State,
    /// Frames that were dropped before this one.
    pub dropped: usize,
    /// The log weights before the looks: log wₜ₋₁ p/q plus the detection likelihood.
    pub log_importance: Vec<f64>,
    /// Nats that were added to every particle so that the detection likelihood does not change the sum of the weights.
    pub detection_offset: f64,
    /// log wₜ after the looks, not normalised.
    pub log_weights: Vec<f64>,
    /// wₜ after the looks; they sum to 1.
    pub weights: Vec<f64>,
    /// log Σ w̃ₜ, nats.
    pub log_evidence: f64,
    /// Indices of the states that the last search drew again.
    pub drawn: Vec<usize>,
}

impl Particles {
    /// Keeps size and shape of all states near those of `seen`, the target in the last confident frame. While the target is lost nothing
    /// shows its size, and without a limit it would be a random walk; the search tries other sizes of each place itself.
    pub(super) fn hold_size(&mut self, seen: &State) {
        let near = |value: &mut f64, seen: f64| *value = value.clamp(seen - MOST_CHANGE, seen + MOST_CHANGE);
        for state in &mut self.states {
            near(&mut state.log_scale, seen.log_scale);
            near(&mut state.log_aspect, seen.log_aspect);
        }
    }

    /// Computes wₜ ∝ wₜ₋₁ p/q Π p(h | x, a) over the used gazes, each to the power of its weight in the plan. Returns the log evidence of
    /// each gaze from its own look alone, in the buffer `evidence`.
    // Deviation: all gazes of a frame weigh the same particles; the paper samples anew for each action.
    pub(super) fn weigh(&mut self, looks: &Looks, mut evidence: Vec<f64>) -> Vec<f64> {
        evidence.clear();
        for log_likelihood in looks.rows() {
            self.log_weights.clone_from(&self.log_importance);
            add(&mut self.log_weights, 1.0, log_likelihood);
            self.normalize();
            evidence.push(self.log_evidence);
        }
        self.log_weights.clone_from(&self.log_importance);
        looks.used().for_each(|(weight, log_likelihood)| add(&mut self.log_weights, weight, log_likelihood));
        self.normalize();
        evidence
    }

    /// Computes the weights without a look: wₜ ∝ wₜ₋₁ p/q.
    pub(super) fn weigh_without_looks(&mut self) {
        self.log_weights.clone_from(&self.log_importance);
        self.normalize();
    }

    /// Adds the detection likelihood to the log weights of the states in `drawn`; [`Particles::log_importance`] of all others includes it
    /// already.
    pub(super) fn apply_detection_likelihood(&mut self, likelihood: Option<&DetectionLikelihood>, view: &View<'_>) {
        let Some(likelihood) = likelihood else { return };
        for i in &self.drawn {
            let log_likelihood = likelihood.log_likelihood(view.scene.detections, &self.states[*i], view.target.extent);
            self.log_importance[*i] += log_likelihood + self.detection_offset;
        }
    }

    /// Computes the likelihood of the states in `drawn`, and weighs all particles again.
    pub(super) fn weigh_drawn(&mut self, view: &mut View<'_>, looks: &mut Looks) {
        if self.drawn.is_empty() {
            return;
        }
        self.drawn.iter().for_each(|i| self.log_weights[*i] = self.log_importance[*i]);
        looks.look_again(view, &self.states, &self.drawn, &mut self.log_weights);
        self.normalize();
    }

    fn normalize(&mut self) {
        self.weights.resize(self.log_weights.len(), 0.0);
        self.log_evidence = normalize(&self.log_weights, &mut self.weights);
    }

    /// Returns the states with their weights after the looks.
    pub(super) fn belief(&self) -> Belief<'_> {
        Belief { states: &self.states, weights: &self.weights }
    }

    /// Returns mean, covariance and effective sample size after the looks, and the displacement of the mean since the last frame.
    pub(super) fn estimate(&self) -> Estimate {
        let (belief, State { x, y, vx, vy, .. }) = (self.belief(), self.expected);
        let mean = belief.mean();
        let moved = [mean.x - (x - vx), mean.y - (y - vy)];
        Estimate { mean, covariance: belief.covariance(), ess: belief.ess(), moved }
    }
}

/// Returns the mean of states with these weights, which sum to 1.
pub(super) fn mean(states: &[State], weights: &[f64]) -> State {
    let sum = states.iter().zip(weights).fold([0.0; State::N], |mut sum, (s, weight)| {
        sum.iter_mut().zip(s.to_array()).for_each(|(sum, x)| *sum += weight * x);
        sum
    });
    State::from_array(sum)
}

/// `to += factor · what`, element by element.
fn add(to: &mut [f64], factor: f64, what: &[f64]) {
    to.iter_mut().zip(what).for_each(|(a, b)| *a += factor * b);
}
