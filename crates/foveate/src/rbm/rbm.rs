//! The machine itself: energy, conditionals, free energy (section 3.2).
//!
//! Binary visible units: E(v, h) = −vᵀWh − bᵀv − cᵀh. Gaussian ones of variance 1: E(v, h) = ½‖v − b‖² − vᵀWh − cᵀh.
//! Either way p(hⱼ = 1 | v) = σ(cⱼ + vᵀW·ⱼ), and p(v) ∝ exp(−F(v)) with the free energy F(v) = −log Σₕ exp(−E(v, h)).
//! v has n_v numbers (in [0, 1], or standardised), h has n_h (0 or 1); energies are in nats.

use super::product::{rows_times, rows_times_transposed};
use crate::rows::{Rows, RowsMut};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// What the visible units are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Visible {
    /// 0 or 1; values between are taken as probabilities ("soft data").
    Bernoulli,
    /// Real, of variance 1 around a mean: for data standardised row by row.
    Gaussian,
}

/// A restricted Boltzmann machine: `n_v` visible units, `n_h` binary hidden ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Rbm {
    n_v: usize,
    n_h: usize,
    visible: Visible,
    pub(super) weights: Vec<f32>,
    pub(super) visible_bias: Vec<f32>,
    pub(super) hidden_bias: Vec<f32>,
}

impl Rbm {
    /// A machine from its parameters; `weights` is n_v × n_h, row-major. The lengths of the biases say n_v and n_h.
    ///
    /// Fails if a side is empty, the shapes do not fit, or a number is not finite.
    pub fn new(visible: Visible, weights: Vec<f32>, visible_bias: Vec<f32>, hidden_bias: Vec<f32>) -> Result<Self> {
        let (n_v, n_h) = (visible_bias.len(), hidden_bias.len());
        if n_v == 0 || n_h == 0 || n_v.checked_mul(n_h) != Some(weights.len()) {
            return Err(Error::Invalid(format!(
                "an RBM of {n_v} visible and {n_h} hidden units needs {n_v} x {n_h} weights and no empty side, got {} weights",
                weights.len()
            )));
        }
        for (name, values) in [("weights", &weights), ("visible_bias", &visible_bias), ("hidden_bias", &hidden_bias)] {
            if let Some(i) = values.iter().position(|x| !x.is_finite()) {
                return Err(Error::Invalid(format!("an RBM needs finite numbers, but {name}[{i}] is {}", values[i])));
            }
        }
        Ok(Self { n_v, n_h, visible, weights, visible_bias, hidden_bias })
    }
    /// (n_v, n_h).
    pub fn shape(&self) -> (usize, usize) {
        (self.n_v, self.n_h)
    }
    /// What the visible units are.
    pub fn visible(&self) -> Visible {
        self.visible
    }
    /// W, n_v × n_h, row-major.
    pub fn weights(&self) -> Rows<'_> {
        Rows::new(&self.weights, self.n_h)
    }
    /// b, length n_v.
    pub fn visible_bias(&self) -> &[f32] {
        &self.visible_bias
    }
    /// c, length n_h.
    pub fn hidden_bias(&self) -> &[f32] {
        &self.hidden_bias
    }
    /// p(hⱼ = 1 | v) for every row of `v` (m × n_v) into `h` (m × n_h). Allocates nothing; a row's result depends on
    /// that row alone, bit for bit.
    pub fn h_from_v(&self, v: Rows<'_>, mut h: RowsMut<'_>) {
        self.check(v.width(), h.width());
        rows_times(v, &self.weights, h.data());
        add_bias(h.data(), &self.hidden_bias);
        logistic(h.data());
    }
    /// The mean of v given h, for every row of `h` (m × n_h) into `v` (m × n_v): probabilities (Bernoulli) or means
    /// (Gaussian). Allocates nothing; a row's result depends on that row alone, bit for bit.
    pub fn v_from_h(&self, h: Rows<'_>, mut v: RowsMut<'_>) {
        self.check(v.width(), h.width());
        rows_times_transposed(h, &self.weights, v.data());
        add_bias(v.data(), &self.visible_bias);
        if self.visible == Visible::Bernoulli {
            logistic(v.data());
        }
    }
    /// E(v, h) in nats.
    pub fn energy(&self, v: &[f32], h: &[f32]) -> f64 {
        self.check(v.len(), h.len());
        let interaction: f64 = (v.iter().zip(self.weights().iter())).map(|(&v, w)| f64::from(v) * dot(w, h)).sum();
        self.visible_energy(v) - interaction - dot(&self.hidden_bias, h)
    }
    /// F(v) = −log Σₕ exp(−E(v, h)) in nats.
    pub fn free_energy(&self, v: &[f32]) -> f64 {
        self.check(v.len(), self.n_h);
        let mut z: Vec<f64> = self.hidden_bias.iter().map(|&c| f64::from(c)).collect();
        for (&v, w) in v.iter().zip(self.weights().iter()) {
            z.iter_mut().zip(w).for_each(|(z, &w)| *z += f64::from(v) * f64::from(w));
        }
        self.visible_energy(v) - z.into_iter().map(softplus).sum::<f64>()
    }
    /// The part of the energy that v alone has.
    pub(super) fn visible_energy(&self, v: &[f32]) -> f64 {
        match self.visible {
            Visible::Bernoulli => -dot(&self.visible_bias, v),
            Visible::Gaussian => {
                0.5 * (v.iter().zip(&self.visible_bias))
                    .map(|(v, b)| (f64::from(*v) - f64::from(*b)).powi(2))
                    .sum::<f64>()
            }
        }
    }
    fn check(&self, n_v: usize, n_h: usize) {
        assert_eq!((n_v, n_h), (self.n_v, self.n_h), "rows must be as wide as the RBM's sides");
    }
}

/// Adds `bias` to every row of `x`.
pub(super) fn add_bias(x: &mut [f32], bias: &[f32]) {
    for row in x.chunks_exact_mut(bias.len()) {
        row.iter_mut().zip(bias).for_each(|(x, b)| *x += b);
    }
}

/// σ(x) = 1 / (1 + e⁻ˣ), in place.
pub(super) fn logistic(x: &mut [f32]) {
    for x in x {
        *x = 1.0 / (1.0 + (-*x).exp());
    }
}

/// log(1 + eˣ) without overflow.
pub(super) fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}
