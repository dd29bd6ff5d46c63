//! Covariance functions and their hyper-parameters.

use foveate_kernels::Covariance;
use serde::{Deserialize, Serialize};

/// Covariance of f at two points, by their distance r² = Σ_d ((x_d − x'_d) / ℓ_d)².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// σₘ² exp(−r²/2), the paper's.
    #[default]
    SquaredExponential,
    /// σₘ² (1 + √5 r + 5r²/3) exp(−√5 r), for surfaces with edges.
    Matern52,
}

impl Kernel {
    pub(super) fn kind(self) -> Covariance {
        match self {
            Self::SquaredExponential => Covariance::SquaredExponential,
            Self::Matern52 => Covariance::Matern52,
        }
    }
}

/// The hyper-parameters of a process over `D` dimensions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(serialize = "[f64; D]: Serialize", deserialize = "[f64; D]: Deserialize<'de>"), deny_unknown_fields)]
pub struct Hyper<const D: usize> {
    /// ℓ_d: how far one must go along each axis for f to change; in the points' units, above 0.
    pub length_scales: [f64; D],
    /// σₘ²: the variance of f; in the values' units squared, above 0.
    pub signal_variance: f64,
    /// σₙ²: the variance of a value around f; not below 0.
    pub noise_variance: f64,
}

impl<const D: usize> Hyper<D> {
    /// Clamps each value to [1e-12, 1e12] (noise: [0, 1e12]), where arithmetic is safe; NaN becomes 1.
    pub(super) fn bounded(self) -> Self {
        let within = |x: f64, low: f64| if x.is_nan() { 1.0 } else { x.clamp(low, 1e12) };
        Self {
            length_scales: self.length_scales.map(|l| within(l, 1e-12)),
            signal_variance: within(self.signal_variance, 1e-12),
            noise_variance: within(self.noise_variance, 0.0),
        }
    }
}
