//! The Gaussian process and its predictions.

use super::factor::{Factor, Shape};
use super::{Hyper, Kernel};
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// Larger numbers count as this: its square can still be summed.
const LARGEST: f64 = 1e100;

/// A zero-mean Gaussian process given the newest observations, over `D` dimensions.
#[derive(Clone, Debug)]
pub struct Gp<const D: usize> {
    pub(super) kernel: Kernel,
    pub(super) hyper: Hyper<D>,
    window: usize,
    pub(super) points: Vec<[f64; D]>,
    pub(super) values: Vec<f64>,
    pub(super) factor: Factor,
}

/// The state of a process without kernel and window. JSON preserves the bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(serialize = "[f64; D]: Serialize", deserialize = "[f64; D]: Deserialize<'de>"), deny_unknown_fields)]
pub struct Saved<const D: usize> {
    /// The hyper-parameters.
    pub hyper: Hyper<D>,
    /// Where was observed, oldest first.
    pub points: Vec<[f64; D]>,
    /// The observed values.
    pub values: Vec<f64>,
}

fn near(x: f64) -> f64 {
    x.clamp(-LARGEST, LARGEST)
}

impl<const D: usize> Gp<D> {
    /// Nothing observed yet. Holds at most the `window` (1 at least) newest observations, and takes the memory for them now:
    /// 24 bytes × window².
    pub fn new(kernel: Kernel, hyper: Hyper<D>, window: usize) -> Self {
        let window = window.max(1);
        let mut gp = Self {
            kernel,
            hyper: hyper.bounded(),
            window,
            points: Vec::with_capacity(window),
            values: Vec::with_capacity(window),
            factor: Factor::new(D, window),
        };
        gp.rebuild();
        gp
    }

    /// Adds the observation `y` at `x`, and drops the oldest one if the window is full. Returns false, without
    /// change, if a value is not finite.
    pub fn push(&mut self, x: [f64; D], y: f64) -> bool {
        if !(y.is_finite() && x.iter().all(|x| x.is_finite())) {
            return false;
        }
        let slides = self.points.len() == self.window;
        if slides {
            self.points.remove(0);
            self.values.remove(0);
        }
        self.points.push(x.map(near));
        self.values.push(near(y));
        let (shape, factor) = (shape(self.kernel, &self.hyper), &mut self.factor);
        if slides || !factor.extend(&self.points, shape) {
            factor.refactor(&self.points, shape);
        }
        self.factor.whiten(&self.values);
        self.factor.weigh();
        true
    }

    /// Forgets all observations; the hyper-parameters stay.
    pub fn clear(&mut self) {
        self.points.clear();
        self.values.clear();
        self.rebuild();
    }

    /// Observations held.
    pub fn len(&self) -> usize {
        self.points.len()
    }
    /// Whether nothing is held.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
    /// The most that can be held.
    pub fn window(&self) -> usize {
        self.window
    }
    /// Where was observed, oldest first.
    pub fn points(&self) -> &[[f64; D]] {
        &self.points
    }
    /// The observed values.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
    /// The covariance function.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }
    /// The hyper-parameters.
    pub fn hyper(&self) -> &Hyper<D> {
        &self.hyper
    }
    /// The term on the diagonal beside the noise.
    pub fn jitter(&self) -> f64 {
        self.factor.jitter
    }

    /// Other values at the same points, for example standardised anew: n² operations, the factor stays. A NaN
    /// counts as 0.
    ///
    /// # Panics
    /// If there is not one value for each point.
    pub fn set_values(&mut self, values: &[f64]) {
        assert_eq!(values.len(), self.points.len(), "one value for each point");
        for (own, &y) in self.values.iter_mut().zip(values) {
            *own = if y.is_nan() { 0.0 } else { near(y) };
        }
        self.factor.whiten(&self.values);
        self.factor.weigh();
    }

    /// Other hyper-parameters: n³/6 operations.
    pub fn set_hyper(&mut self, hyper: Hyper<D>) {
        self.hyper = hyper.bounded();
        self.rebuild();
    }

    pub(super) fn rebuild(&mut self) {
        self.factor.refactor(&self.points, shape(self.kernel, &self.hyper));
        self.factor.whiten(&self.values);
        self.factor.weigh();
    }

    /// Mean and variance of f (not of a value, which has the noise too) at `x`; the prior's, (0, σₘ²), far from all points.
    ///
    /// [`predict_many`](Self::predict_many) gives the same bits in less time. Allocates for windows above 1024 only.
    pub fn predict(&self, x: &[f64; D]) -> (f64, f64) {
        self.factor.predict(&x.map(place), shape(self.kernel, &self.hyper))
    }

    /// [`predict`](Self::predict) at every point of `xs`; a point's bits do not depend on its neighbours.
    ///
    /// # Panics
    /// If `means` and `variances` are not as long as `xs`.
    pub fn predict_many(&mut self, xs: &[[f64; D]], means: &mut [f64], variances: &mut [f64]) {
        assert!(means.len() == xs.len() && variances.len() == xs.len(), "one mean and one variance for each point");
        let shape = shape(self.kernel, &self.hyper);
        self.factor.predict_many(xs.iter().map(|x| x.map(place)), shape, means, variances);
    }

    /// ln p(values | points, hyper-parameters), in nats.
    pub fn log_marginal_likelihood(&self) -> f64 {
        self.factor.log_likelihood()
    }

    /// Its derivatives by the logarithms of the length scales, then of σₘ² and σₙ².
    ///
    /// # Panics
    /// If `out` has not D + 2 numbers.
    pub fn log_marginal_likelihood_gradient(&mut self, out: &mut [f64]) {
        assert_eq!(out.len(), D + 2, "length scales, signal and noise");
        self.factor.gradient(self.hyper.noise_variance, out);
    }

    /// What [`restore`](Self::restore) needs.
    pub fn save(&self) -> Saved<D> {
        Saved { hyper: self.hyper, points: self.points.clone(), values: self.values.clone() }
    }

    /// Restores a saved state, bit for bit if kernel and window are the same.
    pub fn restore(&mut self, saved: &Saved<D>) -> Result<()> {
        let finite = |xs: &[f64]| xs.iter().all(|x| x.is_finite());
        let n = saved.points.len();
        if n != saved.values.len() || n > self.window {
            let (values, window) = (saved.values.len(), self.window);
            return Err(Error::Invalid(format!(
                "a saved Gaussian process: expected as many values as points, {window} at most; found {n} points and \
                 {values} values; save it again, or set the window it was saved with"
            )));
        }
        if saved.hyper != saved.hyper.bounded() || !finite(saved.points.as_flattened()) || !finite(&saved.values) {
            return Err(Error::Invalid(
                "a saved Gaussian process: expected finite points and values, and hyper-parameters above 0; \
                 found others; save it again"
                    .into(),
            ));
        }
        self.hyper = saved.hyper;
        self.points.clear();
        self.points.extend(saved.points.iter().map(|x| x.map(near)));
        self.values.clear();
        self.values.extend(saved.values.iter().copied().map(near));
        self.rebuild();
        Ok(())
    }
}

/// A NaN is far from everything.
fn place(x: f64) -> f64 {
    if x.is_nan() { LARGEST } else { near(x) }
}

pub(super) fn shape<const D: usize>(kernel: Kernel, hyper: &Hyper<D>) -> Shape<'_> {
    Shape { kernel, length_scales: &hyper.length_scales, signal: hyper.signal_variance, noise: hyper.noise_variance }
}
