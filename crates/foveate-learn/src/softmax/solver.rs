//! L-BFGS (Nocedal 1980).

use foveate_base::Result;
use std::collections::VecDeque;

/// A function's value, and its gradient into the second slice.
type Objective<'a> = &'a mut dyn FnMut(&[f64], &mut [f64]) -> Result<f64>;

/// Values that differ by this much, relative to themselves, are equal but for rounding.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Minimises with ten pairs, and a search along each direction that halves or doubles the step until the weak Wolfe conditions hold
/// (Lewis & Overton 2013). Returns the steps it took, and whether it converged: no part of the gradient is above `tolerance`, or
/// rounding prevents any step down.
///
/// Fails if the objective fails.
pub(super) fn minimize(objective: Objective<'_>, x: &mut [f64], steps: usize, tolerance: f64) -> Result<(usize, bool)> {
    const PAIRS: usize = 10;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let (mut gradient, mut next, mut tried) = (vec![0.0; x.len()], x.to_vec(), vec![0.0; x.len()]);
    let mut value = objective(x, &mut gradient)?;
    let mut pairs: VecDeque<(Vec<f64>, Vec<f64>, f64)> = VecDeque::new();
    for step in 0..steps {
        if largest(&gradient) <= tolerance {
            return Ok((step, true));
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
        // The step along it. Near the minimum values differ by rounding alone: the slope decides there.
        let (slope, rounding) = (dot(&d, &gradient), ROUNDING * value.abs());
        let (mut low, mut high, mut t) = (0.0, f64::INFINITY, 1.0);
        let (mut found, mut is_last) = (None, false);
        for _ in 0..30 {
            next.iter_mut().zip(&*x).zip(&d).for_each(|((n, x), d)| *n = x + t * d);
            let there = objective(&next, &mut tried)?;
            let new_slope = dot(&d, &tried);
            let falls = there <= value + 1e-4 * t * slope || there <= value + rounding && new_slope <= -0.9 * slope;
            if falls {
                found = Some((t, there));
                is_last = new_slope >= 0.9 * slope;
                if is_last {
                    break;
                }
                low = t;
            } else {
                high = t;
            }
            t = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * t };
        }
        let Some((accepted, there)) = found else { return Ok((step, true)) };
        if !is_last {
            next.iter_mut().zip(&*x).zip(&d).for_each(|((n, x), d)| *n = x + accepted * d);
            objective(&next, &mut tried)?;
        }
        if there >= value && largest(&tried) >= largest(&gradient) {
            return Ok((step, true));
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
    Ok((steps, largest(&gradient) <= tolerance))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solver_finds_the_bottom_of_a_curved_valley() {
        // Rosenbrock's function: the minimum is 0 at (1, 1).
        let mut rosenbrock = |x: &[f64], g: &mut [f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            (g[0], g[1]) = (-2.0 * a - 400.0 * x[0] * b, 200.0 * b);
            Ok(a * a + 100.0 * b * b)
        };
        let mut x = [-1.2, 1.0];
        let (steps, converged) = minimize(&mut rosenbrock, &mut x, 200, 1e-9).expect("it cannot fail");
        assert!(converged);
        assert!((x[0] - 1.0).abs() < 1e-7 && (x[1] - 1.0).abs() < 1e-7 && steps < 60, "{x:?} after {steps} steps");
    }

    /// Where the tolerance is 0, rounding ends it, at the minimum.
    #[test]
    fn it_goes_on_until_rounding_ends_it() {
        let mut bowl = |x: &[f64], g: &mut [f64]| {
            (g[0], g[1]) = (2.0 * (x[0] - 3.0), 200.0 * (x[1] + 1.0));
            Ok(7.0 + (x[0] - 3.0).powi(2) + 100.0 * (x[1] + 1.0).powi(2))
        };
        let mut x = [0.0, 0.0];
        let (steps, converged) = minimize(&mut bowl, &mut x, 10_000, 0.0).expect("it cannot fail");
        assert!(converged && steps < 100 && (x[0] - 3.0).abs() < 1e-7 && (x[1] + 1.0).abs() < 1e-7, "{x:?} in {steps}");
        let mut x = [0.0, 0.0];
        assert_eq!(minimize(&mut bowl, &mut x, 1, 0.0).expect("it cannot fail"), (1, false));
    }
}
