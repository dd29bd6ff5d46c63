//! A denoising autoencoder with tied weights (Vincent et al. 2008), one of the first layers that section 2 allows.
//!
//! h = σ(ṽᵀW + c) of a corrupted row ṽ, and v̂ = hWᵀ + b; training minimises the reconstruction error ½‖v̂ − v‖² of the clean row, mean
//! over rows. Rows have n_v real numbers (standardised glimpses), h has n_h in (0, 1).

mod io;
mod train;

pub(crate) use self::train::{Recipe, Trainer};

use foveate::Result;
use foveate::learn::rbm::{Rbm, Visible};
use foveate::rows::{Rows, RowsMut};

/// A trained autoencoder: the parameters W, b, c of a layer, as in an RBM with Gaussian units.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Autoencoder {
    layer: Rbm,
}

impl Autoencoder {
    /// Creates an autoencoder from W (n_v × n_h, row-major), b (n_v) and c (n_h). Fails if they do not fit, or a number is not finite.
    pub(crate) fn new(weights: Vec<f32>, visible_bias: Vec<f32>, hidden_bias: Vec<f32>) -> Result<Self> {
        Ok(Self { layer: Rbm::new(Visible::Gaussian, weights, visible_bias, hidden_bias)? })
    }
    /// Returns the layer: h and v̂ are its hidden probabilities and visible means.
    pub(crate) fn layer(&self) -> &Rbm {
        &self.layer
    }
    /// Returns ‖v̂ − v‖² of uncorrupted rows, mean over rows.
    pub(crate) fn error(&self, rows: Rows<'_>) -> f64 {
        let (n_v, n_h) = self.layer.shape();
        let (mut h, mut back) = (vec![0.0; rows.len() * n_h], vec![0.0; rows.len() * n_v]);
        self.layer.h_from_v(rows, RowsMut::new(&mut h, n_h));
        self.layer.v_from_h(Rows::new(&h, n_h), RowsMut::new(&mut back, n_v));
        let squares = rows.data().iter().zip(&back).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        squares / rows.len() as f64
    }
}
