//! Multinomial logistic regression: the paper's classifier on the second hidden layer (section 2.2).
//!
//! log p(y | x) = (xW + b)_y / T − log Σ_l exp((xW + b)_l / T), for rows x of n_in values and n_c classes. W (n_in × n_c)
//! and b minimise the mean of −log p(y | x) + λ/2 ‖W‖², at T = 1; the temperature T is fitted afterwards, on rows held out
//! (Guo et al. 2017). A model holds f32; [`solve`] computes in f64.

mod fit;
mod solver;

pub use self::fit::{Examples, Fit, Solution, solve};

use crate::rbm::io;
use crate::rbm::io::Metadata;
use crate::rbm::number::is_usable;
use crate::rbm::product::rows_times;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The most classes.
const MOST: usize = 256;

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
    /// Fails if they do not fit, a number is not finite or beyond 1e8, or T is not within 0.001 and 1000.
    pub fn new(weights: Vec<f32>, bias: Vec<f32>, temperature: f64) -> Result<Self> {
        let n = bias.len();
        let finite = weights.iter().chain(&bias).all(|x| is_usable(*x));
        let fits = (2..=MOST).contains(&n) && !weights.is_empty() && weights.len().is_multiple_of(n);
        if !fits || !finite || !(1e-3..=1e3).contains(&temperature) {
            return Err(Error::Invalid(format!(
                "a classifier has 2 to {MOST} classes and finite numbers up to 1e8; got {n} classes, {} weights, temperature {temperature}",
                weights.len()
            )));
        }
        Ok(Self { weights, bias, temperature })
    }
    /// Fits rows and their labels (0 to `classes` − 1); with the steps that it took.
    ///
    /// Fails with fewer than two classes, without rows, or where labels do not fit or a value is not finite.
    pub fn fit(rows: Rows<'_>, labels: &[u8], classes: usize, fit: Fit) -> Result<(Self, usize)> {
        let (values, width) = (rows.data(), rows.width());
        let found = solve(Examples { values, width, labels, weights: None, classes }, fit, &|| false)?;
        Ok((Self { weights: narrow(&found.weights), bias: narrow(&found.bias), temperature: 1.0 }, found.steps))
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
    /// Fits T on rows that W and b were not fitted on. Fails if they do not fit.
    pub fn calibrate(&mut self, rows: Rows<'_>, labels: &[u8]) -> Result<()> {
        let (values, width) = (rows.data(), rows.width());
        Examples { values, width, labels, weights: None, classes: self.classes() }.check()?;
        self.temperature = 1.0;
        let mut log_p = vec![0.0; labels.len() * self.classes()];
        self.log_probabilities(rows, &mut log_p);
        self.temperature = temperature(&log_p, labels, self.classes());
        Ok(())
    }
    /// log p(y | x) in nats: a row of n_c for each row of `rows`.
    pub fn log_probabilities(&self, rows: Rows<'_>, log_p: &mut [f64]) {
        let n = self.classes();
        let mut scores = [0.0; MOST];
        let scores = &mut scores[..n];
        for (x, log_p) in rows.iter().zip(log_p.chunks_exact_mut(n)) {
            rows_times(Rows::new(x, rows.width()), &self.weights, scores);
            let all = log_p.iter_mut().zip(&*scores).zip(&self.bias);
            all.for_each(|((q, &s), &b)| *q = (f64::from(s) + f64::from(b)) / self.temperature);
            normalize(log_p);
        }
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

#[cfg(test)]
mod tests;
