//! The machine itself: energy, conditionals, free energy (section 2.1).
//!
//! Binary visible units: E(v, h) = −vᵀWh − bᵀv − cᵀh. Gaussian ones of variance 1: E(v, h) = ½‖v − b‖² − vᵀWh − cᵀh.
//! Either way p(hⱼ = 1 | v) = σ(cⱼ + vᵀW·ⱼ), and p(v) ∝ exp(−F(v)) with the free energy F(v) = −log Σₕ exp(−E(v, h)).
//! v has n_v numbers (in [0, 1], or standardised), h has n_h (0 or 1); energies are in nats.

use super::number::is_usable;
use super::product::{rows_times, rows_times_transposed};
use super::units::{add_bias, dot, softplus, visible_energy};
use super::visible::Visible;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use foveate_kernels::bias_logistic;

/// A restricted Boltzmann machine: `n_v` visible units, `n_h` binary hidden ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Rbm {
    n_v: usize,
    n_h: usize,
    visible: Visible,
    pub(crate) weights: Vec<f32>,
    pub(crate) visible_bias: Vec<f32>,
    pub(crate) hidden_bias: Vec<f32>,
}

impl Rbm {
    /// A machine from its parameters; `weights` is n_v × n_h, row-major. The lengths of the biases are n_v and n_h.
    ///
    /// Fails if a side is empty, the shapes do not fit, or a number is not finite or beyond 1e8.
    pub fn new(visible: Visible, weights: Vec<f32>, visible_bias: Vec<f32>, hidden_bias: Vec<f32>) -> Result<Self> {
        let (n_v, n_h) = (visible_bias.len(), hidden_bias.len());
        if n_v == 0 || n_h == 0 || n_v.checked_mul(n_h) != Some(weights.len()) {
            return Err(Error::Invalid(format!(
                "an RBM of {n_v} visible and {n_h} hidden units needs {n_v} x {n_h} weights and no empty side, got {} weights",
                weights.len()
            )));
        }
        for (name, values) in [("weights", &weights), ("visible_bias", &visible_bias), ("hidden_bias", &hidden_bias)] {
            if let Some(i) = values.iter().position(|x| !is_usable(*x)) {
                return Err(Error::Invalid(format!(
                    "an RBM needs finite numbers up to 1e8, but {name}[{i}] is {}",
                    values[i]
                )));
            }
        }
        Ok(Self { n_v, n_h, visible, weights, visible_bias, hidden_bias })
    }
    /// (n_v, n_h).
    pub fn shape(&self) -> (usize, usize) {
        (self.n_v, self.n_h)
    }
    /// The kind of the visible units.
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
    /// W, b and c, for a trainer to move: shapes as [`Rbm::new`] has them. They must stay finite.
    pub fn parameters_mut(&mut self) -> [&mut [f32]; 3] {
        [&mut self.weights, &mut self.visible_bias, &mut self.hidden_bias]
    }
    /// c, length n_h.
    pub fn hidden_bias(&self) -> &[f32] {
        &self.hidden_bias
    }
    /// p(hⱼ = 1 | v) for every row of `v` (m × n_v) into `h` (m × n_h). Allocates nothing; a row's result depends on that
    /// row alone, bit for bit.
    pub fn h_from_v(&self, v: Rows<'_>, mut h: RowsMut<'_>) {
        self.check(v.width(), h.width());
        rows_times(v, &self.weights, h.data());
        bias_logistic(h.data(), &self.hidden_bias);
    }
    /// vᵀW + c, row by row: the log odds of the hidden units.
    pub(super) fn excitation(&self, v: Rows<'_>, z: &mut [f32]) {
        rows_times(v, &self.weights, z);
        add_bias(z, &self.hidden_bias);
    }
    /// The mean of v given h, for every row of `h` (m × n_h) into `v` (m × n_v): probabilities (Bernoulli) or means
    /// (Gaussian). Allocates nothing; a row's result depends on that row alone, bit for bit.
    pub fn v_from_h(&self, h: Rows<'_>, mut v: RowsMut<'_>) {
        self.check(v.width(), h.width());
        self.reconstruct(h, v.data());
        match self.visible {
            Visible::Bernoulli => bias_logistic(v.data(), &self.visible_bias),
            Visible::Gaussian => add_bias(v.data(), &self.visible_bias),
        }
    }
    /// Whᵀ, row by row: the input of v from hidden states, without its bias.
    pub(super) fn reconstruct(&self, h: Rows<'_>, v: &mut [f32]) {
        rows_times_transposed(h, &self.weights, v);
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
        visible_energy(self.visible, &self.visible_bias, v)
    }
    fn check(&self, n_v: usize, n_h: usize) {
        assert_eq!((n_v, n_h), (self.n_v, self.n_h), "rows must be as wide as the RBM's sides");
    }
}
