//! The reward rₜ of a look, from the weights it gives (Algorithm 1, "gaze control").
//!
//! Each reward raises the look's likelihood to a power, the temperature: the sharpness that tracks best collapses the
//! weights so far that the paper's Σw² hardly separates good gazes from bad ones. All rewards are in [0, 1], use
//! weights only, and do not depend on the order of particles.

use super::{deviation, normalize};
use crate::geometry::{Extent, State};
use foveate_base::{Error, Result};

/// The reward of a look.
///
/// The result must be in [0, 1], must depend on states and weights alone (not on their order), and must
/// not change when a constant is added to either list of logarithms.
pub trait Reward: Send + Sync {
    /// The reward of a gaze. `log_prior` is log wₜ₋₁ + log p/q of each particle, `log_likelihood` that of what the
    /// gaze saw there, in nats; as many as states, at least one. `believed` is the estimated place of the target after all looks of
    /// the frame, and half its size at scale 1.
    fn reward(
        &mut self,
        states: &[State],
        log_prior: &[f64],
        log_likelihood: &[f64],
        believed: (&State, Extent),
    ) -> f64;
}

// Deviation: the paper's reward is computed from the filter's own weights. At the sharpness that tracks best they have collapsed, and
// the gaze of highest Σw² is then worse than a random one; temperature 1 is as printed.
/// Weighs particles anew at a softer temperature; keeps its room.
#[derive(Clone, Debug)]
struct Tempered {
    temperature: f64,
    log_weights: Vec<f64>,
    weights: Vec<f64>,
}

impl Tempered {
    fn new(temperature: f64) -> Result<Self> {
        if !(temperature > 0.0 && temperature <= 1.0) {
            return Err(Error::Config(format!(
                "reward.temperature is a power of the likelihood, above 0 and at most 1; it is {temperature}"
            )));
        }
        Ok(Self { temperature, log_weights: Vec::new(), weights: Vec::new() })
    }
    /// Weights ∝ prior · likelihood^temperature; `None` if all are 0.
    fn weigh(&mut self, log_prior: &[f64], log_likelihood: &[f64]) -> Option<&[f64]> {
        assert_eq!(log_prior.len(), log_likelihood.len(), "one prior weight for each likelihood");
        self.log_weights.clear();
        self.log_weights.extend(log_prior.iter().zip(log_likelihood).map(|(p, l)| p + self.temperature * l));
        self.weights.resize(log_prior.len(), 0.0);
        let evidence = normalize(&self.log_weights, &mut self.weights);
        evidence.is_finite().then_some(&self.weights)
    }
}

/// Σw², the paper's reward: 1/n for an uninformative look, 1 if one particle remains.
#[derive(Clone, Debug)]
pub struct Concentration(Tempered);

impl Concentration {
    /// With the likelihood raised to `temperature`, in (0, 1]; the paper's is 1.
    pub fn new(temperature: f64) -> Result<Self> {
        Tempered::new(temperature).map(Self)
    }
}

impl Reward for Concentration {
    fn reward(&mut self, _: &[State], log_prior: &[f64], log_likelihood: &[f64], _: (&State, Extent)) -> f64 {
        let nothing = 1.0 / log_prior.len() as f64;
        self.0.weigh(log_prior, log_likelihood).map_or(nothing, concentration)
    }
}

/// log(n Σw²) / log n: the paper's reward spread over [0, 1] whatever the number of particles.
#[derive(Clone, Debug)]
pub struct LogConcentration(Tempered);

impl LogConcentration {
    /// With the likelihood raised to `temperature`, in (0, 1].
    pub fn new(temperature: f64) -> Result<Self> {
        Tempered::new(temperature).map(Self)
    }
}

impl Reward for LogConcentration {
    fn reward(&mut self, _: &[State], log_prior: &[f64], log_likelihood: &[f64], _: (&State, Extent)) -> f64 {
        let n = log_prior.len() as f64;
        let Some(weights) = self.0.weigh(log_prior, log_likelihood) else { return 0.0 };
        if n == 1.0 { 0.0 } else { ((n * concentration(weights)).ln() / n.ln()).clamp(0.0, 1.0) }
    }
}

/// Σw² clamped to [0, 1].
fn concentration(weights: &[f64]) -> f64 {
    weights.iter().map(|w| w * w).sum::<f64>().min(1.0)
}

/// 1 − tr Cov(x, y | look) / tr Cov(x, y): the share of the positional variance that the look removed; 0 if it added
/// some.
#[derive(Clone, Debug)]
pub struct VarianceReduction(Tempered);

impl VarianceReduction {
    /// With the likelihood raised to `temperature`, in (0, 1].
    pub fn new(temperature: f64) -> Result<Self> {
        Tempered::new(temperature).map(Self)
    }
}

impl Reward for VarianceReduction {
    fn reward(&mut self, states: &[State], log_prior: &[f64], log_likelihood: &[f64], _: (&State, Extent)) -> f64 {
        let Some(weights) = self.0.weigh(log_prior, log_likelihood) else { return 0.0 };
        let after = spread(states, weights);
        normalize(log_prior, &mut self.0.weights);
        let before = spread(states, &self.0.weights);
        // Places beyond all measure have no spread to compare.
        let finite = before.is_finite() && after.is_finite();
        if before > 0.0 && finite { (1.0 - after / before).clamp(0.0, 1.0) } else { 0.0 }
    }
}

// Deviation: the paper's reward measures how sure a look is, not whether it is right.
/// Mean IoU of the boxes under one look with the box from all looks of the frame. A look that is sure of the wrong
/// place has reward 0. With one look a frame it only measures its certainty.
#[derive(Clone, Debug)]
pub struct Agreement(Tempered);

impl Agreement {
    /// With the likelihood raised to `temperature`, in (0, 1].
    pub fn new(temperature: f64) -> Result<Self> {
        Tempered::new(temperature).map(Self)
    }
}

impl Reward for Agreement {
    fn reward(
        &mut self,
        states: &[State],
        log_prior: &[f64],
        log_likelihood: &[f64],
        (believed, extent): (&State, Extent),
    ) -> f64 {
        let Some(weights) = self.0.weigh(log_prior, log_likelihood) else { return 0.0 };
        let there = believed.bbox(extent);
        let overlap = |(state, w): (&State, &f64)| w * state.bbox(extent).iou(&there);
        let mean: f64 = states.iter().zip(weights).filter(|(_, w)| **w > 0.0).map(overlap).sum();
        // Places beyond all measure overlap nothing.
        if mean.is_finite() { mean.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Trace of the weighted covariance of the place, px².
fn spread(states: &[State], weights: &[f64]) -> f64 {
    let (mut x, mut y) = (0.0, 0.0);
    for (state, w) in states.iter().zip(weights) {
        x += w * state.x;
        y += w * state.y;
    }
    let mean = State { x, y, ..State::default() };
    let terms = states.iter().zip(weights).map(|(state, w)| {
        let [dx, dy, ..] = deviation(state, &mean);
        w * (dx * dx + dy * dy)
    });
    terms.sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    /// An estimate for rewards that ignore it.
    const ANYWHERE: (&State, Extent) = (
        &State { x: 0.0, y: 0.0, vx: 0.0, vy: 0.0, log_scale: 0.0, angle: 0.0, log_aspect: 0.0 },
        Extent { half_w: 1.0, half_h: 1.0 },
    );

    fn all(temperature: f64) -> [Box<dyn Reward>; 3] {
        let ok = "a temperature within range";
        [
            Box::new(Concentration::new(temperature).expect(ok)),
            Box::new(LogConcentration::new(temperature).expect(ok)),
            Box::new(VarianceReduction::new(temperature).expect(ok)),
        ]
    }

    #[test]
    fn every_reward_keeps_the_law() {
        for temperature in [1.0, 0.3, 1e-3] {
            all(temperature).iter_mut().for_each(|reward| conformance::reward(&mut **reward));
            conformance::reward(&mut Agreement::new(temperature).expect("a temperature within range"));
        }
        for wrong in [0.0, -1.0, 1.5, f64::NAN] {
            assert!(Concentration::new(wrong).is_err() && VarianceReduction::new(wrong).is_err());
        }
    }

    #[test]
    fn places_beyond_all_measure_earn_nothing() {
        let states = [-1e200, 1e200, 1e300].map(|x| State { x, ..State::default() });
        let mut reward = VarianceReduction::new(1.0).expect("a temperature");
        assert_eq!(reward.reward(&states, &[0.0; 3], &[0.0, -1.0, -2.0], ANYWHERE), 0.0);
    }

    /// Four particles, one on each corner of a 2 × 2 square; likelihoods 1, 1, 4, 4 leave w = .1, .1, .4, .4.
    #[test]
    fn closed_forms() {
        let states: Vec<State> = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)]
            .map(|(x, y)| State { x, y, ..State::default() })
            .into();
        let sides = |right: f64| [0.0, 0.0, right.ln(), right.ln()];
        // Σw² = .34. Before, the variance is 1 on each axis; after, it is 1 − .6² across and 1 down.
        let exact = [0.34, (4.0f64 * 0.34).ln() / 4.0f64.ln(), 0.18];
        for (temperature, right) in [(1.0, 4.0), (0.5, 16.0)] {
            for (reward, exact) in all(temperature).iter_mut().zip(exact) {
                let r = reward.reward(&states, &[0.0; 4], &sides(right), ANYWHERE);
                assert!((r - exact).abs() < 1e-12, "{r} is not {exact} at temperature {temperature}");
            }
        }
        // The temperature softens the look, not the prior: the same weights from the prior.
        let exact = [0.34, exact[1], 0.0];
        for (reward, exact) in all(0.5).iter_mut().zip(exact) {
            let r = reward.reward(&states, &sides(4.0), &[-3.0; 4], ANYWHERE);
            assert!((r - exact).abs() < 1e-12, "{r} is not {exact} where only the prior is informative");
        }
        // A look that flattens the weights again adds uncertainty: no variance was removed.
        assert_eq!(all(1.0)[2].reward(&states, &sides(4.0), &sides(0.25), ANYWHERE), 0.0);
        // One particle left; none left; all in one place.
        let out = f64::NEG_INFINITY;
        for (reward, exact) in all(1.0).iter_mut().zip([1.0, 1.0, 1.0]) {
            assert_eq!(reward.reward(&states, &[0.0; 4], &[out, 0.0, out, out], ANYWHERE), exact);
        }
        for (reward, exact) in all(1.0).iter_mut().zip([0.25, 0.0, 0.0]) {
            assert_eq!(reward.reward(&states, &[0.0; 4], &[out; 4], ANYWHERE), exact);
        }
        assert_eq!(all(1.0)[2].reward(&[State::default(); 4], &[0.0; 4], &sides(4.0), ANYWHERE), 0.0);
    }

    /// Two boxes of 4 × 2, one at the estimated place of the target and one beside it by a quarter of its width: IoU 1 and 0.6. A look
    /// with three quarters of its weight on the second earns 0.25 + 0.75 · 0.6; one with all weight at a distant place earns nothing.
    #[test]
    fn agreement_is_the_mean_overlap() {
        let extent = Extent { half_w: 2.0, half_h: 1.0 };
        let states = [0.0, 1.0, 50.0].map(|x| State { x, ..State::default() });
        let mut reward = Agreement::new(1.0).expect("a temperature");
        let out = f64::NEG_INFINITY;
        for (likelihood, exact) in
            [([0.0, 3.0f64.ln(), out], 0.7), ([out, out, 0.0], 0.0), ([0.0, out, out], 1.0), ([out; 3], 0.0)]
        {
            let r = reward.reward(&states, &[0.0; 3], &likelihood, (&states[0], extent));
            assert!((r - exact).abs() < 1e-12, "{r} is not {exact}");
        }
    }
}
