//! How well a machine fits rows it has, or has not, seen.
//!
//! None of these is the likelihood (see `likelihood`), but all are cheap: the squared error of a mean-field
//! reconstruction; the exact pseudo-log-likelihood Σᵢ log p(vᵢ | v₋ᵢ) (Besag 1975); and the free energy. Its gap
//! between held-out and training rows grows if a machine overfits (Hinton 2010, section 6).

use super::units::softplus;
use super::{Rbm, Visible};
use foveate_base::rows::{Rows, RowsMut};
use foveate_kernels::logistic;
use rayon::prelude::*;

/// Rows done at a time by one thread.
const CHUNK: usize = 100;
/// Weights up to here may be multiplied eight at a time, as e^w − 1: single precision still distinguishes 1 + h (e^−w
/// − 1) from 0.
const TAME: f32 = 8.0;

/// Means over some rows.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Fit {
    /// Squared error of the reconstruction, summed over a row.
    pub reconstruction: f64,
    /// Σᵢ log p(vᵢ | v₋ᵢ) in nats a row; none for Gaussian units.
    pub pseudo_log_likelihood: Option<f64>,
    /// F(v) in nats.
    pub free_energy: f64,
    /// p(h = 1 | v), mean over the hidden units too.
    pub activity: f64,
}

impl Fit {
    /// Measures a machine on rows; at least one.
    pub fn of(rbm: &Rbm, rows: Rows<'_>) -> Self {
        Self {
            reconstruction: reconstruction_error(rbm, rows),
            pseudo_log_likelihood: pseudo_log_likelihood(rbm, rows),
            free_energy: mean_free_energy(rbm, rows),
            activity: mean_activity(rbm, rows),
        }
    }
}

/// Σᵢ (vᵢ − E[vᵢ | E[h | v]])², mean over rows.
pub fn reconstruction_error(rbm: &Rbm, rows: Rows<'_>) -> f64 {
    let (n_v, n_h) = rbm.shape();
    mean(rows, |v| {
        let (mut h, mut back) = (vec![0.0; v.len() * n_h], vec![0.0; v.len() * n_v]);
        rbm.h_from_v(v, RowsMut::new(&mut h, n_h));
        rbm.v_from_h(Rows::new(&h, n_h), RowsMut::new(&mut back, n_v));
        v.data().iter().zip(&back).map(|(a, b)| f64::from(a - b).powi(2)).sum()
    })
}

/// p(h = 1 | v), mean over hidden units and rows.
pub fn mean_activity(rbm: &Rbm, rows: Rows<'_>) -> f64 {
    let n_h = rbm.shape().1;
    mean(rows, |v| {
        let mut h = vec![0.0; v.len() * n_h];
        rbm.h_from_v(v, RowsMut::new(&mut h, n_h));
        h.into_iter().map(f64::from).sum::<f64>() / n_h as f64
    })
}

/// F(v), mean over rows.
pub fn mean_free_energy(rbm: &Rbm, rows: Rows<'_>) -> f64 {
    let n_h = rbm.shape().1;
    mean(rows, |v| {
        let mut z = vec![0.0; v.len() * n_h];
        rbm.excitation(v, &mut z);
        let hidden: f64 = z.into_iter().map(|z| softplus(f64::from(z))).sum();
        v.iter().map(|v| rbm.visible_energy(v)).sum::<f64>() - hidden
    })
}

/// Σᵢ log p(vᵢ | v₋ᵢ), mean over rows; none for Gaussian units. Exact, in O(n_v n_h) a row: moving one unit changes
/// every hidden excitation z by a share of a weight, and softplus(z + w) − softplus(z) = log(1 + σ(z)(e^w − 1)).
///
/// A value between 0 and 1 counts as a probability: its term is v log p + (1 − v) log(1 − p), the others held as they are.
pub fn pseudo_log_likelihood(rbm: &Rbm, rows: Rows<'_>) -> Option<f64> {
    if rbm.visible() != Visible::Bernoulli {
        return None;
    }
    let n_h = rbm.shape().1;
    let tame = rbm.weights().data().iter().all(|w| w.abs() < TAME);
    // e^w − 1 and e^−w − 1: what turning a unit on or off multiplies.
    let on: Vec<f32> = rbm.weights().data().iter().map(|w| w.exp_m1()).collect();
    let off: Vec<f32> = rbm.weights().data().iter().map(|w| (-w).exp_m1()).collect();
    let (on, off) = (Rows::new(&on, n_h), Rows::new(&off, n_h));
    Some(mean(rows, |v| {
        let mut z = vec![0.0; v.len() * n_h];
        rbm.excitation(v, &mut z);
        let mut h = z.clone();
        logistic(&mut h);
        let mut moved = vec![0.0; n_h];
        let mut sum = 0.0;
        for (v, (z, h)) in v.iter().zip(z.chunks_exact(n_h).zip(h.chunks_exact(n_h))) {
            for (i, &x) in v.iter().enumerate() {
                let w = rbm.weights().row(i);
                // Σⱼ softplus(zⱼ + share · wⱼ), up to what does not depend on the share.
                let mut at = |share: f32| -> f64 {
                    if !tame {
                        return z.iter().zip(w).map(|(z, w)| softplus(f64::from(*z) + f64::from(share * w))).sum();
                    }
                    moved.iter_mut().zip(w).for_each(|(m, w)| *m = (share * w).exp_m1());
                    log_product(h, &moved)
                };
                let gain = match x {
                    0.0 if tame => log_product(h, on.row(i)),
                    1.0 if tame => -log_product(h, off.row(i)),
                    _ => at(1.0 - x) - at(-x),
                };
                let log_odds = f64::from(rbm.visible_bias()[i]) + gain;
                sum += f64::from(x) * log_odds - softplus(log_odds);
            }
        }
        sum
    }))
}

/// Σⱼ log(1 + hⱼ eⱼ), a logarithm for every eight factors.
fn log_product(h: &[f32], e: &[f32]) -> f64 {
    let product = |(h, e): (&[f32], &[f32])| -> f64 {
        h.iter().zip(e).map(|(&h, &e)| 1.0 + f64::from(h) * f64::from(e)).product()
    };
    h.chunks(8).zip(e.chunks(8)).map(|pair| product(pair).ln()).sum()
}

/// Mean over rows from `sum` over chunks of them; the same for any number of threads.
fn mean(rows: Rows<'_>, sum: impl Fn(Rows<'_>) -> f64 + Sync) -> f64 {
    let chunks: Vec<&[f32]> = rows.data().chunks(CHUNK * rows.width()).collect();
    let sums: Vec<f64> = chunks.into_par_iter().map(|chunk| sum(Rows::new(chunk, rows.width()))).collect();
    sums.into_iter().sum::<f64>() / rows.len() as f64
}
