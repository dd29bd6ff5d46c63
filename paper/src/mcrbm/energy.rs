//! Free energy and its gradients, for one row in plain f64 and for many rows by matrix products.
//!
//! F(x) = ½‖x‖² − bᵛᵀx − Σ_k softplus(s_k) − Σ_j softplus(bᵐ_j + W·ⱼᵀx), with s_k = b_kᶜ − ½ Σ_f P_fk u_f². Its gradient through x̂ = r x,
//! r = (mean(x²) + ½)^(−½): with a = C (u ∘ P hᶜ), r a − r³ x (aᵀx) / n_x, then x − bᵛ − W hᵐ.

use super::hmc::Potential;
use super::{Parameters, SMALL, Sizes};
use foveate::learn::rbm::product::{rows_times, rows_times_transposed};
use foveate::learn::rbm::units::{add_bias, softplus};
use foveate::rows::Rows;
use foveate_kernels::{bias_logistic, dot, logistic};

/// Factors of a product taken before its logarithm: each is ½ to 1.
const FACTORS: usize = 64;

/// Replaces x by x̂ and returns r.
pub(super) fn normalise(x: &mut [f32]) -> f32 {
    let r = 1.0 / (dot(x, x) / x.len() as f32 + SMALL).sqrt();
    x.iter_mut().for_each(|x| *x *= r);
    r
}

/// Buffers of a batch of m rows.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// x̂, m × n_x.
    pub(super) hat: Vec<f32>,
    /// r, m.
    pub(super) gain: Vec<f32>,
    /// u, m × n_f.
    pub(super) u: Vec<f32>,
    /// −½ u², then u ∘ P hᶜ, m × n_f.
    pub(super) pull: Vec<f32>,
    /// p(hᶜ = 1), m × n_c.
    pub(super) covariance: Vec<f32>,
    /// p(hᵐ = 1), m × n_m.
    pub(super) mean: Vec<f32>,
    /// a, m × n_x.
    back: Vec<f32>,
}

impl Parameters {
    /// Returns s_k, then the logits of the mean units, in f64.
    fn log_odds(&self, x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let Sizes { white, factors, covariance, mean } = self.sizes();
        let wide = |x: f32| f64::from(x);
        let r = (x.iter().map(|x| x * x).sum::<f64>() / white as f64 + wide(SMALL)).powf(-0.5);
        let u: Vec<f64> =
            (0..factors).map(|f| (0..white).map(|i| r * x[i] * wide(self.filters[i * factors + f])).sum()).collect();
        let pooled = |k: usize| (0..factors).map(|f| wide(self.pooling[f * covariance + k]) * u[f] * u[f]).sum::<f64>();
        let weighed = |j: usize| (0..white).map(|i| x[i] * wide(self.weights[i * mean + j])).sum::<f64>();
        (
            (0..covariance).map(|k| wide(self.covariance_bias[k]) - 0.5 * pooled(k)).collect(),
            (0..mean).map(|j| wide(self.mean_bias[j]) + weighed(j)).collect(),
        )
    }
    /// Returns ½‖x‖² − bᵛᵀx.
    fn visible_energy(&self, x: &[f64]) -> f64 {
        x.iter().zip(&self.visible_bias).map(|(x, &b)| 0.5 * x * x - f64::from(b) * x).sum()
    }
    /// Returns E(x, hᶜ, hᵐ) in nats.
    #[cfg(test)]
    pub(super) fn energy(&self, x: &[f64], covariance: &[f64], mean: &[f64]) -> f64 {
        let (s, z) = self.log_odds(x);
        let of = |odds: Vec<f64>, h: &[f64]| odds.iter().zip(h).map(|(s, h)| s * h).sum::<f64>();
        self.visible_energy(x) - of(s, covariance) - of(z, mean)
    }
    /// Returns F(x) in nats.
    pub(super) fn free_energy(&self, x: &[f64]) -> f64 {
        let (s, z) = self.log_odds(x);
        self.visible_energy(x) - s.into_iter().chain(z).map(softplus).sum::<f64>()
    }
    /// Computes the hidden probabilities of rows `x` (m × n_x), with u and x̂; `energy` (m) ← F if given. Then, if `pull` is requested, u ∘
    /// P hᶜ.
    pub(super) fn hidden(&self, x: Rows<'_>, s: &mut Scratch, mut energy: Option<&mut [f64]>, pull: bool) {
        let (m, Sizes { white, factors, covariance, mean }) = (x.len(), self.sizes());
        s.hat.clear();
        s.hat.extend_from_slice(x.data());
        s.gain.clear();
        s.gain.extend(s.hat.chunks_exact_mut(white).map(normalise));
        s.u.resize(m * factors, 0.0);
        s.pull.resize(m * factors, 0.0);
        s.covariance.resize(m * covariance, 0.0);
        s.mean.resize(m * mean, 0.0);
        rows_times(Rows::new(&s.hat, white), &self.filters, &mut s.u);
        s.pull.iter_mut().zip(&s.u).for_each(|(p, u)| *p = -0.5 * u * u);
        rows_times(Rows::new(&s.pull, factors), &self.pooling, &mut s.covariance);
        rows_times(x, &self.weights, &mut s.mean);
        if let Some(energy) = &mut energy {
            for (x, e) in x.iter().zip(&mut **energy) {
                *e = 0.5 * f64::from(dot(x, x)) - f64::from(dot(x, &self.visible_bias));
            }
            for (odds, bias) in [(&mut s.covariance, &self.covariance_bias), (&mut s.mean, &self.mean_bias)] {
                add_bias(odds, bias);
                for (odds, e) in odds.chunks_exact(bias.len()).zip(&mut **energy) {
                    *e -= softplus_sum(odds);
                }
                logistic(odds);
            }
        } else {
            bias_logistic(&mut s.covariance, &self.covariance_bias);
            bias_logistic(&mut s.mean, &self.mean_bias);
        }
        if pull {
            rows_times_transposed(Rows::new(&s.covariance, covariance), &self.pooling, &mut s.pull);
            s.pull.iter_mut().zip(&s.u).for_each(|(p, u)| *p *= u);
        }
    }
}

impl Potential for Parameters {
    type Scratch = Scratch;
    fn gradient(&self, x: Rows<'_>, s: &mut Scratch, gradient: &mut [f32], energy: Option<&mut [f64]>) {
        let Sizes { white, factors, mean, .. } = self.sizes();
        self.hidden(x, s, energy, true);
        s.back.resize(x.len() * white, 0.0);
        rows_times_transposed(Rows::new(&s.pull, factors), &self.filters, &mut s.back);
        rows_times_transposed(Rows::new(&s.mean, mean), &self.weights, gradient);
        let rows = x.iter().zip(s.back.chunks_exact(white)).zip(&s.gain);
        for (g, ((x, a), &r)) in gradient.chunks_exact_mut(white).zip(rows) {
            let own = 1.0 - r * r * r * dot(a, x) / white as f32;
            for (((g, x), a), b) in g.iter_mut().zip(x).zip(a).zip(&self.visible_bias) {
                *g = own * x + r * a - *g - b;
            }
        }
    }
}

/// Σ log(1 + eᶻ) = Σ max(z, 0) − log Π σ(|z|), with one logarithm for many factors.
fn softplus_sum(z: &[f32]) -> f64 {
    let mut sum = 0.0;
    let mut buffer = [0.0f32; FACTORS];
    for z in z.chunks(FACTORS) {
        let odds = &mut buffer[..z.len()];
        odds.iter_mut().zip(z).for_each(|(o, z)| *o = z.abs());
        logistic(odds);
        let product: f64 = odds.iter().map(|&p| f64::from(p)).product();
        sum += z.iter().map(|&z| f64::from(z.max(0.0))).sum::<f64>() - product.ln();
    }
    sum
}
