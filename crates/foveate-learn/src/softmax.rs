//! Multinomial logistic regression: the paper's classifier on the second hidden layer (section 2.2).
//!
//! log p(y | x) = (xW + b)_y / T − log Σ_l exp((xW + b)_l / T), for rows x of n_in values and n_c classes. W (n_in × n_c)
//! and b minimise the mean of −log p(y | x) + λ/2 ‖W‖² by L-BFGS (Nocedal 1980), at T = 1; the temperature T is fitted
//! afterwards, on rows held out (Guo et al. 2017). Products are of f32, sums and the solver's numbers f64.

use crate::rbm::io;
use crate::rbm::io::Metadata;
use crate::rbm::product::{add_outer, rows_times};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;

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
    /// It ends where no part of the gradient is larger than this.
    pub tolerance: f64,
}

impl Default for Fit {
    fn default() -> Self {
        Self { l2: 1e-4, steps: 200, tolerance: 1e-5 }
    }
}

/// Logistic regression for several classes.
#[derive(Clone, Debug, PartialEq)]
pub struct Softmax {
    /// n_in × n_c.
    weights: Vec<f32>,
    bias: Vec<f32>,
    temperature: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct About {
    temperature: f64,
    metadata: Metadata,
}

impl Softmax {
    /// From W (n_in × n_c, row-major), b (n_c) and T.
    ///
    /// Fails where they do not fit, a number is not finite, or T is not within 0.001 and 1000.
    pub fn new(weights: Vec<f32>, bias: Vec<f32>, temperature: f64) -> Result<Self> {
        let n = bias.len();
        let finite = weights.iter().chain(&bias).all(|x| x.is_finite());
        let fits = (2..=TOGETHER).contains(&n) && !weights.is_empty() && weights.len().is_multiple_of(n);
        if !fits || !finite || !(1e-3..=1e3).contains(&temperature) {
            return Err(Error::Invalid(format!(
                "a classifier has 2 to {TOGETHER} classes and finite numbers; got {n} classes, {} weights, temperature {temperature}",
                weights.len()
            )));
        }
        Ok(Self { weights, bias, temperature })
    }
    /// Fits rows and their labels (0 to `classes` − 1); with the steps that it took.
    ///
    /// Fails with fewer than two classes, without rows, or where labels do not fit or a value is not finite.
    pub fn fit(rows: Rows<'_>, labels: &[u8], classes: usize, fit: Fit) -> Result<(Self, usize)> {
        check(rows, labels, classes)?;
        let n_in = rows.width();
        let mut parameters = vec![0.0; (n_in + 1) * classes];
        let mut objective = |at: &[f64], gradient: &mut [f64]| {
            let (w, b) = at.split_at(n_in * classes);
            let model = Self { weights: narrow(w), bias: narrow(b), temperature: 1.0 };
            model.cost(rows, labels, fit.l2, gradient)
        };
        let steps = minimize(&mut objective, &mut parameters, fit.steps, fit.tolerance);
        let (w, b) = parameters.split_at(n_in * classes);
        Ok((Self { weights: narrow(w), bias: narrow(b), temperature: 1.0 }, steps))
    }
    /// n_in.
    pub fn width(&self) -> usize {
        self.weights.len() / self.bias.len()
    }
    /// n_c.
    pub fn classes(&self) -> usize {
        self.bias.len()
    }
    /// T.
    pub fn temperature(&self) -> f64 {
        self.temperature
    }
    /// The same at another temperature, within 0.001 and 1000.
    pub fn at(self, temperature: f64) -> Self {
        Self { temperature: temperature.clamp(1e-3, 1e3), ..self }
    }
    /// Fits T on rows that W and b were not fitted on. Fails where they do not fit.
    pub fn calibrate(&mut self, rows: Rows<'_>, labels: &[u8]) -> Result<()> {
        check(rows, labels, self.classes())?;
        self.temperature = 1.0;
        let mut log_p = vec![0.0; labels.len() * self.classes()];
        self.log_probabilities(rows, &mut log_p);
        self.temperature = temperature(&log_p, labels, self.classes());
        Ok(())
    }
    /// log p(y | x) in nats: a row of n_c for each row of `rows`.
    pub fn log_probabilities(&self, rows: Rows<'_>, log_p: &mut [f64]) {
        let n = self.classes();
        let mut scores = [0.0; TOGETHER];
        let scores = &mut scores[..n];
        for (x, log_p) in rows.iter().zip(log_p.chunks_exact_mut(n)) {
            rows_times(Rows::new(x, rows.width()), &self.weights, scores);
            let all = log_p.iter_mut().zip(&*scores).zip(&self.bias);
            all.for_each(|((q, &s), &b)| *q = (f64::from(s) + f64::from(b)) / self.temperature);
            normalize(log_p);
        }
    }
    /// The mean of −log p(y | x), and λ/2 ‖W‖²; with its gradient.
    fn cost(&self, rows: Rows<'_>, labels: &[u8], l2: f64, gradient: &mut [f64]) -> f64 {
        let (n_in, n, total) = (rows.width(), self.classes(), rows.len() as f64);
        let (mut scores, mut outer) = (vec![0.0; TOGETHER * n], vec![0.0; n_in * n]);
        let (mut cost, mut log_p) = (0.0, vec![0.0; n]);
        gradient.fill(0.0);
        let (to_w, to_b) = gradient.split_at_mut(n_in * n);
        for (x, labels) in rows.data().chunks(TOGETHER * n_in).zip(labels.chunks(TOGETHER)) {
            let scores = &mut scores[..labels.len() * n];
            rows_times(Rows::new(x, n_in), &self.weights, scores);
            for (scores, &label) in scores.chunks_exact_mut(n).zip(labels) {
                let label = usize::from(label);
                log_p
                    .iter_mut()
                    .zip(&*scores)
                    .zip(&self.bias)
                    .for_each(|((q, &s), &b)| *q = f64::from(s) + f64::from(b));
                normalize(&mut log_p);
                cost -= log_p[label] / total;
                for (l, q) in log_p.iter().enumerate() {
                    let slope = q.exp() - if l == label { 1.0 } else { 0.0 };
                    to_b[l] += slope / total;
                    scores[l] = slope as f32;
                }
            }
            outer.fill(0.0);
            add_outer(&mut outer, 1.0, Rows::new(x, n_in), 0, Rows::new(scores, n));
            to_w.iter_mut().zip(&outer).for_each(|(g, &o)| *g += f64::from(o) / total);
        }
        for (g, &w) in to_w.iter_mut().zip(&self.weights) {
            *g += l2 * f64::from(w);
            cost += 0.5 * l2 * f64::from(w).powi(2);
        }
        cost
    }
    /// Writes a model file; it is whole or not there.
    pub fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        let about = About { temperature: self.temperature, metadata: metadata.clone() };
        files::write(path, &io::pack("softmax", about, &self.tensors()))
    }
    /// W and b, as model files have them.
    pub fn tensors(&self) -> [io::Tensor<'_>; 2] {
        let (n_in, n) = (self.width(), self.classes());
        [("weights", vec![n_in, n], &*self.weights), ("bias", vec![n], &*self.bias)]
    }
    /// From the tensors of a model file; problems in words.
    pub fn of_tensors(mut tensors: io::Tensors, temperature: f64) -> std::result::Result<Self, String> {
        let (Some((shape, weights)), Some((_, bias))) = (tensors.remove("weights"), tensors.remove("bias")) else {
            return Err("weights or bias are missing".into());
        };
        if shape.len() != 2 || shape[1] != bias.len() {
            return Err(format!("weights are {shape:?} for {} classes", bias.len()));
        }
        Self::new(weights, bias, temperature).map_err(|e| e.to_string())
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors. Fails, with the reason, if it is none, or is
    /// damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let refuse = |problem: String| Error::malformed(path, format!("not a usable classifier: {problem}"));
        let (about, tensors, sealed) = io::unpack::<About>(bytes, "softmax").map_err(refuse)?;
        let softmax = Self::of_tensors(tensors, about.temperature).map_err(refuse)?;
        sealed.map_err(refuse)?;
        Ok((softmax, about.metadata))
    }
    /// Reads a model file; see [`Softmax::from_bytes`].
    pub fn load(path: &Path) -> Result<(Self, Metadata)> {
        Self::from_bytes(&io::read(path)?, path)
    }
}

fn narrow(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn check(rows: Rows<'_>, labels: &[u8], classes: usize) -> Result<()> {
    let fit = labels.len() == rows.len() && labels.iter().all(|&l| usize::from(l) < classes);
    let finite = rows.data().iter().all(|x| x.is_finite());
    if fit && finite && !rows.is_empty() && (2..=TOGETHER).contains(&classes) {
        return Ok(());
    }
    Err(Error::Invalid(format!(
        "a classifier needs 2 to {TOGETHER} classes, at least one row of finite numbers, and a label under {classes} for each of {} rows; got {} labels",
        rows.len(),
        labels.len()
    )))
}

/// Takes log Σ exp from every value, and answers it.
pub fn normalize(log_p: &mut [f64]) -> f64 {
    let most = log_p.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let log_sum = most + log_p.iter().map(|q| (q - most).exp()).sum::<f64>().ln();
    log_p.iter_mut().for_each(|q| *q -= log_sum);
    log_sum
}

/// The temperature T at which log-probabilities (a row of `classes` for each label) divided by T, and normalised again,
/// give the labels the greatest likelihood. The likelihood has one maximum in 1/T; it is sought from 1/20 to 20.
pub fn temperature(log_p: &[f64], labels: &[u8], classes: usize) -> f64 {
    let cost = |log_t: f64| -> f64 {
        let scale = (-log_t).exp();
        let rows = log_p.chunks_exact(classes).zip(labels);
        rows.map(|(q, &label)| {
            let most = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let sum: f64 = q.iter().map(|q| (scale * (q - most)).exp()).sum();
            sum.ln() - scale * (q[usize::from(label)] - most)
        })
        .sum()
    };
    // Golden section: each step keeps one of the two inner points.
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = (-(20f64.ln()), 20f64.ln());
    let inner = |low: f64, high: f64| (high - golden * (high - low), low + golden * (high - low));
    let (mut a, mut b) = inner(low, high);
    let (mut at_a, mut at_b) = (cost(a), cost(b));
    while high - low > 1e-4 {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = inner(low, high).0;
            at_a = cost(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = inner(low, high).1;
            at_b = cost(b);
        }
    }
    (0.5 * (low + high)).exp()
}

/// A function's value, and its gradient into the second slice.
type Objective<'a> = &'a mut dyn FnMut(&[f64], &mut [f64]) -> f64;

/// L-BFGS with ten pairs, and a search along each direction that halves or doubles the step until the weak Wolfe
/// conditions hold (Lewis & Overton 2013). Answers the steps it took.
fn minimize(objective: Objective<'_>, x: &mut [f64], steps: usize, tolerance: f64) -> usize {
    const PAIRS: usize = 10;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (mut gradient, mut next, mut tried) = (vec![0.0; x.len()], x.to_vec(), vec![0.0; x.len()]);
    let mut value = objective(x, &mut gradient);
    let mut pairs: VecDeque<(Vec<f64>, Vec<f64>, f64)> = VecDeque::new();
    for step in 0..steps {
        if gradient.iter().all(|g| g.abs() <= tolerance) {
            return step;
        }
        // The direction: minus the inverse Hessian's estimate times the gradient, by two loops.
        let mut d: Vec<f64> = gradient.iter().map(|g| -g).collect();
        let mut shares = vec![];
        for (s, y, sy) in pairs.iter().rev() {
            let share = dot(s, &d) / sy;
            d.iter_mut().zip(y).for_each(|(d, y)| *d -= share * y);
            shares.push(share);
        }
        let scale = pairs.back().map_or(1.0 / dot(&d, &d).sqrt().max(1.0), |(_, y, sy)| sy / dot(y, y));
        d.iter_mut().for_each(|d| *d *= scale);
        for ((s, y, sy), share) in pairs.iter().zip(shares.into_iter().rev()) {
            let back = share - dot(y, &d) / sy;
            d.iter_mut().zip(s).for_each(|(d, s)| *d += back * s);
        }
        // The step along it.
        let slope = dot(&d, &gradient);
        let (mut low, mut high, mut t) = (0.0, f64::INFINITY, 1.0);
        let (mut found, mut is_last) = (None, false);
        for _ in 0..30 {
            next.iter_mut().zip(&*x).zip(&d).for_each(|((n, x), d)| *n = x + t * d);
            let there = objective(&next, &mut tried);
            if there.is_nan() || there > value + 1e-4 * t * slope {
                high = t;
            } else {
                found = Some((t, there));
                is_last = dot(&d, &tried) >= 0.9 * slope;
                if is_last {
                    break;
                }
                low = t;
            }
            t = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * t };
        }
        // No step goes down: the numbers' precision is reached.
        let Some((accepted, there)) = found.filter(|&(_, there)| there < value) else { return step };
        if !is_last {
            next.iter_mut().zip(&*x).zip(&d).for_each(|((n, x), d)| *n = x + accepted * d);
            objective(&next, &mut tried);
        }
        let s: Vec<f64> = next.iter().zip(&*x).map(|(n, x)| n - x).collect();
        let y: Vec<f64> = tried.iter().zip(&gradient).map(|(n, g)| n - g).collect();
        let sy = dot(&s, &y);
        if sy > 1e-12 * dot(&y, &y) {
            pairs.push_back((s, y, sy));
            if pairs.len() > PAIRS {
                pairs.pop_front();
            }
        }
        x.copy_from_slice(&next);
        std::mem::swap(&mut gradient, &mut tried);
        value = there;
    }
    steps
}

#[cfg(test)]
mod tests;
