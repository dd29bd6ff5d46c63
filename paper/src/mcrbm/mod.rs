//! The mean and covariance machine, a factored RBM (Ranzato & Hinton 2010; section 2.1 of the paper): covariance units
//! represent relations between values, mean units the values.
//!
//! On whitened glimpses x (n_x numbers), with x̂ = x / √(mean(x²) + ½), factors u = Cᵀx̂ and P ≥ 0:
//! E(x, hᶜ, hᵐ) = ½ Σ_k h_kᶜ Σ_f P_fk u_f² − bᶜᵀhᶜ − xᵀWhᵐ − bᵐᵀhᵐ + ½‖x‖² − bᵛᵀx, in nats.
//! So p(h_kᶜ = 1 | x) = σ(b_kᶜ − ½ Σ_f P_fk u_f²): a covariance unit is on while its factors are silent.

mod encoder;
mod energy;
mod hmc;
mod io;
mod recipe;
#[cfg(test)]
mod tests;
mod train;

pub(crate) use self::encoder::FactoredEncoder;
pub(crate) use self::recipe::{Negative, Recipe};
pub(crate) use self::train::Trainer;

use foveate::learn::rbm::Whitening;
use foveate::learn::rbm::product::rows_times;
use foveate::rows::{Rows, RowsMut};
use foveate::{Error, Result};
use foveate_kernels::bias_logistic;
use serde::{Deserialize, Serialize};

/// Added to the mean square of x, so that flat glimpses are not amplified (the authors' code).
const SMALL: f32 = 0.5;
/// Maximum number of units of a kind; limits the scratch buffer of a row on the stack.
const MOST: usize = 2048;
/// Length of the scratch buffer on the stack.
const STACK: usize = 8 * MOST;

/// The numbers of units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Whitened values.
    pub white: usize,
    /// Factors.
    pub factors: usize,
    /// Covariance units.
    pub covariance: usize,
    /// Mean units.
    pub mean: usize,
}

/// The selected hidden units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Units {
    /// Covariance units, then mean units.
    #[default]
    Both,
    /// Covariance units alone.
    Covariance,
    /// Mean units alone.
    Mean,
}

/// All learned parameters, in whitened space.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Parameters {
    /// C, n_x × n_f.
    pub(super) filters: Vec<f32>,
    /// P, n_f × n_c, not negative.
    pub(super) pooling: Vec<f32>,
    /// bᶜ.
    pub(super) covariance_bias: Vec<f32>,
    /// W, n_x × n_m.
    pub(super) weights: Vec<f32>,
    /// bᵐ.
    pub(super) mean_bias: Vec<f32>,
    /// bᵛ.
    pub(super) visible_bias: Vec<f32>,
}

impl Parameters {
    /// Returns the parameters by their names in files.
    fn parts(&self) -> [(&'static str, &Vec<f32>); 6] {
        [
            ("filters", &self.filters),
            ("pooling", &self.pooling),
            ("covariance_bias", &self.covariance_bias),
            ("weights", &self.weights),
            ("mean_bias", &self.mean_bias),
            ("visible_bias", &self.visible_bias),
        ]
    }
    fn parts_mut(&mut self) -> [(&'static str, &mut Vec<f32>); 6] {
        [
            ("filters", &mut self.filters),
            ("pooling", &mut self.pooling),
            ("covariance_bias", &mut self.covariance_bias),
            ("weights", &mut self.weights),
            ("mean_bias", &mut self.mean_bias),
            ("visible_bias", &mut self.visible_bias),
        ]
    }
    fn sizes(&self) -> Sizes {
        let [white, covariance, mean] =
            [&self.visible_bias, &self.covariance_bias, &self.mean_bias].map(|bias| bias.len());
        Sizes { white, factors: self.filters.len() / white.max(1), covariance, mean }
    }
    fn check(&self) -> Result<()> {
        let Sizes { white, factors, covariance, mean } = self.sizes();
        let [x, f, c, m] = [white, factors, covariance, mean];
        if [x, f, c, m].iter().any(|&n| n == 0 || n > MOST) {
            return Err(Error::Invalid(format!(
                "a factored RBM has 1 to {MOST} of each: whitened values ({x}), factors ({f}), covariance units ({c}), mean units ({m})"
            )));
        }
        for ((name, values), expected) in self.parts().into_iter().zip([x * f, f * c, c, x * m, m, x]) {
            if values.len() != expected {
                return Err(Error::Invalid(format!("{name} has {} numbers, expected {expected}", values.len())));
            }
            if let Some(i) = values.iter().position(|x| !x.is_finite()) {
                return Err(Error::Invalid(format!(
                    "a factored RBM needs finite numbers, but {name}[{i}] is {}",
                    values[i]
                )));
            }
        }
        match self.pooling.iter().find(|p| **p < 0.0) {
            Some(p) => Err(Error::Invalid(format!("pooling weights are not negative, got {p}"))),
            None => Ok(()),
        }
    }
}

/// A factored RBM with the whitening of its training: computes features of glimpses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FactoredRbm {
    whitening: Whitening,
    parameters: Parameters,
}

impl FactoredRbm {
    fn new(whitening: Whitening, parameters: Parameters) -> Result<Self> {
        parameters.check()?;
        if whitening.shape().1 != parameters.visible_bias.len() || whitening.shape().0 > MOST {
            return Err(Error::Invalid(format!(
                "a whitening from {} (at most {MOST}) to {} values does not fit a machine of {}",
                whitening.shape().0,
                whitening.shape().1,
                parameters.visible_bias.len()
            )));
        }
        Ok(Self { whitening, parameters })
    }
    /// Returns n_v, the number of values of a glimpse.
    pub(crate) fn glimpse_len(&self) -> usize {
        self.whitening.shape().0
    }
    /// Returns the number of features of these units.
    pub(crate) fn width(&self, units: Units) -> usize {
        let Sizes { covariance, mean, .. } = self.sizes();
        match units {
            Units::Both => covariance + mean,
            Units::Covariance => covariance,
            Units::Mean => mean,
        }
    }
    /// Returns the numbers of units.
    pub(crate) fn sizes(&self) -> Sizes {
        self.parameters.sizes()
    }
    /// Computes p(hᶜ = 0 | v), then p(hᵐ = 1 | v), of the selected units, for every row of `v` (m × n_v) into `h` (m ×
    /// [`FactoredRbm::width`]). Allocates nothing; a row's result depends on that row alone, bit for bit.
    ///
    /// Deviation: the article uses p(hᶜ = 1), which is high for nearly all units, most of all on flat patches, so that any two glimpses are
    /// alike. A broken relation is rare and therefore informative.
    pub(crate) fn features(&self, v: Rows<'_>, units: Units, mut h: RowsMut<'_>) {
        let (n_v, n_h) = (self.whitening.shape().0, self.width(units));
        assert_eq!((v.width(), h.width()), (n_v, n_h), "rows must be as wide as the machine's sides");
        let Sizes { white, factors, covariance, mean } = self.sizes();
        // The scratch buffer of a row, and as many rows at a time as fit.
        let widths = [n_v, white, factors, covariance.max(mean)];
        let together = STACK / widths.iter().sum::<usize>();
        let mut stack = [0.0; STACK];
        let p = &self.parameters;
        for (v, h) in v.data().chunks(together * n_v).zip(h.data().chunks_mut(together * n_h)) {
            let m = v.len() / n_v;
            let (centred, rest) = stack.split_at_mut(m * widths[0]);
            let (x, rest) = rest.split_at_mut(m * widths[1]);
            let (u, rest) = rest.split_at_mut(m * widths[2]);
            self.whitening.whiten(Rows::new(v, n_v), centred, x);
            if units != Units::Covariance {
                let out = &mut rest[..m * mean];
                rows_times(Rows::new(x, white), &p.weights, out);
                bias_logistic(out, &p.mean_bias);
                for (h, out) in h.chunks_exact_mut(n_h).zip(out.chunks_exact(mean)) {
                    h[n_h - mean..].copy_from_slice(out);
                }
            }
            if units != Units::Mean {
                x.chunks_exact_mut(white).for_each(|x| {
                    energy::normalise(x);
                });
                rows_times(Rows::new(x, white), &p.filters, u);
                u.iter_mut().for_each(|u| *u = -0.5 * *u * *u);
                let out = &mut rest[..m * covariance];
                rows_times(Rows::new(u, factors), &p.pooling, out);
                bias_logistic(out, &p.covariance_bias);
                for (h, out) in h.chunks_exact_mut(n_h).zip(out.chunks_exact(covariance)) {
                    h.iter_mut().zip(out).for_each(|(h, on)| *h = 1.0 - on);
                }
            }
        }
    }
    /// Returns the factors' filters as glimpses, n_v × n_f: the columns of C with the whitening undone.
    pub(crate) fn factor_filters(&self) -> Vec<f32> {
        self.whitening.unwhiten(Rows::new(&self.parameters.filters, self.sizes().factors))
    }
    /// Returns the mean units' filters as glimpses, n_v × n_m: the columns of W with the whitening undone.
    pub(crate) fn mean_filters(&self) -> Vec<f32> {
        self.whitening.unwhiten(Rows::new(&self.parameters.weights, self.sizes().mean))
    }
    /// Returns F(x) = −log Σ_h exp(−E(x, h)) of a glimpse (length n_v), in nats: plain sums in f64.
    pub(crate) fn free_energy(&self, v: &[f32]) -> f64 {
        let (n_v, n_x) = self.whitening.shape();
        let (mut centred, mut x) = (vec![0.0; n_v], vec![0.0; n_x]);
        self.whitening.whiten(Rows::new(v, n_v), &mut centred, &mut x);
        self.parameters.free_energy(&x.into_iter().map(f64::from).collect::<Vec<_>>())
    }
}
