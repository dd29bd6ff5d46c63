//! The particle filter agrees with the Kalman filter where the Kalman filter is exact: a linear-Gaussian target,
//! seen in noise. Means, variances and evidence; any proposal; resampling always or below a threshold.

use foveate::conformance::{self, blank_frame};
use foveate::control::{Autoregressive, Belief, Dynamics, Prior, Proposal, Resampling, Scheme, normalize};
use foveate::geometry::State;
use foveate::rng::{Purpose, Streams};
use foveate::scene::Scene;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::array::from_fn;
use std::sync::Arc;

type Matrix = [[f64; 6]; 6];

/// Mean and covariance after each frame, and the log evidence of all frames.
type Filtered = (Vec<(State, Matrix)>, f64);

const FRAMES: usize = 16;
const PARTICLES: usize = 6000;
/// Filters of one set of observations; their spread says how far their mean may be from the truth.
const RUNS: usize = 16;
const MOTION: Autoregressive = Autoregressive {
    damping: 0.9,
    velocity: 0.6,
    position: 0.4,
    scale_pull: 0.9,
    log_scale: 0.05,
    angle_pull: 0.95,
    angle: 0.04,
    leaps: 0.0,
    leap: 1.0,
};
/// Standard deviation of the first state's components.
const START: [f64; 6] = [2.0, 2.0, 1.0, 1.0, 0.1, 0.1];
/// What is seen of a state (x, y, log scale, angle), and the standard deviation of the noise on it.
const SEEN: [(usize, f64); 4] = [(0, 2.0), (1, 2.5), (4, 0.2), (5, 0.2)];

/// The exact filter.
fn kalman(observations: &[[f64; 4]]) -> Filtered {
    let m = MOTION;
    let (mut f, mut q) = ([[0.0; 6]; 6], [[0.0; 6]; 6]); // x' = F x + noise of covariance Q, in the order of State's fields
    for (x, v) in [(0, 2), (1, 3)] {
        (f[x][x], f[x][v], f[v][v]) = (1.0, m.damping, m.damping);
        let moved = m.velocity.powi(2);
        (q[x][x], q[x][v], q[v][x], q[v][v]) = (moved + m.position.powi(2), moved, moved, moved);
    }
    (f[4][4], q[4][4]) = (m.scale_pull, m.log_scale.powi(2));
    (f[5][5], q[5][5]) = (m.angle_pull, m.angle.powi(2));

    let mut mean = [0.0; 6];
    let mut cov: Matrix = from_fn(|i| from_fn(|j| if i == j { START[i].powi(2) } else { 0.0 }));
    let (mut beliefs, mut log_evidence) = (Vec::new(), 0.0);
    for observation in observations {
        mean = from_fn(|i| (0..6).map(|k| f[i][k] * mean[k]).sum());
        let half: Matrix = from_fn(|i| from_fn(|j| (0..6).map(|k| f[i][k] * cov[k][j]).sum()));
        cov = from_fn(|i| from_fn(|j| (0..6).map(|k| half[i][k] * f[j][k]).sum::<f64>() + q[i][j]));
        // One number at a time: their noises are independent.
        for (&(seen, sd), value) in SEEN.iter().zip(observation) {
            let variance = cov[seen][seen] + sd * sd;
            let surprise = value - mean[seen];
            log_evidence -= 0.5 * (surprise * surprise / variance + (std::f64::consts::TAU * variance).ln());
            let gain: [f64; 6] = from_fn(|i| cov[i][seen] / variance);
            let row = cov[seen];
            for i in 0..6 {
                mean[i] += gain[i] * surprise;
                for j in 0..6 {
                    cov[i][j] -= gain[i] * row[j];
                }
            }
        }
        beliefs.push((State::from_array(mean), cov));
    }
    (beliefs, log_evidence)
}

fn first_state(streams: Streams, i: u64) -> State {
    let mut rng = streams.rng(i);
    State::from_array(START.map(|sd| sd * rng.sample::<f64, _>(StandardNormal)))
}

/// What is seen of a target that moves by the model.
fn observations(seed: u64) -> Vec<[f64; 4]> {
    let mut state = first_state(Streams::new(seed, 0).at(0, Purpose::Scene), 0);
    let mut rng = Streams::new(seed, 0).at(1, Purpose::Scene).rng(0);
    let mut next = || {
        state = MOTION.sample(&state, &mut rng);
        SEEN.map(|(i, sd)| state.to_array()[i] + sd * rng.sample::<f64, _>(StandardNormal))
    };
    (0..FRAMES).map(|_| next()).collect()
}

fn log_likelihood(state: &State, observation: &[f64; 4]) -> f64 {
    let terms = SEEN.iter().zip(observation).map(|(&(i, sd), value)| {
        let z = (value - state.to_array()[i]) / sd;
        -0.5 * (z * z + std::f64::consts::TAU.ln()) - sd.ln()
    });
    terms.sum()
}

/// Algorithm 1 without gaze.
fn filter(proposal: &mut dyn Proposal, resampling: &Resampling, observations: &[[f64; 4]], seed: u64) -> Filtered {
    let (streams, n, frame) = (Streams::new(seed, 1), PARTICLES, blank_frame());
    let start = streams.at(0, Purpose::Start);
    let mut particles: Vec<State> = (0..n).map(|i| first_state(start, i as u64)).collect();
    let mut predicted = particles.clone();
    let (mut log_weights, mut weights, mut ancestors) = (vec![0.0; n], vec![1.0 / n as f64; n], vec![0; n]);
    let (mut beliefs, mut log_evidence) = (Vec::new(), 0.0);
    for (t, observation) in (1..).zip(observations) {
        let scene = Scene { frame: &frame, detections: &[] };
        proposal.propose(scene, &particles, &mut predicted, &mut log_weights, streams.at(t, Purpose::Predict));
        for ((log_w, w), state) in log_weights.iter_mut().zip(&weights).zip(&predicted) {
            *log_w += w.ln() + log_likelihood(state, observation);
        }
        log_evidence += normalize(&log_weights, &mut weights);
        let belief = Belief { states: &predicted, weights: &weights };
        beliefs.push((belief.mean(), belief.covariance()));
        if resampling.is_due(belief.ess(), n) {
            resampling.select(&weights, &mut ancestors, &mut streams.at(t, Purpose::Select).rng(0));
            particles.iter_mut().zip(&ancestors).for_each(|(particle, &a)| *particle = predicted[a]);
            weights.fill(1.0 / n as f64);
        } else {
            particles.copy_from_slice(&predicted);
        }
    }
    (beliefs, log_evidence)
}

/// Proposes from wider noise, off to the right, and pays for it with log p/q.
struct Wide;

impl Proposal for Wide {
    fn size(&mut self, _: f64) {}

    fn propose(
        &mut self,
        scene: Scene<'_>,
        parents: &[State],
        children: &mut [State],
        log_ratio: &mut [f64],
        streams: Streams,
    ) {
        let wide = Autoregressive { velocity: 0.75, position: 0.5, log_scale: 0.06, angle: 0.05, ..MOTION };
        Prior::new(Arc::new(wide)).propose(scene, parents, children, log_ratio, streams);
        for ((parent, child), log_ratio) in parents.iter().zip(children).zip(log_ratio) {
            let log_q = wide.log_density(child, parent);
            child.x += 0.1;
            *log_ratio = MOTION.log_density(child, parent) - log_q;
        }
    }
}

#[test]
fn the_wide_proposal_keeps_the_law() {
    let (frame, parent) = (blank_frame(), State::from_array([1.0, 2.0, 3.0, 4.0, 0.1, 0.2]));
    conformance::proposal(&mut Wide, Scene { frame: &frame, detections: &[] }, &parent);
}

fn mean_and_error(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let values: Vec<f64> = values.collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// 3 seeds × 16 filters of 6,000 particles. Means and variances at four frames lie within 7 standard errors of the
/// exact ones (t with 15 degrees of freedom: 4 in 10⁶; 147 comparisons: less than 1 in 1,000), and within 0.1
/// deviations (variances: 10 %), so that a large error cannot hide a bias. The evidence itself (not its logarithm)
/// is unbiased.
fn agrees(make: &dyn Fn() -> Box<dyn Proposal>, scheme: Scheme, below: f64) {
    for seed in 1..=3 {
        let observations = observations(seed);
        let (exact, exact_evidence) = kalman(&observations);
        let run = |run| filter(&mut *make(), &Resampling { scheme, below }, &observations, 100 * seed + run);
        let runs: Vec<Filtered> = (0..RUNS as u64).map(run).collect();
        for (t, i) in [0, 4, 9, FRAMES - 1].into_iter().flat_map(|t| (0..6).map(move |i| (t, i))) {
            let (exact_mean, exact_variance) = (exact[t].0.to_array()[i], exact[t].1[i][i]);
            let check = |what: &str, (got, error): (f64, f64), exact: f64, tolerance: f64| {
                let allowed = (7.0 * error).min(tolerance);
                let what = format!("seed {seed}, frame {t}, component {i}: {what}");
                assert!((got - exact).abs() < allowed, "{what} {got} is not {exact} ± {allowed}");
            };
            let mean = mean_and_error(runs.iter().map(|(beliefs, _)| beliefs[t].0.to_array()[i]));
            check("mean", mean, exact_mean, 0.1 * exact_variance.sqrt());
            let variance = mean_and_error(runs.iter().map(|(beliefs, _)| beliefs[t].1[i][i]));
            check("variance", variance, exact_variance, 0.1 * exact_variance);
        }
        let (got, error) = mean_and_error(runs.iter().map(|(_, evidence)| (evidence - exact_evidence).exp()));
        assert!(error < 0.15, "seed {seed}: the evidence is too noisy to compare, ± {error}");
        assert!((got - 1.0).abs() < 7.0 * error, "seed {seed}: the evidence is {got} ± {error} times the exact one");
    }
}

fn prior() -> Box<dyn Proposal> {
    Box::new(Prior::new(Arc::new(MOTION)))
}

#[test]
fn prior_always_systematic() {
    agrees(&prior, Scheme::Systematic, 1.0);
}

#[test]
fn prior_below_half_stratified_carries_weights() {
    agrees(&prior, Scheme::Stratified, 0.5);
}

#[test]
fn wide_always_residual() {
    agrees(&|| Box::new(Wide), Scheme::Residual, 1.0);
}

#[test]
fn wide_below_half_multinomial_carries_weights() {
    agrees(&|| Box::new(Wide), Scheme::Multinomial, 0.5);
}
