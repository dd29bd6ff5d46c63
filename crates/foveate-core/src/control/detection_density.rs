//! The density of a particle at a detection and under the dynamics, for the mixture of both.

use crate::geometry::State;

/// Independent normal densities of x, y and log scale; that of scale is used if its deviation is above 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    pub mean: [f64; 3],
    pub place: f64,
    pub size: f64,
    /// log of the density's constant, up to the power of 2π that all densities share.
    pub log_top: f64,
}

impl Density {
    pub(super) fn new(mean: [f64; 3], place: f64, size: f64) -> Self {
        Self { mean, place, size, log_top: -2.0 * place.ln() - if size > 0.0 { size.ln() } else { 0.0 } }
    }
    pub(super) fn log_density(&self, state: &State) -> f64 {
        let z = [(state.x - self.mean[0]) / self.place, (state.y - self.mean[1]) / self.place];
        let s = if self.size > 0.0 { (state.log_scale - self.mean[2]) / self.size } else { 0.0 };
        self.log_top - 0.5 * (z[0] * z[0] + z[1] * z[1] + s * s)
    }
}
