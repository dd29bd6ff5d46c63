//! Priors of the hyper-parameters (section 4.4: independent Student-t priors on the length scales, uniform priors on
//! magnitude and noise; the paper gives no numbers).

use super::Hyper;
use foveate_base::{Error, Result};

/// Student's t, cut off outside [lower, upper] and normalised over it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudentT {
    nu: f64,
    location: f64,
    scale: f64,
    lower: f64,
    upper: f64,
    log_normaliser: f64,
}

impl StudentT {
    /// With `nu` > 0 degrees of freedom, `location`, `scale` > 0 and bounds 0 < `lower` < `upper`, all finite.
    pub fn new(nu: f64, location: f64, scale: f64, bounds: (f64, f64)) -> Result<Self> {
        let (lower, upper) = ranged("a length scale's prior", bounds)?;
        if !(nu > 0.0 && nu <= 1e6 && location.abs() <= 1e12 && (1e-12..=1e12).contains(&scale)) {
            return Err(Error::Config(format!(
                "a length scale's prior: expected nu in (0, 1e6], a location within 1e12 and a scale in [1e-12, 1e12]; \
                 found nu {nu}, location {location}, scale {scale}"
            )));
        }
        let mut prior = Self { nu, location, scale, lower, upper, log_normaliser: 0.0 };
        prior.log_normaliser = prior.log_mass();
        Ok(prior)
    }

    /// ln ∫ (1 + z²/ν)^(−(ν+1)/2) dℓ between the bounds. With z = √ν tan φ the integrand is scale √ν cos^(ν−1) φ, which is
    /// smooth; its largest value is divided out, so that bounds far out in a tail do no harm.
    fn log_mass(&self) -> f64 {
        const POINTS: usize = 4000;
        let angle = |l: f64| ((l - self.location) / self.scale / self.nu.sqrt()).atan();
        let (from, to) = (angle(self.lower), angle(self.upper));
        let width = (to - from) / POINTS as f64;
        let log_at = |i: usize| (self.nu - 1.0) * (from + (i as f64 + 0.5) * width).cos().ln();
        let top = (0..POINTS).map(log_at).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = (0..POINTS).map(|i| (log_at(i) - top).exp()).sum();
        top + (sum * width * self.scale * self.nu.sqrt()).ln()
    }

    /// The smallest and the largest length scale.
    pub fn bounds(&self) -> (f64, f64) {
        (self.lower, self.upper)
    }

    /// ln p(ℓ); −∞ outside the bounds.
    pub fn log_density(&self, length_scale: f64) -> f64 {
        if !(self.lower..=self.upper).contains(&length_scale) {
            return f64::NEG_INFINITY;
        }
        let z = (length_scale - self.location) / self.scale;
        -0.5 * (self.nu + 1.0) * (z * z / self.nu).ln_1p() - self.log_normaliser
    }

    /// First and second derivative of ln p(ℓ) by ln ℓ.
    pub(super) fn derivatives(&self, length_scale: f64) -> (f64, f64) {
        let z = (length_scale - self.location) / self.scale;
        let (step, below) = (length_scale / self.scale, self.nu + z * z);
        let first = -(self.nu + 1.0) * z / below * step;
        (first, first - (self.nu + 1.0) * (self.nu - z * z) / (below * below) * step * step)
    }
}

/// Independent priors of all hyper-parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Priors<const D: usize> {
    length_scales: [StudentT; D],
    signal_variance: (f64, f64),
    noise_variance: (f64, f64),
}

impl<const D: usize> Priors<D> {
    /// Uniform on σₘ² and σₙ² between bounds, 0 < lower < upper. A uniform prior in σ² and one in σ have the same
    /// mode, the maximum of the likelihood.
    pub fn new(length_scales: [StudentT; D], signal_variance: (f64, f64), noise_variance: (f64, f64)) -> Result<Self> {
        Ok(Self {
            length_scales,
            signal_variance: ranged("the signal variance's prior", signal_variance)?,
            noise_variance: ranged("the noise variance's prior", noise_variance)?,
        })
    }

    /// The priors of the length scales.
    pub fn length_scales(&self) -> &[StudentT; D] {
        &self.length_scales
    }

    /// Smallest and largest value of hyper-parameter `i`: length scales, signal, noise.
    pub(super) fn bounds(&self, i: usize) -> (f64, f64) {
        match self.length_scales.get(i) {
            Some(prior) => prior.bounds(),
            None if i == D => self.signal_variance,
            None => self.noise_variance,
        }
    }

    /// ln p, the density by (ℓ, σₘ², σₙ²); −∞ outside the bounds.
    pub fn log_density(&self, hyper: &Hyper<D>) -> f64 {
        let uniform = |x: f64, (lower, upper): (f64, f64)| match (lower..=upper).contains(&x) {
            true => -(upper - lower).ln(),
            false => f64::NEG_INFINITY,
        };
        let lengths: f64 = self.length_scales.iter().zip(hyper.length_scales).map(|(p, l)| p.log_density(l)).sum();
        lengths
            + uniform(hyper.signal_variance, self.signal_variance)
            + uniform(hyper.noise_variance, self.noise_variance)
    }

    /// The nearest hyper-parameters within the bounds.
    pub fn clamp(&self, hyper: Hyper<D>) -> Hyper<D> {
        let Hyper { length_scales, signal_variance, noise_variance } = hyper.bounded();
        Hyper {
            length_scales: std::array::from_fn(|d| length_scales[d].clamp(self.bounds(d).0, self.bounds(d).1)),
            signal_variance: signal_variance.clamp(self.signal_variance.0, self.signal_variance.1),
            noise_variance: noise_variance.clamp(self.noise_variance.0, self.noise_variance.1),
        }
    }
}

fn ranged(what: &str, (lower, upper): (f64, f64)) -> Result<(f64, f64)> {
    if lower >= 1e-12 && lower < upper && upper <= 1e12 {
        return Ok((lower, upper));
    }
    Err(Error::Config(format!(
        "{what}: expected bounds with 1e-12 <= lower < upper <= 1e12; found {lower} and {upper}"
    )))
}
