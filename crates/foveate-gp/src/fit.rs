//! The hyper-parameters of the largest posterior density (section 4.4: maximum a posteriori by a quasi-Newton method).

use super::bfgs::{MOST, Objective, Row, minimise};
use super::posterior::shape;
use super::{Gp, Hyper, Priors};

/// A Newton step that gains less ends the fit, in nats; differences of the log posterior below 1 are insignificant.
const TOLERANCE: f64 = 1e-6;
/// Added to the curvature: without data a hyper-parameter has a prior factor of e³.
const RIDGE: f64 = 0.1;

/// How a fit went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// ln p(values | hyper-parameters) + ln p(hyper-parameters) at the hyper-parameters found.
    pub log_posterior: f64,
    /// Line searches made.
    pub iterations: usize,
    /// Factors made.
    pub evaluations: usize,
    /// Whether another step promises less than 1e-6 nats; otherwise the iterations were too few, or rounding ended it.
    pub converged: bool,
}

impl<const D: usize> Gp<D> {
    /// Moves the hyper-parameters uphill from their current values to a mode of the posterior density under `priors`.
    /// The density is with respect to (ℓ, σₘ², σₙ²), the steps are in their logarithms.
    ///
    /// The start is first brought within the priors' bounds; from there the density never becomes less. BFGS begins from the
    /// average information, so that a start near the mode takes two or three steps. Each costs n³/2 operations.
    pub fn fit(&mut self, priors: &Priors<D>, max_iterations: usize) -> Fit {
        const { assert!(D + 2 <= MOST, "at most 14 dimensions") };
        let start = priors.clamp(self.hyper);
        if start != self.hyper {
            self.set_hyper(start);
        }
        let (mut x, mut bounds) = ([0.0; MOST], [(0.0, 0.0); MOST]);
        for i in 0..D + 2 {
            let (lower, upper) = priors.bounds(i);
            bounds[i] = (lower.ln(), upper.ln());
            x[i] = get(&start, i).ln();
        }
        let mut problem = Problem { gp: self, priors };
        let value = problem.density();
        let n = D + 2;
        let outcome = minimise(&mut problem, &mut x[..n], &bounds[..n], value, TOLERANCE, max_iterations);
        if !outcome.at_hand {
            let best = problem.hyper(&x[..n]);
            self.set_hyper(if outcome.iterations > 1 { best } else { start });
        }
        Fit {
            log_posterior: -outcome.value,
            iterations: outcome.iterations,
            evaluations: outcome.evaluations,
            converged: outcome.converged,
        }
    }
}

fn get<const D: usize>(hyper: &Hyper<D>, i: usize) -> f64 {
    match i.checked_sub(D) {
        None => hyper.length_scales[i],
        Some(0) => hyper.signal_variance,
        Some(_) => hyper.noise_variance,
    }
}

struct Problem<'a, const D: usize> {
    gp: &'a mut Gp<D>,
    priors: &'a Priors<D>,
}

impl<const D: usize> Problem<'_, D> {
    /// From logarithms; the priors' bounds hold exactly.
    fn hyper(&self, x: &[f64]) -> Hyper<D> {
        self.priors.clamp(Hyper {
            length_scales: std::array::from_fn(|d| x[d].exp()),
            signal_variance: x[D].exp(),
            noise_variance: x[D + 1].exp(),
        })
    }
    /// −ln posterior at the point at hand.
    fn density(&self) -> f64 {
        -self.gp.factor.log_likelihood() - self.priors.log_density(&self.gp.hyper)
    }
}

impl<const D: usize> Objective for Problem<'_, D> {
    fn value(&mut self, x: &[f64]) -> f64 {
        self.gp.hyper = self.hyper(x);
        let gp = &mut *self.gp;
        gp.factor.refactor(&gp.points, shape(gp.kernel, &gp.hyper));
        gp.factor.whiten(&gp.values);
        self.density()
    }
    fn gradient(&mut self, g: &mut [f64]) {
        let Gp { factor, hyper, .. } = &mut *self.gp;
        factor.weigh();
        factor.gradient(hyper.noise_variance, g);
        g.iter_mut().for_each(|g| *g = -*g);
        for (g, (prior, l)) in g.iter_mut().zip(self.priors.length_scales().iter().zip(hyper.length_scales)) {
            *g -= prior.derivatives(l).0;
        }
    }
    fn curvature(&mut self, b: &mut [Row]) {
        let Gp { factor, hyper, .. } = &mut *self.gp;
        factor.information(D, hyper.noise_variance, |i, j, value| (b[i][j], b[j][i]) = (value, value));
        for (i, row) in b.iter_mut().enumerate() {
            row[i] += RIDGE;
            if let Some(prior) = self.priors.length_scales().get(i) {
                row[i] += (-prior.derivatives(hyper.length_scales[i]).1).max(0.0);
            }
        }
    }
}
