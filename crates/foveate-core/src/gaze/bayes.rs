//! Settings of Bayesian optimisation of the gaze, and the priors that follow from them.

use super::Expectation;
use foveate_base::{Error, Result};
use foveate_gp::{Hyper, Priors, StudentT};
use serde::{Deserialize, Serialize};

/// Evaluations of the posterior by DIRECT in a frame: a fraction of a millisecond.
pub(super) const EVALUATIONS: usize = 150;
/// Least divisor when rewards are normalised, so that equal rewards do not become noise.
pub(super) const FLOOR: f64 = 0.02;

/// Settings of [`GpUcb`](super::GpUcb); lengths are in template units (1 = half the target's box).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bayes {
    /// Half the side of the square of gazes, template units.
    pub reach: f64,
    /// Number of past rewards used, 2 to 1000.
    pub window: usize,
    /// Random gazes at the start; the paper's 10.
    pub warm_up: usize,
    /// Half the side of the square of the random gazes, 0 to `reach`.
    pub start: f64,
    /// Frames between two fits of the hyper-parameters; the paper's is 1.
    pub refit: usize,
    /// δ in the exploration weight βₜ, above 0 to below 1.
    pub delta: f64,
    /// Factor of √βₜ; the paper's is 1, 0 never explores, 0 to 10.
    pub exploration: f64,
    /// Whether rewards are normalised to mean 0 and deviation 1.
    pub standardise: bool,
    /// After a reward this many deviations below the mean, the next frame does not explore.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<f64>,
    /// Reduction of exploration by the evidence deficit: at full deficit √βₜ is multiplied by 1 − caution, 0 to 1.
    pub caution: f64,
    /// Prior mean at a gaze with saliency one deviation above the mean, in deviations of the process, 0 to 10.
    pub saliency: f64,
    /// Like `saliency`, with the reward of each gaze in frame 1 under a position uncertainty of a tenth of the box.
    /// Not with a sensor, 0 to 10.
    pub rehearsal: f64,
}

impl Default for Bayes {
    fn default() -> Self {
        Self {
            reach: 0.5,
            window: 100,
            warm_up: 10,
            start: 0.2,
            refit: 5,
            delta: 0.001,
            exploration: 1.0,
            standardise: true,
            guard: None,
            caution: 0.0,
            saliency: 0.0,
            rehearsal: 0.0,
        }
    }
}

impl Bayes {
    /// Checks all settings.
    ///
    /// # Errors
    /// If a number is out of range; the error names it.
    pub fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, found: f64| {
            Err(Error::Config(format!("gp-ucb: {name} is {expected}; it is {found}")))
        };
        match self {
            b if !(b.reach > 0.0 && b.reach <= 10.0) => wrong("reach", "above 0 to 10 template units", b.reach),
            b if !(2..=1000).contains(&b.window) => wrong("window", "2 to 1000 rewards", b.window as f64),
            b if !(1..=1_000_000).contains(&b.warm_up) => wrong("warm_up", "1 to 1000000 frames", b.warm_up as f64),
            b if !(0.0..=b.reach).contains(&b.start) => wrong("start", "0 to reach", b.start),
            b if !(1..=1_000_000).contains(&b.refit) => wrong("refit", "1 to 1000000 frames", b.refit as f64),
            b if !(b.delta > 0.0 && b.delta < 1.0) => wrong("delta", "above 0 to below 1", b.delta),
            b if !(0.0..=10.0).contains(&b.exploration) => wrong("exploration", "0 to 10", b.exploration),
            b if b.guard.is_some_and(|g| !(0.0..=100.0).contains(&g)) => {
                wrong("guard", "0 to 100 deviations", b.guard.unwrap_or(f64::NAN))
            }
            b if !(0.0..=1.0).contains(&b.caution) => wrong("caution", "0 to 1", b.caution),
            b if !(0.0..=10.0).contains(&b.saliency) => wrong("saliency", "0 to 10", b.saliency),
            b if !(0.0..=10.0).contains(&b.rehearsal) => wrong("rehearsal", "0 to 10", b.rehearsal),
            b if b.saliency > 0.0 && b.rehearsal > 0.0 => {
                wrong("rehearsal", "0 where saliency is given, one of the two being the prior", b.rehearsal)
            }
            _ => Ok(()),
        }
    }
    /// Returns the initial hyper-parameters. Standardised rewards have variance 1; raw rewards are small.
    pub(super) fn first(&self) -> Hyper<2> {
        let signal_variance = if self.standardise { 1.0 } else { 0.01 };
        Hyper { length_scales: [0.5 * self.reach; 2], signal_variance, noise_variance: 0.25 * signal_variance }
    }
    /// Returns the weight of the prior mean, from saliency or rehearsal.
    pub(super) fn prior(&self) -> f64 {
        self.saliency.max(self.rehearsal)
    }
    /// Returns the effect of one deviation of the prior mean, in units of the process.
    pub(super) fn prior_weight(&self) -> f64 {
        self.prior() * self.first().signal_variance.sqrt()
    }
    /// Returns the kind of prior mean that the policy uses.
    pub(super) fn expectation(&self) -> Option<Expectation> {
        match self {
            s if s.saliency > 0.0 => Some(Expectation::Saliency),
            s if s.rehearsal > 0.0 => Some(Expectation::Rehearsal),
            _ => None,
        }
    }
    /// Returns the priors: Student-t on each length scale about half the square's half side, uniform on the two variances (section 4.4;
    /// the paper prints no numbers).
    pub(super) fn priors(&self) -> Result<Priors<2>> {
        let location = 0.5 * self.reach;
        let length_scale = StudentT::new(4.0, location, location / 3.0, (0.2 * location, 5.0 * location))?;
        let variances = if self.standardise { (4e-4, 25.0) } else { (1e-8, 25.0) };
        Priors::new([length_scale; 2], variances, variances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaze::GpUcb;

    #[test]
    fn settings_out_of_range_are_named() {
        let d = Bayes::default();
        for (settings, said) in [
            (Bayes { reach: f64::NAN, ..d.clone() }, "reach"),
            (Bayes { window: 1, ..d.clone() }, "window"),
            (Bayes { start: 0.6, ..d.clone() }, "start"),
            (Bayes { refit: 0, ..d.clone() }, "refit"),
            (Bayes { delta: 1.0, ..d.clone() }, "delta"),
            (Bayes { guard: Some(-1.0), ..d.clone() }, "guard"),
            (Bayes { caution: 1.5, ..d.clone() }, "caution"),
            (Bayes { saliency: f64::NAN, ..d.clone() }, "saliency"),
            (Bayes { rehearsal: 11.0, ..d.clone() }, "rehearsal"),
            (Bayes { saliency: 1.0, rehearsal: 1.0, ..d }, "rehearsal"),
        ] {
            let problem = GpUcb::new(settings).expect_err(said).to_string();
            assert!(problem.contains(said), "{problem}");
        }
    }
}
