//! Finding W and b, in f64.
//!
//! The solver's variables are V and a with W_i = t_i V_i and b = t_b a − Σ m_i W_i, where m_i is the mean of column i. Gains t make the
//! cost's curvature about 1 in each variable at V = 0: the curvature of the likelihood by W_i is h s_i² with h = (1 − 1/n)/n and s_i the
//! column's deviation, that of the penalty λ. So columns of any units take few steps; the minimum is the same.

use super::solver::minimize;
use super::{MOST, normalize};
use crate::Stop;
use foveate_base::{Error, Result};
use foveate_kernels::{Matrix, Write, matrix_product_f64};
use serde::{Deserialize, Serialize};

/// Rows of one product: fixed, so that no sum depends on the number of threads.
const TOGETHER: usize = 256;

/// How to fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// λ, the pull of W towards 0.
    pub l2: f64,
    /// Steps of L-BFGS, at most.
    pub steps: usize,
    /// It ends where no part of the gradient is larger than this, in units in which the curvature is about 1.
    pub tolerance: f64,
}

impl Default for Fit {
    fn default() -> Self {
        Self { l2: 1e-4, steps: 200, tolerance: 1e-5 }
    }
}

/// Rows of `width` values, row by row, with a label (0 to `classes` − 1) each.
#[derive(Clone, Copy, Debug)]
pub struct Examples<'a, T> {
    /// rows × `width`.
    pub values: &'a [T],
    /// n_in.
    pub width: usize,
    /// One a row.
    pub labels: &'a [u8],
    /// How much each row counts, at least 0, not all 0; all the same if absent.
    pub weights: Option<&'a [f64]>,
    /// n_c, 2 to 256.
    pub classes: usize,
}

/// The minimum, or how far the steps went.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// W, n_in × n_c, row-major.
    pub weights: Vec<f64>,
    /// b, n_c.
    pub bias: Vec<f64>,
    /// Steps taken.
    pub steps: usize,
    /// Whether the gradient is within the tolerance, or rounding prevents any step down.
    pub converged: bool,
}

/// Minimises the mean of −log p(y | x), each row by its weight, + λ/2 ‖W‖².
///
/// # Errors
/// Fails if the examples do not fit ([`Examples::check`]), and [`Error::Stopped`] after `stop` returned true; it is called for every 256
/// rows.
pub fn solve<T: Copy + Into<f64>>(examples: Examples<'_, T>, fit: Fit, stop: Stop<'_>) -> Result<Solution> {
    examples.check()?;
    let (n_in, n) = (examples.width, examples.classes);
    let mut problem = Problem::new(examples, fit.l2);
    let mut at = vec![0.0; (n_in + 1) * n];
    let mut objective = |at: &[f64], gradient: &mut [f64]| problem.cost(at, gradient, stop);
    let (steps, converged) = minimize(&mut objective, &mut at, fit.steps, fit.tolerance)?;
    let (weights, bias) = problem.plain(&at);
    Ok(Solution { weights, bias, steps, converged })
}

impl<T: Copy + Into<f64>> Examples<'_, T> {
    /// # Errors
    /// [`Error::Invalid`] unless there is a row at least, all values are finite, and labels, weights and classes are as described.
    pub fn check(&self) -> Result<()> {
        let rows = self.labels.len();
        let fit = self.width > 0
            && rows.checked_mul(self.width) == Some(self.values.len())
            && self.labels.iter().all(|&l| usize::from(l) < self.classes);
        let finite = self.values.iter().all(|&x| x.into().is_finite());
        if !(fit && finite && rows > 0 && (2..=MOST).contains(&self.classes)) {
            return Err(Error::Invalid(format!(
                "a classifier needs 2 to {MOST} classes, at least one row of finite numbers, and a label under {} for each of {} rows; got {rows} labels",
                self.classes,
                self.values.len() / self.width.max(1),
            )));
        }
        let good =
            |w: &[f64]| w.len() == rows && w.iter().all(|w| *w >= 0.0 && w.is_finite()) && w.iter().any(|w| *w > 0.0);
        if self.weights.is_some_and(|w| !good(w)) {
            return Err(Error::Invalid(format!(
                "weights of rows are {rows} finite numbers, at least 0 and not all 0; got others"
            )));
        }
        Ok(())
    }
    fn weight(&self, row: usize) -> f64 {
        self.weights.map_or(1.0, |w| w[row])
    }
}

/// The cost as a function of V, then a.
struct Problem<'a, T> {
    examples: Examples<'a, T>,
    l2: f64,
    /// Sum of the rows' weights.
    total: f64,
    /// m and t of each column; t_b.
    columns: Vec<(f64, f64)>,
    bias_gain: f64,
    /// Of some rows: their scaled values and their scores.
    scaled: Vec<f64>,
    scores: Vec<f64>,
}

impl<'a, T: Copy + Into<f64>> Problem<'a, T> {
    fn new(examples: Examples<'a, T>, l2: f64) -> Self {
        let (n_in, n) = (examples.width, examples.classes as f64);
        let rows = examples.values.chunks_exact(n_in).enumerate();
        let total: f64 = (0..examples.labels.len()).map(|i| examples.weight(i)).sum();
        let (mut means, mut variances) = (vec![0.0; n_in], vec![0.0; n_in]);
        for (i, row) in rows.clone() {
            let share = examples.weight(i) / total;
            means.iter_mut().zip(row).for_each(|(m, &x)| *m += share * x.into());
        }
        for (i, row) in rows {
            let share = examples.weight(i) / total;
            let parts = variances.iter_mut().zip(row).zip(&means);
            parts.for_each(|((v, &x), m)| *v += share * (x.into() - m).powi(2));
        }
        let curvature = (1.0 - 1.0 / n) / n;
        let gain = |(m, v): (f64, f64)| {
            // A column that varies by rounding alone is constant.
            let varies = v.sqrt() > 1e-12 * m.abs();
            let both = l2 + if varies { curvature * v } else { 0.0 };
            (m, if both > 0.0 && varies { both.sqrt().recip() } else { 0.0 })
        };
        let columns = means.into_iter().zip(variances).map(gain).collect();
        let (scaled, scores) = (vec![0.0; TOGETHER * n_in], vec![0.0; TOGETHER * examples.classes]);
        Self { examples, l2, total, columns, bias_gain: curvature.sqrt().recip(), scaled, scores }
    }

    /// W and b.
    fn plain(&self, at: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = self.examples.classes;
        let (v, a) = at.split_at(self.columns.len() * n);
        let mut weights = v.to_vec();
        let mut bias: Vec<f64> = a.iter().map(|a| self.bias_gain * a).collect();
        for (w, (m, t)) in weights.chunks_exact_mut(n).zip(&self.columns) {
            w.iter_mut().zip(&mut bias).for_each(|(w, b)| {
                *w *= t;
                *b -= m * *w;
            });
        }
        (weights, bias)
    }

    fn cost(&mut self, at: &[f64], gradient: &mut [f64], stop: Stop<'_>) -> Result<f64> {
        let Self { examples, l2, total, columns, bias_gain, scaled, scores } = self;
        let (n_in, n) = (columns.len(), examples.classes);
        let ((v, a), mut cost, mut first) = (at.split_at(n_in * n), 0.0, 0);
        gradient.fill(0.0);
        let (to_v, to_a) = gradient.split_at_mut(n_in * n);
        for values in examples.values.chunks(TOGETHER * n_in) {
            if stop() {
                return Err(Error::Stopped);
            }
            let m = values.len() / n_in;
            for (z, x) in scaled.chunks_exact_mut(n_in).zip(values.chunks_exact(n_in)) {
                z.iter_mut().zip(x).zip(&*columns).for_each(|((z, &x), (mean, gain))| *z = (x.into() - mean) * gain);
            }
            let z = Matrix::new(&scaled[..m * n_in], n_in);
            let scores = &mut scores[..m * n];
            matrix_product_f64(z, Matrix::new(v, n), Write::Replace, scores);
            for (i, log_p) in scores.chunks_exact_mut(n).enumerate() {
                let (label, share) = (usize::from(examples.labels[first + i]), examples.weight(first + i) / *total);
                log_p.iter_mut().zip(a).for_each(|(q, a)| *q += *bias_gain * a);
                normalize(log_p);
                cost -= share * log_p[label];
                for (l, q) in log_p.iter_mut().enumerate() {
                    *q = share * (q.exp() - if l == label { 1.0 } else { 0.0 });
                    to_a[l] += *bias_gain * *q;
                }
            }
            matrix_product_f64(z.transposed(), Matrix::new(scores, n), Write::Add, to_v);
            first += m;
        }
        for ((v, to_v), (_, t)) in v.chunks_exact(n).zip(to_v.chunks_exact_mut(n)).zip(&*columns) {
            for (v, to_v) in v.iter().zip(to_v) {
                *to_v += *l2 * t * t * v;
                cost += 0.5 * *l2 * (t * v).powi(2);
            }
        }
        Ok(cost)
    }
}

#[cfg(test)]
mod tests;
