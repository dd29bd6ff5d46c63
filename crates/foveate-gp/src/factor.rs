//! The Cholesky factor of K + σₙ² I, its inverse, and their products; points are stored by coordinate.

use super::Kernel;
use foveate_kernels::{self as kernels, Points, Posterior, SQUARE};

/// Added to the diagonal, times σₘ². Without it a smooth kernel without noise loses rank after a dozen near points.
pub(super) const JITTER: f64 = 1e-10;
/// A pivot below this part of the diagonal is rounding error.
const PIVOT: f64 = 1e-13;
/// Points predicted together.
const TOGETHER: usize = 64;

/// The numbers that a covariance matrix is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape<'a> {
    pub kernel: Kernel,
    pub length_scales: &'a [f64],
    pub signal: f64,
    pub noise: f64,
}

/// A factor of up to `stride` points, all memory taken.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    n: usize,
    stride: usize,
    /// `[d * stride + i]`: points divided by the length scales, zeros after the last.
    scaled: Vec<f64>,
    /// U, with UᵀU = K + (σₙ² + jitter) I; the slopes ∂k; W = U⁻ᵀ.
    u: Vec<f64>,
    slope: Vec<f64>,
    w: Vec<f64>,
    /// W belongs to U.
    inverted: bool,
    /// 1 / the diagonal of U.
    reciprocal: Vec<f64>,
    /// z = U⁻ᵀ y, and α = (K + σₙ² I)⁻¹ y, zeros after the last.
    whitened: Vec<f64>,
    alpha: Vec<f64>,
    /// The term added to the diagonal beside the noise.
    pub jitter: f64,
    /// Rows for whatever is at hand; points to predict at; covariances with them.
    row: Vec<f64>,
    rows: Vec<f64>,
    batch: Vec<f64>,
    scratch: Vec<f64>,
}

impl Factor {
    pub(crate) fn new(dims: usize, window: usize) -> Self {
        let stride = window.next_multiple_of(SQUARE);
        let (square, zeros) = (stride * stride, |n| vec![0.0; n]);
        Self {
            n: 0,
            stride,
            scaled: zeros(dims * stride),
            u: zeros(square),
            slope: zeros(square),
            w: zeros(square),
            inverted: false,
            reciprocal: zeros(stride),
            whitened: zeros(stride),
            alpha: zeros(stride),
            jitter: 0.0,
            row: zeros(2 * stride),
            rows: zeros(dims.max(2) * stride),
            batch: zeros(dims * TOGETHER),
            scratch: zeros(SQUARE * stride),
        }
    }

    fn points(&self) -> Points<'_> {
        Points { coordinates: &self.scaled, stride: self.stride, n: self.n }
    }

    /// Factors the covariances of these points anew. What depends on the values, and the inverse, are out of date then.
    pub(crate) fn refactor<const D: usize>(&mut self, points: &[[f64; D]], shape: Shape) {
        (self.n, self.inverted) = (points.len(), false);
        for (d, scaled) in self.scaled.chunks_exact_mut(self.stride).enumerate() {
            scaled.fill(0.0);
            for (scaled, point) in scaled.iter_mut().zip(points) {
                *scaled = point[d] / shape.length_scales[d];
            }
        }
        self.jitter = JITTER * shape.signal;
        loop {
            let points = Points { coordinates: &self.scaled, stride: self.stride, n: self.n };
            kernels::covariances(shape.kernel.kind(), shape.signal, points, &mut self.u, &mut self.slope);
            let added = shape.noise + self.jitter;
            self.u.iter_mut().step_by(self.stride + 1).take(self.n).for_each(|u| *u += added);
            let floor = PIVOT * (shape.signal + added);
            if kernels::factor(&mut self.u, self.stride, self.n, floor, &mut self.reciprocal) == self.n {
                return;
            }
            self.jitter *= 100.0;
        }
    }

    /// Adds the last of `points` to the factor; false if the factor must be computed again.
    pub(crate) fn extend<const D: usize>(&mut self, points: &[[f64; D]], shape: Shape) -> bool {
        let n = self.n;
        let [.., point] = points else { return true };
        let mut new = [[0.0; SQUARE]; D];
        for (d, scaled) in self.scaled.chunks_exact_mut(self.stride).enumerate() {
            scaled[n] = point[d] / shape.length_scales[d];
            new[d][0] = scaled[n];
        }
        self.n = n + 1;
        let new = Points { coordinates: new.as_flattened(), stride: SQUARE, n: 1 };
        let (column, slope) = self.row.split_at_mut(self.stride);
        let width = self.n.next_multiple_of(SQUARE);
        let points = Points { coordinates: &self.scaled, stride: self.stride, n: self.n };
        let (column, slope) = (&mut column[..width], &mut slope[..width]);
        kernels::covariances_with(shape.kernel.kind(), shape.signal, points, new, column, slope);
        let added = shape.noise + self.jitter;
        column[n] += added;
        let (column, floor) = (&mut column[..self.n], PIVOT * (shape.signal + added));
        if !kernels::extend(&mut self.u, self.stride, floor, &mut self.reciprocal, column) {
            return false;
        }
        for (k, slope) in slope[..self.n].iter().enumerate() {
            self.slope[k * self.stride + n] = *slope;
        }
        self.inverted = false;
        true
    }

    /// Takes the values into account: z, and with it the likelihood.
    pub(crate) fn whiten(&mut self, values: &[f64]) {
        self.whitened[..self.n].copy_from_slice(values);
        kernels::solve(&self.u, self.stride, &self.reciprocal, &mut self.whitened[..self.n]);
    }

    /// The inverse of the factor, if it is not there.
    fn invert(&mut self) {
        if std::mem::replace(&mut self.inverted, true) {
            return;
        }
        kernels::invert(&self.u, self.stride, (0, self.n), &self.reciprocal, &mut self.w);
    }

    /// α, from z.
    pub(crate) fn weigh(&mut self) {
        self.alpha[..self.n].copy_from_slice(&self.whitened[..self.n]);
        self.alpha[self.n..].fill(0.0);
        kernels::solve_back(&self.u, self.stride, &self.reciprocal, &mut self.alpha[..self.n]);
    }

    /// ln p(y) = −½ zᵀz − Σ ln U_ii − n/2 ln 2π.
    pub(crate) fn log_likelihood(&self) -> f64 {
        let fit: f64 = self.whitened[..self.n].iter().map(|z| z * z).sum();
        let log_root: f64 = self.reciprocal[..self.n].iter().map(|r| -r.ln()).sum();
        -0.5 * fit - log_root - 0.5 * self.n as f64 * std::f64::consts::TAU.ln()
    }

    /// ∂ ln p(y) by ln ℓ_d, then by ln σₘ² and ln σₙ²: ½ tr((α αᵀ − (K + σₙ² I)⁻¹) ∂K).
    pub(crate) fn gradient(&mut self, noise: f64, out: &mut [f64]) {
        self.invert();
        let dims = out.len() - 2;
        kernels::likelihood_gradient(self.points(), &self.slope, &self.w, &self.alpha, &mut out[..=dims]);
        let trace = out[0];
        out.copy_within(1..=dims, 0);
        let fit: f64 = self.whitened[..self.n].iter().map(|z| z * z).sum();
        out[dims] = 0.5 * (fit - self.n as f64 - noise * trace);
        out[dims + 1] = 0.5 * noise * trace;
    }

    /// The average of observed and expected information on the logarithms of the hyper-parameters, ½ aᵢᵀ (K + σₙ² I)⁻¹ aⱼ
    /// with aᵢ = ∂K/∂θᵢ α (Gilmour, Thompson & Cullis 1995): never negative, and n² operations. `put(i, j, value)` for i ≥ j.
    pub(crate) fn information(&mut self, dims: usize, noise: f64, mut put: impl FnMut(usize, usize, f64)) {
        let (stride, n) = (self.stride, self.n);
        let Self { scaled, slope, alpha, rows, row, .. } = self;
        let points = Points { coordinates: scaled, stride, n };
        kernels::slopes_times(points, slope, alpha, &mut rows[..dims * stride]);
        let (signal, noisy) = row.split_at_mut(stride);
        for (noisy, alpha) in noisy[..n].iter_mut().zip(&*alpha) {
            *noisy = noise * alpha;
        }
        let solve = |b: &mut [f64]| kernels::solve(&self.u, stride, &self.reciprocal, &mut b[..n]);
        rows[..dims * stride].chunks_exact_mut(stride).for_each(solve);
        solve(noisy);
        // (K + jitter) α = y − σₙ² α.
        for ((signal, noisy), z) in signal[..n].iter_mut().zip(&*noisy).zip(&self.whitened) {
            *signal = z - noisy;
        }
        let whitened = |i: usize| match i.checked_sub(dims) {
            None => &rows[i * stride..][..n],
            Some(0) => &signal[..n],
            Some(_) => &noisy[..n],
        };
        for i in 0..dims + 2 {
            for j in 0..=i {
                put(i, j, 0.5 * whitened(i).iter().zip(whitened(j)).map(|(a, b)| a * b).sum::<f64>());
            }
        }
    }

    fn posterior(&self, kernel: Kernel, signal: f64) -> Posterior<'_> {
        Posterior {
            kind: kernel.kind(),
            variance: signal,
            points: self.points(),
            u: &self.u,
            reciprocal: &self.reciprocal,
            alpha: &self.alpha[..self.n],
        }
    }

    /// Mean and variance at one point.
    pub(crate) fn predict<const D: usize>(&self, x: &[f64; D], shape: Shape) -> (f64, f64) {
        let mut at = [[0.0; SQUARE]; D];
        for d in 0..D {
            at[d][0] = x[d] / shape.length_scales[d];
        }
        let at = Points { coordinates: at.as_flattened(), stride: SQUARE, n: 1 };
        let posterior = self.posterior(shape.kernel, shape.signal);
        let (mut mean, mut variance) = ([0.0], [0.0]);
        let mut predict = |scratch: &mut [f64]| kernels::predict(&posterior, at, scratch, &mut mean, &mut variance);
        match self.n {
            0..=128 => predict(&mut [0.0; 128]),
            129..=1024 => predict(&mut [0.0; 1024]),
            n => predict(&mut vec![0.0; n.next_multiple_of(SQUARE)]),
        }
        (mean[0], variance[0])
    }

    /// Means and variances at many points.
    pub(crate) fn predict_many<const D: usize>(
        &mut self,
        xs: impl Iterator<Item = [f64; D]>,
        shape: Shape,
        means: &mut [f64],
        variances: &mut [f64],
    ) {
        let (mut batch, mut scratch) = (std::mem::take(&mut self.batch), std::mem::take(&mut self.scratch));
        let posterior = self.posterior(shape.kernel, shape.signal);
        let mut xs = xs.into_iter();
        for (means, variances) in means.chunks_mut(TOGETHER).zip(variances.chunks_mut(TOGETHER)) {
            for (i, x) in xs.by_ref().take(means.len()).enumerate() {
                for d in 0..D {
                    batch[d * TOGETHER + i] = x[d] / shape.length_scales[d];
                }
            }
            let at = Points { coordinates: &batch, stride: TOGETHER, n: means.len() };
            kernels::predict(&posterior, at, &mut scratch, means, variances);
        }
        (self.batch, self.scratch) = (batch, scratch);
    }
}
