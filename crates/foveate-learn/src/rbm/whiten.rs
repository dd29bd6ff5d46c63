//! PCA whitening: rows become uncorrelated numbers of variance 1; directions of small variance are dropped.
//!
//! x = (v − m) U Λ^(−½), with the leading eigenvectors U and eigenvalues Λ of the rows' covariance. A machine that learns
//! covariances must not spend its units on those of second order that a linear map can take away.

use super::number::is_usable;
use super::product::rows_times;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use rayon::prelude::*;

/// Rows whose products one task sums: fixed, so that any number of threads gives the same bits.
const CHUNK: usize = 4096;
/// Directions with less variance than this share of the largest are rounding errors and are always dropped.
const ROUNDING: f64 = 1e-6;

/// A fitted whitening: from `n_v` numbers to `n_x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Whitening {
    mean: Vec<f32>,
    /// U Λ^(−½), n_v × n_x.
    matrix: Vec<f32>,
}

impl Whitening {
    /// From its mean (n_v) and matrix U Λ^(−½) (n_v × n_x, row-major).
    ///
    /// Fails if they do not fit, a number is not finite, or a column is 0.
    pub fn new(mean: Vec<f32>, matrix: Vec<f32>) -> Result<Self> {
        let n_v = mean.len();
        if n_v == 0 || matrix.is_empty() || !matrix.len().is_multiple_of(n_v) || matrix.len() / n_v > n_v {
            return Err(Error::Invalid(format!(
                "a whitening of {n_v} values needs a matrix of {n_v} rows and at most as many columns, got {} numbers",
                matrix.len()
            )));
        }
        if !mean.iter().chain(&matrix).all(|x| is_usable(*x)) {
            return Err(Error::Invalid("a whitening needs finite numbers up to 1e8".into()));
        }
        let whitening = Self { mean, matrix };
        match whitening.precisions().into_iter().position(|p| p == 0.0) {
            Some(j) => Err(Error::Invalid(format!("column {j} of the whitening is 0"))),
            None => Ok(whitening),
        }
    }
    /// Leaves numbers as they are.
    pub fn identity(n: usize) -> Self {
        Self { mean: vec![0.0; n], matrix: (0..n * n).map(|e| f32::from(u8::from(e / n == e % n))).collect() }
    }
    /// Fits to rows, keeping the fewest directions that hold `keep` (above 0, at most 1) of their variance.
    ///
    /// Fails if `keep` is out of range, a value is not finite, or the rows do not vary.
    pub fn fit(rows: Rows<'_>, keep: f64) -> Result<Self> {
        if !(keep > 0.0 && keep <= 1.0) {
            return Err(Error::Config(format!("the share of variance to keep is above 0 and at most 1; it is {keep}")));
        }
        if !rows.data().iter().all(|x| x.is_finite()) {
            return Err(Error::Invalid("whitening needs finite rows".into()));
        }
        let n = rows.width();
        let (mean, covariance) = moments(rows);
        let eigen = eigenvectors(covariance, n)
            .ok_or_else(|| Error::Invalid("no eigenvectors of the covariance of the rows were found".into()))?;
        // λ of each, in ascending order.
        let values: Vec<f64> = eigen.iter().map(|(value, _)| *value).collect();
        let total: f64 = values.iter().sum();
        let least = ROUNDING * values.last().copied().unwrap_or(0.0);
        let (mut kept, mut held) = (vec![], 0.0);
        for j in (0..n).rev() {
            if values[j] <= least || held >= keep * total {
                break;
            }
            kept.push(j);
            held += values[j];
        }
        if kept.is_empty() {
            return Err(Error::Invalid("rows that are all equal cannot be whitened".into()));
        }
        let mut matrix = vec![0.0; n * kept.len()];
        for (to, &j) in kept.iter().enumerate() {
            let column = &eigen[j].1;
            // An eigenvector's sign means nothing: its largest entry is made positive.
            let largest = column.iter().copied().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let gain = largest.signum() / values[j].sqrt();
            (0..n).for_each(|i| matrix[i * kept.len() + to] = (gain * column[i]) as f32);
        }
        Self::new(mean.into_iter().map(|m| m as f32).collect(), matrix)
    }
    /// (n_v, n_x).
    pub fn shape(&self) -> (usize, usize) {
        (self.mean.len(), self.matrix.len() / self.mean.len())
    }
    /// m, length n_v.
    pub fn mean(&self) -> &[f32] {
        &self.mean
    }
    /// U Λ^(−½), n_v × n_x.
    pub fn matrix(&self) -> Rows<'_> {
        Rows::new(&self.matrix, self.shape().1)
    }
    /// Whitens rows (k × n_v) into `x` (k × n_x); `centred` is scratch of the rows' size. A row's result depends on that row
    /// alone, bit for bit.
    pub fn whiten(&self, rows: Rows<'_>, centred: &mut [f32], x: &mut [f32]) {
        let n_v = self.mean.len();
        for (to, row) in centred.chunks_exact_mut(n_v).zip(rows.iter()) {
            to.iter_mut().zip(row).zip(&self.mean).for_each(|((to, v), m)| *to = v - m);
        }
        rows_times(Rows::new(centred, n_v), &self.matrix, x);
    }
    /// What whitened directions (n_x × k, columns) look like in the rows' own space, as n_v × k: the inverse map U Λ^(½).
    pub fn unwhiten(&self, columns: Rows<'_>) -> Vec<f32> {
        let (n_v, n_x) = self.shape();
        assert_eq!(columns.len(), n_x, "one row for each whitened direction");
        // The columns of U Λ^(−½) are orthogonal with squared lengths 1/λ.
        let precisions = self.precisions();
        let inverse: Vec<f32> =
            (0..n_v * n_x).map(|e| (f64::from(self.matrix[e]) / precisions[e % n_x]) as f32).collect();
        let mut out = vec![0.0; n_v * columns.width()];
        rows_times(Rows::new(&inverse, n_x), columns.data(), &mut out);
        out
    }
    /// 1/λ: squared lengths of the columns.
    fn precisions(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.shape().1];
        for row in self.matrix().iter() {
            sums.iter_mut().zip(row).for_each(|(s, &x)| *s += f64::from(x) * f64::from(x));
        }
        sums
    }
}

/// Mean (n) and covariance (n × n) of rows.
fn moments(rows: Rows<'_>) -> (Vec<f64>, Vec<f64>) {
    let (n, count) = (rows.width(), rows.len().max(1) as f64);
    let sum = |of: &(dyn Fn(&[f32], &mut [f64]) + Sync), size: usize| -> Vec<f64> {
        let parts: Vec<Vec<f64>> = (rows.data().par_chunks(CHUNK * n))
            .map(|part| {
                let mut sums = vec![0.0; size];
                part.chunks_exact(n).for_each(|row| of(row, &mut sums));
                sums
            })
            .collect();
        let mut total = vec![0.0; size];
        parts.iter().for_each(|part| total.iter_mut().zip(part).for_each(|(t, p)| *t += p / count));
        total
    };
    let mean = sum(&|row, sums| sums.iter_mut().zip(row).for_each(|(s, &x)| *s += f64::from(x)), n);
    let outer = |row: &[f32], sums: &mut [f64]| {
        for (i, sums) in sums.chunks_exact_mut(n).enumerate() {
            let x = f64::from(row[i]) - mean[i];
            sums[..=i].iter_mut().zip(row).zip(&mean).for_each(|((s, &y), m)| *s += x * (f64::from(y) - m));
        }
    };
    let mut covariance = sum(&outer, n * n);
    for i in 0..n {
        (0..i).for_each(|j| covariance[j * n + i] = covariance[i * n + j]);
    }
    (mean, covariance)
}

/// Eigenvalues, ascending, with eigenvectors of a symmetric matrix (n × n) without negative eigenvalues; none if they are not
/// found.
///
/// The method of Hestenes (1958): rotations of pairs of rows make all rows orthogonal. They are then λ uᵀ, so that a row's length
/// is its eigenvalue.
fn eigenvectors(mut matrix: Vec<f64>, n: usize) -> Option<Vec<(f64, Vec<f64>)>> {
    /// The cosine of two rows that count as orthogonal.
    const ORTHOGONAL: f64 = 1e-12;
    const SWEEPS: usize = 60;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for _ in 0..SWEEPS {
        let mut turned = false;
        for second in 1..n {
            let (before, row) = matrix.split_at_mut(second * n);
            let b = &mut row[..n];
            for a in before.chunks_exact_mut(n) {
                let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
                if ab.abs() <= ORTHOGONAL * aa.sqrt() * bb.sqrt() {
                    continue;
                }
                turned = true;
                let ratio = (bb - aa) / (2.0 * ab);
                let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
                let cosine = tangent.hypot(1.0).recip();
                let sine = cosine * tangent;
                for (a, b) in a.iter_mut().zip(&mut *b) {
                    (*a, *b) = (cosine * *a - sine * *b, sine * *a + cosine * *b);
                }
            }
        }
        if !turned {
            let unit = |row: &[f64]| {
                let value = dot(row, row).sqrt();
                (value, row.iter().map(|x| x / value.max(f64::MIN_POSITIVE)).collect())
            };
            let mut eigen: Vec<(f64, Vec<f64>)> = matrix.chunks_exact(n).map(unit).collect();
            eigen.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            return Some(eigen);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand_distr::{Distribution, StandardNormal};

    /// Correlated rows of 5 numbers, one of them the sum of two others.
    fn rows(n: usize) -> Vec<f32> {
        let mut rng = Streams::new(3, 0).rng(0);
        let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
        (0..n)
            .flat_map(|_| {
                let (a, b, c) = (normal(), normal(), normal());
                [5.0 + 3.0 * a, a + b, 0.1 * c - 1.0, 2.0 * b, 5.0 + 4.0 * a + b]
            })
            .collect()
    }

    #[test]
    fn whitened_rows_are_white_whatever_the_threads() {
        let data = rows(10_000);
        let all = Rows::new(&data, 5);
        let fit = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| Whitening::fit(all, 1.0).expect("rows that vary"))
        };
        let whitening = fit(1);
        assert_eq!(whitening, fit(3));
        // The fifth direction is a sum of others and has no variance.
        assert_eq!(whitening.shape(), (5, 3));
        let (mut centred, mut x) = (vec![0.0; data.len()], vec![0.0; 10_000 * 3]);
        whitening.whiten(all, &mut centred, &mut x);
        let (mean, covariance) = moments(Rows::new(&x, 3));
        for i in 0..3 {
            assert!(mean[i].abs() < 1e-4, "{mean:?}");
            for j in 0..=i {
                let expected = f64::from(u8::from(i == j));
                assert!((covariance[3 * i + j] - expected).abs() < 1e-3, "{covariance:?}");
            }
        }
        // A direction put in is a direction that comes out: whitening of the inverse's columns is the identity.
        let back = whitening.unwhiten(Rows::new(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 3));
        for j in 0..3 {
            let v: Vec<f32> = (0..5).map(|i| back[3 * i + j] + whitening.mean()[i]).collect();
            let (mut c, mut x) = ([0.0; 5], [0.0; 3]);
            whitening.whiten(Rows::new(&v, 5), &mut c, &mut x);
            assert!((0..3).all(|k| (x[k] - f32::from(u8::from(k == j))).abs() < 1e-4), "{x:?}");
        }
    }

    /// A u = λ u for the eigenvectors that whitening keeps, of a matrix of known eigenvalues, some of them equal.
    #[test]
    fn eigenvectors_are_those_of_the_matrix() {
        let n = 40;
        // Orthonormal rows: cosines of the discrete cosine transform.
        let direction = |l: usize, i: usize| {
            let angle = std::f64::consts::PI * (i as f64 + 0.5) * l as f64 / n as f64;
            angle.cos() * (if l == 0 { 1.0 } else { 2.0 } / n as f64).sqrt()
        };
        let value = |l: usize| match l {
            0..4 => 5.0,
            4..30 => 3.0 / (l * l) as f64,
            30..36 => 2e-5,
            _ => 0.0,
        };
        let matrix: Vec<f64> =
            (0..n * n).map(|e| (0..n).map(|l| value(l) * direction(l, e / n) * direction(l, e % n)).sum()).collect();
        let eigen = eigenvectors(matrix.clone(), n).expect("eigenvectors");
        let mut expected: Vec<f64> = (0..n).map(value).collect();
        expected.sort_by(f64::total_cmp);
        for ((lambda, u), expected) in eigen.iter().zip(expected) {
            assert!((lambda - expected).abs() < 1e-12, "{lambda}, not {expected}");
            if expected == 0.0 {
                continue;
            }
            for (i, row) in matrix.chunks_exact(n).enumerate() {
                let au: f64 = row.iter().zip(u).map(|(a, u)| a * u).sum();
                assert!((au - lambda * u[i]).abs() < 1e-7 * lambda, "λ = {lambda}");
            }
        }
    }

    #[test]
    fn little_variance_is_left_out_and_bad_rows_are_refused() {
        let data = rows(2000);
        assert_eq!(Whitening::fit(Rows::new(&data, 5), 0.9).expect("good rows").shape(), (5, 2));
        assert_eq!(Whitening::fit(Rows::new(&data, 5), 1e-9).expect("good rows").shape(), (5, 1));
        for keep in [0.0, 1.1, f64::NAN] {
            assert!(Whitening::fit(Rows::new(&data, 5), keep).is_err(), "{keep}");
        }
        assert!(Whitening::fit(Rows::new(&[1.0; 10], 5), 0.9).expect_err("no variance").to_string().contains("equal"));
        assert!(Whitening::fit(Rows::new(&[1.0, f32::NAN], 1), 0.9).is_err());
        assert!(Whitening::new(vec![0.0; 2], vec![1.0, 0.0, 2.0, 0.0]).is_err(), "a column of zeros");
        assert!(Whitening::new(vec![0.0; 2], vec![1.0; 3]).is_err());
        assert!(Whitening::new(vec![0.0; 2], vec![f32::NAN; 2]).is_err());
    }
}
