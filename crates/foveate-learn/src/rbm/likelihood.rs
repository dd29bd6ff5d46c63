//! The log-likelihood log p(v) = −F(v) − log Z: exactly for small machines, estimated for large ones.
//!
//! Z sums exp(−E) over all states. Exactly: over the hidden states (visible units sum in closed form). Estimated:
//! annealed importance sampling (Neal 2001; Salakhutdinov & Murray 2008), along p_β ∝ exp(−β E − (1 − β) E₀), where E₀ is a
//! machine of no weights, from β = 0 to 1.

use super::units::{sample_binary, sample_visible, softplus, visible_energy};
use super::{Rbm, Visible};
use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use foveate_kernels::logistic;
use rayon::prelude::*;

/// Most hidden units that are enumerated: 2²⁵ states of a few hundred sums are minutes.
const ENUMERABLE: usize = 25;
/// Chains one thread takes at a time.
const CHUNK: usize = 25;

const LN_2PI: f64 = 1.837_877_066_409_345_3;

/// log Z, over all 2^n_h hidden states. Fails above 25 hidden units.
pub fn exact_log_z(rbm: &Rbm) -> Result<f64> {
    let (n_v, n_h) = rbm.shape();
    if n_h > ENUMERABLE {
        return Err(Error::Invalid(format!(
            "an exact log-likelihood sums over 2^n_h states: at most {ENUMERABLE} hidden units, got {n_h}; use AIS"
        )));
    }
    let b = rbm.visible_bias();
    let states = (0usize..1 << n_h).into_par_iter().fold_chunks(1 << 12, LogSum::default, |mut sum, state| {
        let on = |j: usize| state >> j & 1 == 1;
        let hidden: f64 = (0..n_h).filter(|&j| on(j)).map(|j| f64::from(rbm.hidden_bias()[j])).sum();
        let visible = (0..n_v).map(|i| {
            let wh: f64 =
                rbm.weights().row(i).iter().enumerate().filter(|(j, _)| on(*j)).map(|(_, &w)| f64::from(w)).sum();
            match rbm.visible() {
                Visible::Bernoulli => softplus(f64::from(b[i]) + wh),
                Visible::Gaussian => f64::from(b[i]) * wh + 0.5 * wh * wh + 0.5 * LN_2PI,
            }
        });
        sum.add(hidden + visible.sum::<f64>());
        sum
    });
    // Chunks have a fixed size and are added in order: the same bits for any number of threads.
    let sums: Vec<LogSum> = states.collect();
    Ok(sums.into_iter().fold(LogSum::default(), LogSum::join).log())
}

/// Mean log p(v) over rows, in nats, given log Z.
pub fn mean_log_likelihood(rbm: &Rbm, rows: Rows<'_>, log_z: f64) -> f64 {
    -rows.iter().map(|v| rbm.free_energy(v)).sum::<f64>() / rows.len() as f64 - log_z
}

/// What AIS found.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AisEstimate {
    /// Estimate of log Z. Its exponential is unbiased; with too few temperatures log Z is mostly too low.
    pub log_z: f64,
    /// Standard error of `log_z` by the delta method: sd(w) / (mean(w) √chains).
    pub standard_error: f64,
    /// Effective number of chains, (Σw)² / Σw²: with few, both numbers above are unreliable.
    pub effective_chains: f64,
}

/// Estimates log Z by annealing `chains` independent chains through `temperatures` steps of β.
///
/// `base` (length n_v) is the visible bias at β = 0: for binary units the log odds of the data's means is much better than
/// zeros. Fails if a count is 0 or `base` does not fit. Deterministic in `seed`, for any number of threads.
pub fn ais(rbm: &Rbm, base: &[f32], chains: usize, temperatures: usize, seed: u64) -> Result<AisEstimate> {
    let (n_v, n_h) = rbm.shape();
    if chains == 0 || temperatures == 0 || base.len() != n_v || base.iter().any(|b| !b.is_finite()) {
        return Err(Error::Invalid(format!(
            "AIS needs chains, temperatures and a finite base bias for each of {n_v} visible units, got {chains}, {temperatures} and {}",
            base.len()
        )));
    }
    let (b, streams) = (rbm.visible_bias(), Streams::new(seed, 0).at(0, Purpose::Train));
    let starts: Vec<usize> = (0..chains).step_by(CHUNK).collect();
    let log_weights: Vec<f64> = starts
        .into_par_iter()
        .flat_map_iter(|start| {
            let n = CHUNK.min(chains - start);
            let mut rngs: Vec<Rng> = (0..n).map(|i| streams.rng((start + i) as u64)).collect();
            let (mut v, mut h, mut z) = (vec![0.0; n * n_v], vec![0.0; n * n_h], vec![0.0; n * n_h]);
            let mut log_w = vec![0.0; n];
            // From p₀: independent units.
            for (v, rng) in v.chunks_exact_mut(n_v).zip(&mut rngs) {
                v.copy_from_slice(base);
                if rbm.visible() == Visible::Bernoulli {
                    logistic(v);
                }
                sample_visible(rbm.visible(), v, rng);
            }
            for t in 1..=temperatures {
                let (from, to) = ((t - 1) as f64 / temperatures as f64, t as f64 / temperatures as f64);
                rbm.excitation(Rows::new(&v, n_v), &mut z);
                for (((log_w, v), z), (h, rng)) in
                    (log_w.iter_mut().zip(v.chunks_exact(n_v)).zip(z.chunks_exact_mut(n_h)))
                        .zip(h.chunks_exact_mut(n_h).zip(&mut rngs))
                {
                    // The weight gains log p*_to(v) − log p*_from(v), p* not normalised.
                    let hidden: f64 =
                        z.iter().map(|&z| softplus(to * f64::from(z)) - softplus(from * f64::from(z))).sum();
                    *log_w += hidden + (to - from) * (visible_energy(rbm.visible(), base, v) - rbm.visible_energy(v));
                    // A step of Gibbs sampling under p_to: hidden units,
                    z.iter_mut().for_each(|z| *z *= to as f32);
                    logistic(z);
                    sample_binary(z, rng, h);
                }
                // and visible ones: log odds (or mean) β (b + Wh) + (1 − β) b₀.
                rbm.reconstruct(Rows::new(&h, n_h), &mut v);
                for (v, rng) in v.chunks_exact_mut(n_v).zip(&mut rngs) {
                    for ((v, b), base) in v.iter_mut().zip(b).zip(base) {
                        *v = to as f32 * (*v + b) + (1.0 - to as f32) * base;
                    }
                    if rbm.visible() == Visible::Bernoulli {
                        logistic(v);
                    }
                    sample_visible(rbm.visible(), v, rng);
                }
            }
            log_w
        })
        .collect();

    let log_z0 = n_h as f64 * std::f64::consts::LN_2
        + match rbm.visible() {
            Visible::Bernoulli => base.iter().map(|&b| softplus(f64::from(b))).sum(),
            Visible::Gaussian => 0.5 * LN_2PI * n_v as f64,
        };
    let top = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let w: Vec<f64> = log_weights.iter().map(|l| (l - top).exp()).collect();
    let (n, sum, squares) = (chains as f64, w.iter().sum::<f64>(), w.iter().map(|w| w * w).sum::<f64>());
    let mean = sum / n;
    let variance = w.iter().map(|w| (w - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Ok(AisEstimate {
        log_z: log_z0 + top + mean.ln(),
        standard_error: (variance / n).sqrt() / mean,
        effective_chains: sum * sum / squares,
    })
}

/// log Σ exp(xᵢ), one x at a time.
#[derive(Clone, Copy, Debug)]
struct LogSum {
    top: f64,
    sum: f64,
}

impl Default for LogSum {
    fn default() -> Self {
        Self { top: f64::NEG_INFINITY, sum: 0.0 }
    }
}

impl LogSum {
    fn add(&mut self, x: f64) {
        *self = self.join(Self { top: x, sum: 1.0 });
    }
    fn join(self, other: Self) -> Self {
        let top = self.top.max(other.top);
        let scaled = |s: Self| if s.sum == 0.0 { 0.0 } else { s.sum * (s.top - top).exp() };
        Self { top, sum: scaled(self) + scaled(other) }
    }
    fn log(self) -> f64 {
        self.top + self.sum.ln()
    }
}
