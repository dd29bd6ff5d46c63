//! Covariances of a Gaussian process, and their sums in the posterior and in the gradient of the likelihood.
//!
//! Points are held by coordinate, divided by the length scales: coordinate d of point i at `[d * stride + i]`, `stride` a
//! multiple of [`SQUARE`], zeros after the last point. With s the squared distance of two of them,
//!
//! | | covariance k | slope c, with ∂k / ∂ ln ℓ_d = c (x_d − x'_d)² |
//! | --- | --- | --- |
//! | squared exponential | σ² e^(−s/2) | k |
//! | Matérn 5/2, a = √(5s) | σ² (1 + a + a²/3) e^(−a) | σ² 5/3 (1 + a) e^(−a) |

use crate::exponential::exp;
#[cfg(target_arch = "x86_64")]
use crate::level::{AVX512, FUSED};
use crate::level::{fused, levels};
use crate::triangle::{SQUARE, corner, finish, load, solve_body, store, subtract};
use crate::vector::Vector;

/// Numbers side by side.
const LANES: usize = 8;

/// Points of a Gaussian process by coordinate, divided by the length scales.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Coordinate d of point i at `[d * stride + i]`.
    pub coordinates: &'a [f64],
    /// A multiple of [`SQUARE`].
    pub stride: usize,
    /// How many points there are.
    pub n: usize,
}

impl Points<'_> {
    #[inline(always)]
    fn check(&self) {
        let whole = self.stride.is_multiple_of(SQUARE) && self.n <= self.stride;
        assert!(whole && self.coordinates.len().is_multiple_of(self.stride.max(1)), "points in whole rows");
    }
}

/// What two points have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Covariance {
    /// Infinitely smooth.
    SquaredExponential,
    /// Twice differentiable.
    Matern52,
}

/// Covariances of point `i` of `a` with points `from..` of `b`, and their slopes.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn row(kind: Covariance, variance: f64, a: Points, i: usize, b: Points, from: usize, k: &mut [f64], c: &mut [f64]) {
    let width = k.len();
    c[..width].fill(0.0);
    for (a, b) in a.coordinates.chunks_exact(a.stride).zip(b.coordinates.chunks_exact(b.stride)) {
        let at = a[i];
        for (s, b) in c[..width].as_chunks_mut::<LANES>().0.iter_mut().zip(b[from..].as_chunks::<LANES>().0) {
            for l in 0..LANES {
                s[l] += (b[l] - at) * (b[l] - at);
            }
        }
    }
    let (k, c) = (k.as_chunks_mut::<LANES>().0, c[..width].as_chunks_mut::<LANES>().0);
    match kind {
        Covariance::SquaredExponential => {
            for (k, c) in k.iter_mut().zip(c) {
                for l in 0..LANES {
                    let e = variance * exp(-0.5 * c[l]);
                    (k[l], c[l]) = (e, e);
                }
            }
        }
        Covariance::Matern52 => {
            for (k, c) in k.iter_mut().zip(c) {
                for l in 0..LANES {
                    let a = (5.0 * c[l]).sqrt();
                    let e = variance * exp(-a);
                    // e is 0 where a is too large to square.
                    (k[l], c[l]) = (e * (1.0 + a) + e * a * (a * (1.0 / 3.0)), 5.0 / 3.0 * e * (1.0 + a));
                }
            }
        }
    }
}

#[inline(always)]
fn matrix_body<const V: u8>(kind: Covariance, variance: f64, points: Points, k: &mut [f64], c: &mut [f64]) {
    points.check();
    let Points { stride, n, .. } = points;
    let end = n.next_multiple_of(SQUARE);
    assert!(k.len() == stride * stride && c.len() == k.len(), "square");
    for i in 0..n {
        let from = i - i % SQUARE;
        let part = i * stride + from..i * stride + end;
        row(kind, variance, points, i, points, from, &mut k[part.clone()], &mut c[part]);
    }
}

#[inline(always)]
fn column_body<const V: u8>(
    kind: Covariance,
    variance: f64,
    points: Points,
    point: Points,
    k: &mut [f64],
    c: &mut [f64],
) {
    points.check();
    row(kind, variance, point, 0, points, 0, k, c);
}

/// Σ of 2 registers' numbers.
#[inline(always)]
fn total<T: Vector>(lanes: [T; 2]) -> f64 {
    let mut all = [0.0; SQUARE];
    lanes[0].store(&mut all);
    lanes[1].store(&mut all[T::N..]);
    all[..2 * T::N].iter().sum()
}

#[inline(always)]
fn gradient_tiles<T: Vector, const R: usize>(points: Points, c: &[f64], w: &[f64], alpha: &[f64], out: &mut [f64]) {
    let Points { coordinates, stride, n } = points;
    out.fill(0.0);
    let unit = T::splat(1.0);
    for top in (0..n).step_by(R) {
        for left in (top - top % (2 * T::N)..n).step_by(2 * T::N) {
            let mut m = [[T::splat(0.0); 2]; R];
            let across = [T::load(&alpha[left..]), T::load(&alpha[left + T::N..])];
            for r in 0..R {
                let down = T::splat(alpha[top + r]);
                m[r] = [across[0].times(down), across[1].times(down)];
            }
            let first = left.max(top);
            let (p, q) = (&w[first * stride + top..], &w[first * stride + left..]);
            m = subtract(m, p, q, (stride, stride), n - first);
            let slope = load::<T, R, 2>(c, stride, top, left);
            if left < top + R {
                // On the diagonal: only the part above it counts.
                for r in 0..R {
                    let (mut numbers, mut mask) = ([0.0; SQUARE], [0.0; SQUARE]);
                    m[r][0].store(&mut numbers);
                    m[r][1].store(&mut numbers[T::N..]);
                    out[0] += if top + r < n { numbers[top + r - left] } else { 0.0 };
                    mask[(top + r + 1 - left).min(SQUARE)..].fill(1.0);
                    m[r] = [m[r][0].times(T::load(&mask)), m[r][1].times(T::load(&mask[T::N..]))];
                }
            }
            for r in 0..R {
                m[r] = [m[r][0].times(slope[r][0]), m[r][1].times(slope[r][1])];
            }
            for (x, out) in coordinates.chunks_exact(stride).zip(&mut out[1..]) {
                let across = [T::load(&x[left..]), T::load(&x[left + T::N..])];
                let mut lanes = [T::splat(0.0); 2];
                for r in 0..R {
                    let down = T::splat(x[top + r]);
                    for side in 0..2 {
                        let apart = across[side].minus(unit, down);
                        lanes[side] = lanes[side].plus(m[r][side].times(apart), apart);
                    }
                }
                *out += total(lanes);
            }
        }
    }
}

#[inline(always)]
fn gradient_body<const V: u8>(points: Points, c: &[f64], w: &[f64], alpha: &[f64], out: &mut [f64]) {
    points.check();
    let square = points.stride * points.stride;
    assert!(c.len() == square && w.len() == square && alpha.len() == points.stride, "squares and a row");
    assert_eq!(out.len(), 1 + points.coordinates.len() / points.stride, "the trace, and one for each coordinate");
    match V {
        #[cfg(target_arch = "x86_64")]
        AVX512 => gradient_tiles::<std::arch::x86_64::__m512d, 8>(points, c, w, alpha, out),
        #[cfg(target_arch = "x86_64")]
        FUSED => gradient_tiles::<std::arch::x86_64::__m256d, 4>(points, c, w, alpha, out),
        _ => gradient_tiles::<[f64; 2], 4>(points, c, w, alpha, out),
    }
}

#[inline(always)]
fn slopes_body<const V: u8>(points: Points, c: &[f64], alpha: &[f64], out: &mut [f64]) {
    points.check();
    let Points { coordinates, stride, n } = points;
    assert!(c.len() == stride * stride && alpha.len() == stride && out.len() == coordinates.len(), "rows");
    out.fill(0.0);
    for (x, out) in coordinates.chunks_exact(stride).zip(out.chunks_exact_mut(stride)) {
        for i in 0..n {
            let (from, end) = (i - i % LANES, n.next_multiple_of(LANES));
            let (at, from_here) = (x[i], alpha[i]);
            let mut lanes = [0.0; LANES];
            let c = c[i * stride..][from..end].as_chunks::<LANES>().0;
            let (x, alpha) = (x[from..end].as_chunks::<LANES>().0, alpha[from..end].as_chunks::<LANES>().0);
            for (b, out) in out[from..end].as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                // Before the diagonal lies the matrix's other half, which counts elsewhere; on it is no distance.
                let first = if b == 0 { i - from } else { 0 };
                for l in 0..LANES {
                    let apart = if l < first { 0.0 } else { x[b][l] - at };
                    let t = c[b][l] * apart * apart;
                    lanes[l] += t * alpha[b][l];
                    out[l] += t * from_here;
                }
            }
            out[i] += lanes.iter().sum::<f64>();
        }
        out[n..].fill(0.0);
    }
}

/// The parts of a posterior beside the points.
#[derive(Clone, Copy, Debug)]
pub struct Posterior<'a> {
    /// The covariance's shape.
    pub kind: Covariance,
    /// Its value at distance 0.
    pub variance: f64,
    /// The points observed.
    pub points: Points<'a>,
    /// The factor U, `stride` × `stride`, and 1 / its diagonal.
    pub u: &'a [f64],
    /// See `u`.
    pub reciprocal: &'a [f64],
    /// (K + noise)⁻¹ y, one for each point.
    pub alpha: &'a [f64],
}

/// Mean and variance at points `left..left + C * T::N` of `at`.
#[inline(always)]
fn predict_tile<T: Vector, const R: usize, const C: usize>(
    posterior: &Posterior,
    at: Points,
    left: usize,
    scratch: &mut [f64],
    out: (&mut [f64], &mut [f64]),
) {
    let Posterior { kind, variance, points, u, reciprocal, alpha } = *posterior;
    let (stride, n, width) = (points.stride, points.n, C * T::N);
    let mut slope = [0.0; SQUARE];
    if width >= LANES {
        for (k, part) in scratch.chunks_exact_mut(width).take(n).enumerate() {
            row(kind, variance, points, k, at, left, part, &mut slope);
        }
    } else {
        // Few points: the row is along the observations.
        for c in 0..width {
            for k in (0..n).step_by(LANES) {
                let mut part = [0.0; LANES];
                row(kind, variance, at, left + c, points, k, &mut part, &mut slope);
                for (l, part) in part.iter().enumerate().take(n - k) {
                    scratch[(k + l) * width + c] = *part;
                }
            }
        }
    }
    let (mut mean, mut explained) = ([T::splat(0.0); C], [T::splat(0.0); C]);
    for (k, part) in scratch.chunks_exact(width).take(n).enumerate() {
        let alpha = T::splat(alpha[k]);
        for side in 0..C {
            mean[side] = mean[side].plus(alpha, T::load(&part[side * T::N..]));
        }
    }
    // Whitened in place.
    for top in (0..n).step_by(R) {
        let here = R.min(n - top);
        let (taken, inverse) = corner::<R>(u, stride, reciprocal, top, here);
        let acc = load::<T, R, C>(scratch, width, top, 0);
        let acc = subtract::<T, R, C>(acc, &u[top..], scratch, (stride, width), top);
        let v = finish(acc, &taken, &inverse);
        store(&v, scratch, width, top, here, 0);
        for v in v.iter().take(here) {
            for side in 0..C {
                explained[side] = explained[side].plus(v[side], v[side]);
            }
        }
    }
    let (means, variances) = out;
    let (mut m, mut e) = ([0.0; SQUARE], [0.0; SQUARE]);
    for side in 0..C {
        mean[side].store(&mut m[side * T::N..]);
        explained[side].store(&mut e[side * T::N..]);
    }
    for (i, (mean, v)) in means.iter_mut().zip(variances).enumerate().take(width) {
        (*mean, *v) = (m[i], (variance - e[i]).max(0.0));
    }
}

/// [`predict_tile`] at point `i` alone: the same sums, along the observations. `k`: a number for each, in whole tiles.
#[inline(always)]
fn predict_one<const V: u8>(posterior: &Posterior, at: Points, i: usize, k: &mut [f64]) -> (f64, f64) {
    let Posterior { kind, variance, points, u, reciprocal, alpha } = *posterior;
    let n = points.n;
    let mut slope = [0.0; SQUARE];
    for (tile, k) in k.chunks_exact_mut(SQUARE).enumerate().take(n.div_ceil(SQUARE)) {
        row(kind, variance, at, i, points, tile * SQUARE, k, &mut slope);
    }
    let k = &mut k[..n];
    let (mut mean, mut explained) = (0.0, 0.0);
    for (k, alpha) in k.iter().zip(alpha) {
        mean = fused::<V>(*alpha, *k, mean);
    }
    solve_body::<V>(u, points.stride, reciprocal, k);
    for v in k {
        explained = fused::<V>(*v, *v, explained);
    }
    (mean, (variance - explained).max(0.0))
}

#[inline(always)]
fn predict_tiles<T: Vector, const V: u8, const R: usize>(
    posterior: &Posterior,
    at: Points,
    scratch: &mut [f64],
    means: &mut [f64],
    variances: &mut [f64],
) {
    let mut left = 0;
    while left < at.n {
        match at.n - left {
            1 | 2 => {
                (means[left], variances[left]) = predict_one::<V>(posterior, at, left, scratch);
                left += 1;
            }
            few if few <= T::N && T::N >= LANES => {
                predict_tile::<T, R, 1>(posterior, at, left, scratch, (&mut means[left..], &mut variances[left..]));
                left += T::N;
            }
            _ => {
                predict_tile::<T, R, 2>(posterior, at, left, scratch, (&mut means[left..], &mut variances[left..]));
                left += 2 * T::N;
            }
        }
    }
}

#[inline(always)]
fn predict_body<const V: u8>(
    posterior: &Posterior,
    at: Points,
    scratch: &mut [f64],
    means: &mut [f64],
    variances: &mut [f64],
) {
    at.check();
    let Points { stride, n, .. } = posterior.points;
    posterior.points.check();
    assert!(posterior.u.len() == stride * stride && posterior.alpha.len() >= n, "a square and a row");
    let rows = if at.n > 2 { SQUARE } else { 1 };
    assert!(scratch.len() >= rows * n.next_multiple_of(SQUARE), "room for the covariances");
    assert!(means.len() == at.n && variances.len() == at.n, "one mean and one variance a point");
    match V {
        #[cfg(target_arch = "x86_64")]
        AVX512 => predict_tiles::<std::arch::x86_64::__m512d, V, 8>(posterior, at, scratch, means, variances),
        #[cfg(target_arch = "x86_64")]
        FUSED => predict_tiles::<std::arch::x86_64::__m256d, V, 4>(posterior, at, scratch, means, variances),
        _ => predict_tiles::<[f64; 2], V, 4>(posterior, at, scratch, means, variances),
    }
}

levels! {
    /// Covariances of all pairs of points and their slopes, `stride` × `stride`: the upper triangle, and with it whole
    /// tiles of [`SQUARE`] columns.
    pub fn covariances / covariances_at (
        kind: Covariance, variance: f64, points: Points, k: &mut [f64], c: &mut [f64],
    ) = matrix_body
}

levels! {
    /// Covariances of the first of `point` with the first `k.len()` of `points` (a multiple of 8), and their slopes.
    pub fn covariances_with / covariances_with_at (
        kind: Covariance, variance: f64, points: Points, point: Points, k: &mut [f64], c: &mut [f64],
    ) = column_body
}

levels! {
    /// With M = α αᵀ − WᵀW: the trace of M, then for each coordinate Σ_{i<j} M_ij c_ij (x_i − x_j)².
    ///
    /// `alpha` has a zero for every point that is not there, as W has.
    pub fn likelihood_gradient / likelihood_gradient_at (
        points: Points, c: &[f64], w: &[f64], alpha: &[f64], out: &mut [f64],
    ) = gradient_body
}

levels! {
    /// For each coordinate, Σ_j c_ij (x_i − x_j)² α_j at `[d * stride + i]`.
    pub fn slopes_times / slopes_times_at (points: Points, c: &[f64], alpha: &[f64], out: &mut [f64]) = slopes_body
}

levels! {
    /// Posterior means and variances (not below 0) at the points `at`; a point's bits do not depend on its neighbours.
    /// `scratch`: [`SQUARE`] numbers for each observation, in whole tiles; for a single `at` one number for each.
    pub fn predict / predict_at (
        posterior: &Posterior, at: Points, scratch: &mut [f64], means: &mut [f64], variances: &mut [f64],
    ) = predict_body
}
