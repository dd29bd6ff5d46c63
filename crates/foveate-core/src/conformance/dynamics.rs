//! The conformance test of dynamics.

use super::{assert_mean, checks};
use crate::control::Dynamics;
use crate::geometry::{Covariance, State};

/// Checks that `sample` and `sample_each` draw from the density that `log_density` evaluates, with the place and velocity of `expected` as
/// mean and the deviation of `spread` in place, and that `over` three frames leads where three single frames lead.
///
/// If p is the density of the draws, any density g within the support of p has a mean of g/p equal to 1. Here g is a narrower normal
/// density at the draws' mean, then shifted to each side; 20,000 draws, 42 checks.
pub fn dynamics(dynamics: &dyn Dynamics, from: &State) {
    const DRAWS: usize = 20_000;
    let one_by_one = |stream| -> Vec<State> {
        let mut rng = checks().rng(stream);
        (0..DRAWS).map(|_| dynamics.sample(from, &mut rng)).collect()
    };
    let together = |stream, n: usize| -> Vec<State> {
        let mut states = vec![State::default(); n];
        dynamics.sample_each(&vec![*from; n], &mut states, &mut checks().rng(stream));
        states
    };
    assert!(together(1, 100)[..] == together(1, DRAWS)[..100], "fewer draws must be the first of more");
    let g = Normal::fit(&one_by_one(1));
    for fresh in [one_by_one(2), together(3, DRAWS)] {
        for (dim, side) in (0..=g.rows.len()).flat_map(|dim| [(dim, -0.5), (dim, 0.5)]) {
            let ratio = |next: &State| {
                let log_p = dynamics.log_density(next, from);
                assert!(log_p.is_finite(), "log_density must be finite where sample leads: {log_p} at {next:?}");
                (g.log_density(next, dim, side) - log_p).exp()
            };
            let ratios: Vec<f64> = fresh.iter().map(ratio).collect();
            assert_mean(&ratios, 1.0, "log_density must be the density of sample's draws; the mean of g/p");
        }
        let expected = dynamics.expected(from);
        let off: Vec<[f64; 4]> = fresh
            .iter()
            .map(|s| [s.x - expected.x, s.y - expected.y, s.vx - expected.vx, s.vy - expected.vy])
            .collect();
        for k in 0..4 {
            let off: Vec<f64> = off.iter().map(|o| o[k]).collect();
            assert_mean(&off, 0.0, "draws must lie about what is expected; their distance from it");
        }
        let squares: Vec<f64> = off.iter().map(|o| 0.5 * (o[0] * o[0] + o[1] * o[1])).collect();
        assert_mean(&squares, dynamics.spread().powi(2), "the mean square of the place's noise");
    }
    if let Some(leap) = dynamics.over(3) {
        let mut rng = checks().rng(4);
        let three = |_| (0..3).fold(*from, |state, _| dynamics.sample(&state, &mut rng));
        let one_by_one: Vec<State> = (0..DRAWS).map(three).collect();
        let mut at_once = vec![*from; DRAWS];
        leap.draw(&mut at_once, &mut checks().rng(5));
        let (mut mean, mut covariance) = (*from, Covariance::default());
        leap.spread(&mut mean, &mut covariance);
        for (drawn, k) in [one_by_one, at_once].iter().flat_map(|drawn| (0..State::N).map(move |k| (drawn, k))) {
            let off: Vec<f64> = drawn.iter().map(|s| s.to_array()[k] - mean.to_array()[k]).collect();
            assert_mean(&off, 0.0, "three frames at once must lead where three frames lead; the distance");
            let squares: Vec<f64> = off.iter().map(|o| o * o).collect();
            assert_mean(&squares, covariance[k][k], "the variance of three frames at once");
        }
    }
}

/// A normal density over the independent components of a state, 0.7 times as wide as the draws.
struct Normal {
    mean: [f64; State::N],
    /// Each free component with its row of the lower Cholesky factor over the free ones up to it.
    rows: Vec<(usize, Vec<f64>)>,
}

impl Normal {
    /// Velocities first, so that places that follow from them are not free.
    const ORDER: [usize; State::N] = [2, 3, 0, 1, 4, 5, 6];

    fn fit(states: &[State]) -> Self {
        let n = states.len() as f64;
        let about = |i: usize, j: usize, mean: &[f64; State::N]| {
            states.iter().map(|s| (s.to_array()[i] - mean[i]) * (s.to_array()[j] - mean[j])).sum::<f64>() / n
        };
        let mean = std::array::from_fn(|i| states.iter().map(|s| s.to_array()[i]).sum::<f64>() / n);
        let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
        for i in Self::ORDER {
            let mut row: Vec<f64> = Vec::new();
            for (j, other) in &rows {
                let inner: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                row.push((0.49 * about(i, *j, &mean) - inner) / other[other.len() - 1]);
            }
            let variance = 0.49 * about(i, i, &mean);
            let pivot = variance - row.iter().map(|r| r * r).sum::<f64>();
            if pivot > 1e-9 * variance && variance > 1e-18 {
                row.push(pivot.sqrt());
                rows.push((i, row));
            }
        }
        Self { mean, rows }
    }
    /// Returns log g, shifted by `shift` deviations along free component `dim` (not at all past the last).
    fn log_density(&self, state: &State, dim: usize, shift: f64) -> f64 {
        let (state, mut z, mut log_g) = (state.to_array(), Vec::new(), 0.0);
        for (k, (i, row)) in self.rows.iter().enumerate() {
            let inner: f64 = row.iter().zip(&z).map(|(a, b)| a * b).sum();
            let sd = row[k];
            z.push((state[*i] - self.mean[*i] - inner) / sd);
            let moved = z[k] - if k == dim { shift } else { 0.0 };
            log_g -= 0.5 * (moved * moved + std::f64::consts::TAU.ln()) + sd.ln();
        }
        log_g
    }
}
