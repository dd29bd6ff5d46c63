//! WHERE is it? The dorsal pathway: a particle filter over the target's [`State`] (section 3.1, Algorithm 1).
//!
//! A belief p(xₜ | h₁..ₜ, a₁..ₜ) is n weighted states. [`Proposal`] predicts them from the last frame's,
//! [`normalize`] weights them, [`Reward`] measures the value of a look, [`Resampling`] selects survivors. log wₜ =
//! log wₜ₋₁ + log p/q + log p(h | x, a), minus the log evidence.

mod camera_motion;
mod candidates;
mod confidence;
mod consistency;
mod detection_density;
mod detection_likelihood;
mod distractors;
mod dynamics;
mod leap;
mod local_search;
mod mixture;
mod proposal;
mod redetection;
mod resampling;
mod reward;
mod status;

pub use self::camera_motion::CameraMotion;
pub use self::confidence::{
    ABSENCE, AGREEMENT, AbsenceWeights, Ballot, CUE_NAMES, CUES, ConfidenceModel, Cues, EarlyWeights, FrameEvidence,
    LEAP, LOST, Localisation, LossMonitor, OWN, PlaceEvidence, ReacquisitionWeights, SearchResult,
    SecondTrackerWeights, TrackConfidence, Vote,
};
pub use self::consistency::{Consistency, ConsistencyMonitor, ConsistencySettings};
pub use self::detection_likelihood::DetectionLikelihood;
pub use self::distractors::{DistractorSearch, DistractorSettings, distractors};
pub use self::dynamics::{Autoregressive, Dynamics};
pub use self::leap::Leap;
pub(crate) use self::local_search::ByColour;
pub use self::local_search::{CLOSER, LocalSearch, LocalSearchSettings, WORTH};
pub use self::mixture::{Mixing, Mixture};
pub use self::proposal::{CHUNK, Prior, Proposal};
pub use self::redetection::{REFINEMENTS, Redetection, RedetectionSettings};
pub use self::resampling::{Resampling, Scheme};
pub use self::reward::{Agreement, Concentration, LogConcentration, Reward, VarianceReduction};
pub use self::status::{Status, StatusThresholds};

/// A share (0 to 1) of the numbers 0 to n − 1, spread evenly over them.
fn evenly(n: usize, share: f64) -> impl Iterator<Item = usize> {
    let rank = move |i: usize| (i as f64 * share) as usize;
    (0..n).filter(move |i| rank(i + 1) > rank(*i))
}

use crate::geometry::{Covariance, State};
use foveate_kernels::{exp_from, largest_finite};
use std::f64::consts::{PI, TAU};

/// bₜ: the belief about the target, as weighted states.
#[derive(Clone, Copy, Debug)]
pub struct Belief<'a> {
    /// The particles; at least one.
    pub states: &'a [State],
    /// As many weights, none negative, of sum 1.
    pub weights: &'a [f64],
}

impl Belief<'_> {
    /// The weighted mean. Angles are averaged as directions, near the first particle's angle.
    pub fn mean(&self) -> State {
        let (mut sum, first) = ([0.0; State::N], self.states[0].angle);
        let (mut sin, mut cos) = (0.0, 0.0);
        for (state, &w) in self.states.iter().zip(self.weights) {
            for (sum, value) in sum.iter_mut().zip(state.to_array()) {
                *sum += w * value;
            }
            let turn = state.angle - first;
            let (s, c) = if turn == 0.0 { (0.0, 1.0) } else { turn.sin_cos() }; // often no particle turns at all
            sin += w * s;
            cos += w * c;
        }
        State { angle: first + sin.atan2(cos), ..State::from_array(sum) }
    }
    /// The weighted covariance, in the order of [`State`]'s fields; angles differ by half a turn at most.
    pub fn covariance(&self) -> Covariance {
        let (mean, mut sum) = (self.mean(), Covariance::default());
        for (state, &w) in self.states.iter().zip(self.weights) {
            let d = deviation(state, &mean);
            for i in 0..State::N {
                for j in 0..=i {
                    sum[i][j] += w * d[i] * d[j];
                }
            }
        }
        for i in 0..State::N {
            let (row, below) = sum.split_at_mut(i + 1);
            for (j, other) in below.iter().enumerate() {
                row[i][i + 1 + j] = other[i];
            }
        }
        sum
    }
    /// Effective sample size 1 / Σw²: from 1 (one particle has all the weight) to n.
    pub fn ess(&self) -> f64 {
        1.0 / self.weights.iter().map(|w| w * w).sum::<f64>()
    }
}

/// `a − b` in the order of [`State`]'s fields, the angle's difference within half a turn.
fn deviation(a: &State, b: &State) -> [f64; State::N] {
    let turn = a.angle - b.angle;
    let turn = if turn.abs() <= PI { turn } else { turn - TAU * (turn / TAU).round() };
    [a.x - b.x, a.y - b.y, a.vx - b.vx, a.vy - b.vy, a.log_scale - b.log_scale, turn, a.log_aspect - b.log_aspect]
}

/// From log weights to weights of sum 1. Returns log Σ exp, which is the log evidence if the log weights are log
/// (wₜ₋₁ p/q p(h | x, a)).
///
/// The sum runs in a fixed order. Weights that are not finite become 0; if none is finite, no particle explains
/// the frame: the weights are uniform and −∞ is returned. Both slices have the same, non-zero length.
pub fn normalize(log_weights: &[f64], weights: &mut [f64]) -> f64 {
    assert_eq!(log_weights.len(), weights.len(), "one weight for each log weight");
    let max = largest_finite(log_weights);
    if max == f64::NEG_INFINITY {
        weights.fill(1.0 / weights.len() as f64);
        return max;
    }
    let sum = exp_from(log_weights, max, weights);
    let share = 1.0 / sum;
    weights.iter_mut().for_each(|w| *w *= share);
    max + sum.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalize_is_a_shift_invariant_softmax() {
        let mut w = [0.0; 4];
        let evidence = normalize(&[1.0f64.ln(), 2.0f64.ln(), 5.0f64.ln(), f64::NEG_INFINITY], &mut w);
        for (w, exact) in w.iter().zip([0.125, 0.25, 0.625, 0.0]) {
            assert!((w - exact).abs() < 1e-15, "{w} is not {exact}");
        }
        assert!((evidence - 8.0f64.ln()).abs() < 1e-14);
        let mut far = [0.0; 2];
        let evidence = normalize(&[-1e6, -1e6 - 1.0], &mut far);
        assert!((far[0] / far[1] - 1.0f64.exp()).abs() < 1e-9 && (evidence + 1e6 - 0.3132616875).abs() < 1e-8);
    }

    #[test]
    fn without_any_explanation_the_weights_are_uniform() {
        for bad in [f64::NEG_INFINITY, f64::NAN, f64::INFINITY] {
            let mut w = [0.0; 4];
            assert_eq!(normalize(&[bad; 4], &mut w), f64::NEG_INFINITY);
            assert_eq!(w, [0.25; 4]);
            assert_eq!(normalize(&[bad, 0.0, bad, 0.0], &mut w), 2.0f64.ln());
            assert_eq!(w, [0.0, 0.5, 0.0, 0.5]);
        }
    }

    #[test]
    fn moments_in_closed_form() {
        let states = [
            State::from_array([0.0, 0.0, 1.0, 0.0, 0.5, 3.0, 0.1]),
            State::from_array([4.0, 8.0, 1.0, 0.0, 0.5, 3.4 - TAU, 0.3]), // 0.4 apart, across ±π
        ];
        let belief = Belief { states: &states, weights: &[0.5, 0.5] };
        let mean = belief.mean().to_array();
        for (got, exact) in mean.iter().zip([2.0, 4.0, 1.0, 0.0, 0.5, 3.2, 0.2]) {
            assert!((got - exact).abs() < 1e-12, "{mean:?}");
        }
        let cov = belief.covariance();
        let exact = [
            (0, 0, 4.0),
            (1, 1, 16.0),
            (0, 1, 8.0),
            (1, 0, 8.0),
            (5, 5, 0.04),
            (0, 5, 0.4),
            (2, 2, 0.0),
            (6, 6, 0.01),
            (5, 6, 0.02),
        ];
        for (i, j, exact) in exact {
            assert!((cov[i][j] - exact).abs() < 1e-12, "{cov:?}");
        }
        assert_eq!(belief.ess(), 2.0);
        assert_eq!(Belief { states: &states, weights: &[0.0, 1.0] }.ess(), 1.0);
    }
}
