//! Curves through a track, by Levenberg-Marquardt (Marquardt 1963), with the errors of their parameters.
//!
//! Errors of neighbouring frames are correlated: their correlation ρ^(Δt/τ) maximises the restricted likelihood (Patterson and Thompson
//! 1971), which takes the estimated parameters into account. The scale of the reported variances follows from the residuals.

use super::linear::{Inverse, Matrix, invert, times};
use super::models::Curve;
use super::smooth::median;

/// A point of a fit: seconds, coordinate, variance of the coordinate up to a common factor.
pub type Point = (f64, f64, f64);

/// A fitted curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The time at which t of the curve is 0: that of the first point, seconds.
    pub t0: f64,
    /// In the order of [`Curve::parameters`].
    pub values: Vec<f64>,
    /// Their covariance.
    pub covariance: Matrix,
    /// Residuals of the points, data minus curve.
    pub residuals: Vec<f64>,
    /// Degrees of freedom after the correlation of the residuals, at least 2.
    pub freedom: f64,
    /// The correlation of the errors from one frame to the next, 0 to below 1.
    pub correlation: f64,
    /// Of an oscillation: an upper bound of the probability that correlated errors about a constant give a fit as good.
    pub by_chance: Option<f64>,
}

/// From this [`Fitted::by_chance`] on, an oscillation is not distinguished from the errors.
pub(super) const CHANCE: f64 = 0.05;

/// Fits a curve to points in order of time. Fails with a sentence.
///
/// # Errors
/// There are fewer points than parameters plus two, or the points determine no such curve.
pub fn fit(curve: Curve, points: &[Point]) -> Result<Fitted, String> {
    let count = curve.parameters().len();
    if points.len() < count + 2 {
        return Err(format!("the curve needs at least {} points, not {}", count + 2, points.len()));
    }
    let undetermined =
        || format!("the {} points determine no {}; fit another curve or range", points.len(), curve.name());
    let data = Data::new(points);
    let mut start = curve.start(&data.t, &data.y, &data.weights()).ok_or_else(undetermined)?;
    let mut best: Option<Solution> = None;
    let mut peak = f64::NEG_INFINITY;
    for correlation in CORRELATIONS {
        let Some(solution) = data.solve(curve, &start, correlation) else { continue };
        start.clone_from(&solution.values);
        peak = peak.max(solution.peak);
        if best.as_ref().is_none_or(|best| solution.log_likelihood > best.log_likelihood) {
            best = Some(solution);
        }
    }
    let Solution { values, inverse, square, correlation, .. } = best.ok_or_else(undetermined)?;
    let is_oscillation = matches!(curve, Curve::Sine | Curve::Damped);
    let by_chance = is_oscillation.then(|| data.by_chance(count, peak));
    let spare = (points.len() - count) as f64;
    let scale = square / spare;
    let covariance = inverse.matrix.iter().map(|row| row.iter().map(|c| c * scale).collect()).collect();
    let residuals = data.t.iter().zip(&data.y).map(|(t, y)| y - curve.at(&values, *t)).collect();
    let freedom = (spare * (1.0 - correlation) / (1.0 + correlation)).max(2.0);
    Ok(Fitted { t0: points[0].0, values, covariance, residuals, freedom, correlation, by_chance })
}

const CORRELATIONS: [f64; 12] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95];

struct Data {
    t: Vec<f64>,
    y: Vec<f64>,
    sd: Vec<f64>,
    /// Intervals to the point before, in median intervals.
    intervals: Vec<f64>,
}

/// The best parameters for a correlation.
struct Solution {
    values: Vec<f64>,
    /// Of JᵀJ for whitened residuals.
    inverse: Inverse,
    /// The sum of squared whitened residuals.
    square: f64,
    correlation: f64,
    /// The log-likelihood, integrated over the parameters.
    log_likelihood: f64,
    /// See [`Data::peak`].
    peak: f64,
}

impl Data {
    fn new(points: &[Point]) -> Self {
        let t: Vec<f64> = points.iter().map(|point| point.0 - points[0].0).collect();
        let steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let step = median(steps.iter().copied());
        let intervals = std::iter::once(0.0).chain(steps.iter().map(|dt| dt / step)).collect();
        let (y, sd) = points.iter().map(|point| (point.1, point.2.sqrt())).unzip();
        Self { t, y, sd, intervals }
    }

    fn weights(&self) -> Vec<f64> {
        self.sd.iter().map(|sd| 1.0 / (sd * sd)).collect()
    }

    /// Returns the correlation of each error with the one before.
    fn kept(&self, correlation: f64) -> Vec<f64> {
        let kept = |dt: &f64| if *dt > 0.0 && correlation > 0.0 { correlation.powf(*dt) } else { 0.0 };
        self.intervals.iter().map(kept).collect()
    }

    /// Returns residuals that are independent and of equal variance if the errors have these correlations.
    fn whitened(&self, curve: Curve, values: &[f64], kept: &[f64]) -> Vec<f64> {
        let mut last = 0.0;
        let each = |k: usize| {
            let z = (self.y[k] - curve.at(values, self.t[k])) / self.sd[k];
            let white = (z - kept[k] * last) / (1.0 - kept[k] * kept[k]).sqrt();
            last = z;
            white
        };
        (0..self.t.len()).map(each).collect()
    }

    /// Returns the largest log-likelihood over the errors' variance, up to a constant: `square` is the sum of squared whitened residuals,
    /// `log_det` that of [`log_det`].
    fn peak(&self, square: f64, log_det: f64) -> f64 {
        -0.5 * (self.t.len() as f64 * square.max(f64::MIN_POSITIVE).ln() + log_det)
    }

    /// Returns a bound of the probability that errors about a constant give an oscillation with so many parameters this largest
    /// log-likelihood. Each of the two models has its own correlation. At one frequency and decay it is the F test of amplitude and
    /// phase. The search over frequencies, decays and correlations counts as two independent tries for each point.
    fn by_chance(&self, parameters: usize, peak: f64) -> f64 {
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let constant = CORRELATIONS.map(|correlation| {
            let kept = self.kept(correlation);
            let white = |level: f64| self.whitened(Curve::Line, &[level, 0.0], &kept);
            let first = white(self.y[0]);
            let per_level: Vec<f64> = white(self.y[0] - 1.0).iter().zip(&first).map(|(a, b)| a - b).collect();
            let square =
                product(&first, &first) - product(&first, &per_level).powi(2) / product(&per_level, &per_level);
            self.peak(square, log_det(&kept))
        });
        let (n, constant) = (self.t.len() as f64, constant.into_iter().fold(f64::NEG_INFINITY, f64::max));
        (2.0 * n * ((constant - peak) * (1.0 - parameters as f64 / n)).exp()).min(1.0)
    }

    fn solve(&self, curve: Curve, start: &[f64], correlation: f64) -> Option<Solution> {
        let kept = self.kept(correlation);
        let residuals = |values: &[f64]| self.whitened(curve, values, &kept);
        // A time is never 0 and may be a microsecond.
        let floor = |time: bool| if time { 0.0 } else { 1e-7 };
        let floors: Vec<f64> =
            curve.parameters().iter().map(|(_, length, time)| floor((*length, *time) == (0, 1))).collect();
        let (values, square, normal) = levenberg_marquardt(&residuals, start.to_vec(), &floors)?;
        let inverse = invert(&normal)?;
        let spare = (self.t.len() - values.len()) as f64;
        let log_det = log_det(&kept);
        let peak = self.peak(square, log_det);
        let log_likelihood = -0.5 * (spare * square.max(f64::MIN_POSITIVE).ln() + log_det + inverse.log_det);
        Some(Solution { values, inverse, square, correlation, log_likelihood, peak })
    }
}

/// Returns the log determinant of the correlations of errors that keep these shares of the ones before.
fn log_det(kept: &[f64]) -> f64 {
    kept.iter().map(|kept| (1.0 - kept * kept).ln()).sum()
}

/// Minimises the sum of squared residuals. `floors` are the least steps of the differences by each parameter. Returns the parameters, the
/// sum, and JᵀJ there; `None` if the sum is not finite.
fn levenberg_marquardt(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    mut p: Vec<f64>,
    floors: &[f64],
) -> Option<(Vec<f64>, f64, Matrix)> {
    const STEPS: usize = 200;
    let square = |r: &[f64]| r.iter().map(|r| r * r).sum::<f64>();
    let mut r = residuals(&p);
    let (mut least, mut damping) = (square(&r), 1e-3);
    let mut normal = normal_equations(residuals, &p, &r, floors);
    for _ in 0..STEPS {
        let (matrix, gradient) = &normal;
        let mut damped = matrix.clone();
        damped.iter_mut().enumerate().for_each(|(i, row)| row[i] *= 1.0 + damping);
        let step = invert(&damped).map(|inverse| times(&inverse.matrix, gradient));
        let next: Option<Vec<f64>> = step.map(|step| p.iter().zip(step).map(|(p, s)| p - s).collect());
        let tried = next.map(|next| (residuals(&next), next));
        match tried.filter(|(r, _)| square(r) <= least) {
            Some((better, next)) => {
                let gain = least - square(&better);
                (r, p) = (better, next);
                least = square(&r);
                damping = (damping * 0.1).max(1e-12);
                normal = normal_equations(residuals, &p, &r, floors);
                if gain <= 1e-12 * least {
                    break;
                }
            }
            None if damping < 1e12 => damping *= 10.0,
            None => break,
        }
    }
    least.is_finite().then_some((p, least, normal.0))
}

/// Returns JᵀJ and Jᵀr, with J by central differences.
fn normal_equations(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    p: &[f64],
    r: &[f64],
    floors: &[f64],
) -> (Matrix, Vec<f64>) {
    let column = |i: usize| {
        let h = 1e-5 * p[i].abs() + floors[i];
        let shifted = |by: f64| {
            let mut p = p.to_vec();
            p[i] += by;
            residuals(&p)
        };
        let (up, down) = (shifted(h), shifted(-h));
        up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * h)).collect::<Vec<f64>>()
    };
    let columns: Vec<Vec<f64>> = (0..p.len()).map(column).collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let matrix = columns.iter().map(|a| columns.iter().map(|b| product(a, b)).collect()).collect();
    let gradient = columns.iter().map(|a| product(a, r)).collect();
    (matrix, gradient)
}

/// Returns the 97.5 % quantile of Student's t distribution with at least 2 degrees of freedom: the expansion of Abramowitz and Stegun,
/// 26.7.5, within 1 %.
pub fn student(freedom: f64) -> f64 {
    let z: f64 = 1.959_963_984_540_054;
    let n = freedom;
    let terms = [
        (z.powi(3) + z) / 4.0,
        (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0,
        (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0,
        (79.0 * z.powi(9) + 776.0 * z.powi(7) + 1482.0 * z.powi(5) - 1920.0 * z.powi(3) - 945.0 * z) / 92160.0,
    ];
    z + terms.iter().rev().fold(0.0, |sum, term| (sum + term) / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// True parameters of each curve, over 2 s from t = 3 s at 30 frames a second.
    const TRUTH: [(Curve, &[f64]); 6] = [
        (Curve::Line, &[1.0, -2.0]),
        (Curve::Parabola, &[0.5, 3.0, -9.81]),
        (Curve::Sine, &[0.2, 0.4, 1.0, 1.3]),
        (Curve::Damped, &[0.2, 0.4, 1.0, 0.45, 1.5]),
        (Curve::Exponential, &[1.0, 2.0, 0.6]),
        (Curve::Drag, &[2.0, 0.5, -3.0, 0.4]),
    ];

    fn points(curve: Curve, values: &[f64], error: &mut dyn FnMut() -> f64) -> Vec<Point> {
        let at = |k: usize| (3.0 + k as f64 / 30.0, k as f64 / 30.0);
        (0..60).map(at).map(|(time, t)| (time, curve.at(values, t) + error(), 1e-6)).collect()
    }

    #[test]
    fn exact_data_give_exact_parameters() {
        for (curve, truth) in TRUTH {
            let mut exact = points(curve, truth, &mut || 0.0);
            // A gap, and unequal variances.
            exact.drain(20..25);
            exact.iter_mut().step_by(3).for_each(|point| point.2 = 9e-6);
            let fitted = fit(curve, &exact).expect("a fit");
            for (value, truth) in fitted.values.iter().zip(truth) {
                assert!((value - truth).abs() < 1e-6, "{}: {:?}", curve.name(), fitted.values);
            }
            assert!(fitted.t0 == 3.0 && fitted.residuals.iter().all(|r| r.abs() < 1e-6));
        }
        // Growth has a negative time constant.
        let fitted = fit(Curve::Exponential, &points(Curve::Exponential, &[0.0, 1.0, -0.8], &mut || 0.0));
        assert!((fitted.expect("a fit").values[2] + 0.8).abs() < 1e-6);
    }

    /// Of any number of oscillations, down to four points each.
    #[test]
    fn periods_of_many_oscillations_are_found() {
        for cycles in [0.7, 3.3, 12.9, 46.3, 68.7, 149.0] {
            for (curve, truth) in [
                (Curve::Sine, vec![0.2, 0.4, 1.0, 20.0 / cycles]),
                (Curve::Damped, vec![0.2, 0.4, 1.0, 20.0 / cycles, 15.0]),
            ] {
                let track: Vec<Point> =
                    (0..600).map(|k| f64::from(k) / 30.0).map(|t| (t, curve.at(&truth, t), 1e-6)).collect();
                let period = fit(curve, &track).expect("a fit").values[3];
                assert!((period / truth[3] - 1.0).abs() < 1e-6, "{} {cycles}: {period} {}", curve.name(), truth[3]);
            }
        }
    }

    /// A track has the same fit with its times in other units: here 30 frames a second and 3 million.
    #[test]
    fn fits_do_not_depend_on_the_unit_of_time() {
        let truth = [0.2, 0.4, 1.0, 0.0618];
        let fitted = |unit: f64| {
            let mut rng = Streams::new(7, 0).rng(1);
            let mut noise = || 0.01 * rng.sample::<f64, _>(StandardNormal);
            let track =
                (0..600).map(|k| f64::from(k) / 30.0).map(|t| (t * unit, Curve::Sine.at(&truth, t) + noise(), 1e-6));
            let fitted = fit(Curve::Sine, &track.collect::<Vec<_>>()).expect("a fit");
            (fitted.values[3] / unit, fitted.covariance[3][3].sqrt() / unit)
        };
        let ((slow, slow_sd), (fast, fast_sd)) = (fitted(1.0), fitted(1e-5));
        assert!((slow - fast).abs() < 1e-3 * slow_sd && (slow_sd / fast_sd - 1.0).abs() < 1e-3, "{slow} {fast}");
    }

    /// 200 tracks of each curve with independent and with correlated errors, fixed seed. The 95 % intervals of the last parameter hold the
    /// truth in 90 to 99 % of them: with a true share of 0.95 a share outside has a probability of 3e-3.
    #[test]
    fn intervals_hold_the_truth() {
        for correlation in [0.0, 0.6] {
            for (curve, truth) in TRUTH {
                let (mut rng, mut inside) = (Streams::new(5, 0).rng(1), 0);
                for _ in 0..200 {
                    let mut last: f64 = rng.sample(StandardNormal);
                    let mut error = || {
                        let new: f64 = rng.sample(StandardNormal);
                        last = correlation * last + (1.0 - correlation * correlation).sqrt() * new;
                        0.004 * last
                    };
                    let fitted = fit(curve, &points(curve, truth, &mut error)).expect("a fit");
                    let k = truth.len() - 1;
                    let half = student(fitted.freedom) * fitted.covariance[k][k].sqrt();
                    inside += usize::from((fitted.values[k] - truth[k]).abs() < half);
                }
                assert!((180..=198).contains(&inside), "{} {correlation}: {inside} of 200", curve.name());
            }
        }
    }

    /// 100 tracks for each curve and correlation, fixed seed. In errors about a constant an oscillation is found at a level of 5 %: more than
    /// 12 of 100 then have a probability of 2e-3. One whose amplitude is twice the errors' standard deviation is found in half of them at
    /// least.
    #[test]
    fn noise_is_no_oscillation() {
        for (curve, truth) in &TRUTH[2..4] {
            for correlation in [0.0, 0.6, 0.9] {
                let (mut rng, mut found) = (Streams::new(6, 0).rng(1), [0; 2]);
                for _ in 0..100 {
                    let mut last: f64 = rng.sample(StandardNormal);
                    let mut error = || {
                        let new: f64 = rng.sample(StandardNormal);
                        last = correlation * last + (1.0 - correlation * correlation).sqrt() * new;
                        0.2 * last
                    };
                    let noise = points(Curve::Line, &[1.0, 0.0], &mut error);
                    let signal = points(*curve, truth, &mut error);
                    for (found, points) in found.iter_mut().zip([noise, signal]) {
                        let chance = fit(*curve, &points).ok().and_then(|fitted| fitted.by_chance);
                        *found += usize::from(chance.is_some_and(|chance| chance < CHANCE));
                    }
                }
                assert!(found[0] <= 12 && found[1] >= 50, "{} {correlation}: {found:?}", curve.name());
            }
        }
    }

    /// The covariance of a line with independent errors has a closed form.
    #[test]
    fn the_covariance_of_a_line() {
        let error = |k: usize| if k.is_multiple_of(2) { 0.01 } else { -0.01 };
        let points: Vec<Point> = (0..40).map(|k| (k as f64, 2.0 * k as f64 + error(k), 4.0)).collect();
        let fitted = fit(Curve::Line, &points).expect("a fit");
        assert_eq!(fitted.correlation, 0.0);
        let variance = fitted.residuals.iter().map(|r| r * r).sum::<f64>() / 38.0;
        let spread: f64 = (0..40).map(|k| (k as f64 - 19.5).powi(2)).sum();
        let exact = variance / spread;
        assert!((fitted.covariance[1][1] / exact - 1.0).abs() < 1e-6, "{} {exact}", fitted.covariance[1][1]);
    }

    #[test]
    fn too_few_points_are_refused() {
        let few = points(Curve::Sine, &[0.0, 1.0, 0.0, 1.0], &mut || 0.0)[..5].to_vec();
        assert!(fit(Curve::Sine, &few).expect_err("few").contains("at least 6"));
    }

    #[test]
    fn quantiles_of_student() {
        for (freedom, exact) in [(2.0, 4.303), (3.0, 3.182), (5.0, 2.571), (10.0, 2.228), (30.0, 2.042), (1e6, 1.960)] {
            assert!((student(freedom) / exact - 1.0).abs() < 0.02, "{freedom}: {}", student(freedom));
        }
    }
}
