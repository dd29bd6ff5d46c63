//! The particle filter agrees with the Kalman filter where the Kalman filter is exact: a linear-Gaussian target,
//! seen in noise. Means, variances and evidence; any proposal; resampling always or below a threshold; the parts put
//! together here, and the whole tracker.

use foveate::Seen;
use foveate::conformance;
use foveate::conformance::blank_image;
use foveate::control::{
    Autoregressive, Belief, Concentration, ConfidenceModel, ConsistencySettings, Dynamics, Prior, Proposal, Resampling,
    Scheme, normalize,
};
use foveate::gaze::Fixed;
use foveate::geometry::{BBox, Extent, Gaze, State};
use foveate::identity::Appearance;
use foveate::reference::ReferenceLikelihood;
use foveate::rng::{Purpose, Streams};
use foveate::scene::{Image, Preprocessor, Scene};
use foveate::start::StartSpread;
use foveate::{Filter, GazeControl, Monitor, Parts, Tracker};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::array::from_fn;
use std::sync::Arc;

type Matrix = [[f64; N]; N];

/// Mean and covariance after each frame, and the log evidence of all frames.
type Filtered = (Vec<(State, Matrix)>, f64);

const N: usize = State::N;
const FRAMES: usize = 16;
const PARTICLES: usize = 6000;
/// Filters of one set of observations; their spread bounds the error of their mean.
const RUNS: usize = 16;
const MOTION: Autoregressive = Autoregressive {
    damping: 0.9,
    velocity: 0.6,
    position: 0.4,
    scale_pull: 0.9,
    log_scale: 0.05,
    angle_pull: 0.95,
    angle: 0.04,
    aspect_pull: 0.92,
    aspect: 0.06,
    tail_probability: 0.0,
    tail_scale: 1.0,
};
/// Standard deviation of the first state's components.
const START: [f64; N] = [2.0, 2.0, 1.0, 1.0, 0.1, 0.1, 0.12];
/// The observation of a state (x, y, log scale, angle, log aspect), and the standard deviation of the noise on it.
const SEEN: [(usize, f64); 5] = [(0, 2.0), (1, 2.5), (4, 0.2), (5, 0.2), (6, 0.25)];

/// The exact filter of a target whose first state has these standard deviations.
fn kalman(start: [f64; N], observations: &[[f64; 5]]) -> Filtered {
    let m = MOTION;
    let (mut f, mut q) = ([[0.0; N]; N], [[0.0; N]; N]); // x' = F x + noise of covariance Q, in the order of State's fields
    for (x, v) in [(0, 2), (1, 3)] {
        (f[x][x], f[x][v], f[v][v]) = (1.0, m.damping, m.damping);
        let moved = m.velocity.powi(2);
        (q[x][x], q[x][v], q[v][x], q[v][v]) = (moved + m.position.powi(2), moved, moved, moved);
    }
    (f[4][4], q[4][4]) = (m.scale_pull, m.log_scale.powi(2));
    (f[5][5], q[5][5]) = (m.angle_pull, m.angle.powi(2));
    (f[6][6], q[6][6]) = (m.aspect_pull, m.aspect.powi(2));

    let mut mean = [0.0; N];
    let mut cov: Matrix = from_fn(|i| from_fn(|j| if i == j { start[i].powi(2) } else { 0.0 }));
    let (mut beliefs, mut log_evidence) = (Vec::new(), 0.0);
    for observation in observations {
        mean = from_fn(|i| (0..N).map(|k| f[i][k] * mean[k]).sum());
        let half: Matrix = from_fn(|i| from_fn(|j| (0..N).map(|k| f[i][k] * cov[k][j]).sum()));
        cov = from_fn(|i| from_fn(|j| (0..N).map(|k| half[i][k] * f[j][k]).sum::<f64>() + q[i][j]));
        // One number at a time: their noises are independent.
        for (&(seen, sd), value) in SEEN.iter().zip(observation) {
            let variance = cov[seen][seen] + sd * sd;
            let innovation = value - mean[seen];
            log_evidence -= 0.5 * (innovation * innovation / variance + (std::f64::consts::TAU * variance).ln());
            let gain: [f64; N] = from_fn(|i| cov[i][seen] / variance);
            let row = cov[seen];
            for i in 0..N {
                mean[i] += gain[i] * innovation;
                for j in 0..N {
                    cov[i][j] -= gain[i] * row[j];
                }
            }
        }
        beliefs.push((State::from_array(mean), cov));
    }
    (beliefs, log_evidence)
}

fn first_state(start: [f64; N], streams: Streams, i: u64) -> State {
    let mut rng = streams.rng(i);
    State::from_array(start.map(|sd| sd * rng.sample::<f64, _>(StandardNormal)))
}

/// Observations of a target that moves by the model.
fn observations(start: [f64; N], seed: u64) -> Vec<[f64; 5]> {
    let mut state = first_state(start, Streams::new(seed, 0).at(0, Purpose::Scene), 0);
    let mut rng = Streams::new(seed, 0).at(1, Purpose::Scene).rng(0);
    let mut next = || {
        state = MOTION.sample(&state, &mut rng);
        SEEN.map(|(i, sd)| state.to_array()[i] + sd * rng.sample::<f64, _>(StandardNormal))
    };
    (0..FRAMES).map(|_| next()).collect()
}

fn log_likelihood(state: &State, observation: &[f64; 5]) -> f64 {
    let terms = SEEN.iter().zip(observation).map(|(&(i, sd), value)| {
        let z = (value - state.to_array()[i]) / sd;
        -0.5 * (z * z + std::f64::consts::TAU.ln()) - sd.ln()
    });
    terms.sum()
}

/// Algorithm 1 without gaze.
fn filter(proposal: &mut dyn Proposal, resampling: &Resampling, observations: &[[f64; 5]], seed: u64) -> Filtered {
    let (streams, n, frame) = (Streams::new(seed, 1), PARTICLES, blank_image());
    let start = streams.at(0, Purpose::Start);
    let mut particles: Vec<State> = (0..n).map(|i| first_state(START, start, i as u64)).collect();
    let mut predicted = particles.clone();
    let (mut log_weights, mut weights, mut ancestors) = (vec![0.0; n], vec![1.0 / n as f64; n], vec![0; n]);
    let (mut beliefs, mut log_evidence) = (Vec::new(), 0.0);
    for (t, observation) in (1..).zip(observations) {
        let scene = Scene { image: &frame, detections: &[] };
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
        let wide =
            Autoregressive { velocity: 0.75, position: 0.5, log_scale: 0.06, angle: 0.05, aspect: 0.07, ..MOTION };
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
    let (frame, parent) = (blank_image(), State::from_array([1.0, 2.0, 3.0, 4.0, 0.1, 0.2, 0.3]));
    conformance::proposal(&mut Wide, Scene { image: &frame, detections: &[] }, &parent);
}

fn mean_and_error(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let values: Vec<f64> = values.collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// 3 seeds × 16 filters of 6,000 particles. Means and variances at four frames lie within 7 standard errors of the
/// exact ones (t with 15 degrees of freedom: 4 in 10⁶; 171 comparisons: less than 1 in 1,000), and within 0.1
/// deviations (variances: 10 %), so that a large error cannot hide a bias. The evidence itself (not its logarithm)
/// is unbiased.
fn agrees(make: &dyn Fn() -> Box<dyn Proposal>, scheme: Scheme, below: f64) {
    let run = |observations: &[[f64; 5]], seed| filter(&mut *make(), &Resampling { scheme, below }, observations, seed);
    agrees_with(START, RUNS, 7.0, &run);
}

/// Filters `runs` times with each of 3 seeds, and compares with the exact filter; `errors` is how many standard errors are
/// allowed.
fn agrees_with(start: [f64; N], runs: usize, errors: f64, filter: &dyn Fn(&[[f64; 5]], u64) -> Filtered) {
    for seed in 1..=3 {
        let observations = observations(start, seed);
        let (exact, exact_evidence) = kalman(start, &observations);
        let runs: Vec<Filtered> = (0..runs as u64).map(|run| filter(&observations, 100 * seed + run)).collect();
        for (t, i) in [0, 4, 9, FRAMES - 1].into_iter().flat_map(|t| (0..N).map(move |i| (t, i))) {
            let (exact_mean, exact_variance) = (exact[t].0.to_array()[i], exact[t].1[i][i]);
            let check = |what: &str, (got, error): (f64, f64), exact: f64, tolerance: f64| {
                let allowed = (errors * error).min(tolerance);
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
        assert!((got - 1.0).abs() < errors * error, "seed {seed}: the evidence is {got} ± {error} times the exact one");
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

/// The tracker's first box: halves of 16 and 9 pixels, so that a template unit is 12 pixels.
const BOX: (f64, f64) = (32.0, 18.0);
const UNIT: f64 = 12.0;
const CENTRE: (f64, f64) = (40.0, 30.0);
const SPREAD: StartSpread = StartSpread { position: 0.2, velocity: 0.1, log_scale: 0.1, angle: 0.1, aspect: 0.12 };
/// The deviations of its first particles, pixels: 0.2 half boxes across and down, 0.1 template units a frame.
const SPREAD_START: [f64; N] = [3.2, 1.8, 1.2, 1.2, 0.1, 0.1, 0.12];
const TRACKER_PARTICLES: usize = 8000;
const TRACKER_RUNS: usize = 40;

/// The picture holds the observation of its frame: the eight bytes of each number, in the first row.
fn picture(observation: &[f64; 5]) -> Image {
    let mut image = Image::grey(80, 60, 0);
    for (bytes, value) in image.plane_mut(0).chunks_exact_mut(8).zip(observation) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
    image
}

/// Its likelihood is the density of the observation, read from the picture; any gaze sees the same.
struct Linear([f64; 5]);

impl Appearance for Linear {
    fn init_template(&mut self, _: &Image, _: &State, _: Extent, _: Streams) -> ReferenceLikelihood {
        ReferenceLikelihood { on: 0.0, off: -20.0 }
    }
    fn prepare(&mut self, image: &Image, _: &[State], _: &[Gaze]) {
        for (value, bytes) in self.0.iter_mut().zip(image.plane(0).chunks_exact(8)) {
            *value = f64::from_le_bytes(bytes.try_into().expect("eight bytes"));
        }
    }
    fn log_likelihood(&mut self, states: &[State], _: Gaze, out: &mut [f64]) {
        out.iter_mut().zip(states).for_each(|(out, state)| *out = log_likelihood(state, &self.0));
    }
}

/// The same model in the whole tracker, given only a first box and pictures, with rare resampling. `look` is shown each
/// step, and its observation.
fn track(
    proposal: Box<dyn Proposal>,
    particles: usize,
    observations: &[[f64; 5]],
    seed: u64,
    look: &mut dyn FnMut(&Seen<'_>, &[f64; 5]),
) -> Filtered {
    let resampling = Resampling { scheme: Scheme::Systematic, below: 0.1 };
    let filter = Filter::new(proposal, particles).expect("some particles");
    let reward = Concentration::new(1.0).expect("a temperature");
    let gaze = GazeControl::new(Box::new(Fixed::new(Gaze::CENTRE)), Box::new(reward));
    let monitor = Monitor::new(ConsistencySettings::default(), ConfidenceModel::default());
    let parts =
        Parts::new(filter.with_resampling(resampling).with_start(SPREAD), gaze, Box::new(Linear([0.0; 5])), monitor);
    let mut tracker = Tracker::from_parts(parts, Preprocessor::default(), seed);
    let (x, y) = CENTRE;
    tracker.init(&picture(&[0.0; 5]), BBox::around(x, y, BOX.0, BOX.1)).expect("a box in the picture");
    let (mut beliefs, mut log_evidence) = (Vec::new(), 0.0);
    for [seen_x, seen_y, log_scale, angle, log_aspect] in observations {
        let observation = [seen_x + x, seen_y + y, *log_scale, *angle, *log_aspect];
        let picture = picture(&observation);
        let seen = tracker.update(&picture).expect("a picture of the first size");
        beliefs.push((State { x: seen.state.x - x, y: seen.state.y - y, ..seen.state }, seen.covariance));
        log_evidence += seen.log_evidence;
        look(&seen, &observation);
    }
    (beliefs, log_evidence)
}

/// Whether all particles keep their weights.
fn carries(step: &Seen<'_>) -> bool {
    step.ancestors.iter().enumerate().all(|(i, a)| i == *a)
}

/// The prior in template units.
fn prior_of_unit() -> Box<dyn Proposal> {
    let motion = Autoregressive { velocity: MOTION.velocity / UNIT, position: MOTION.position / UNIT, ..MOTION };
    Box::new(Prior::new(Arc::new(motion)))
}

/// With the prior as proposal a weight is the one before, or 1/N after a selection, times the likelihood, over the evidence.
#[test]
fn weights_of_the_tracker_are_carried_until_it_selects() {
    const COUNT: usize = 1000;
    for seed in 1..=3 {
        let (mut before, mut frames) = (vec![1.0 / COUNT as f64; COUNT], [0, 0]);
        track(prior_of_unit(), COUNT, &observations(SPREAD_START, seed), seed, &mut |step, observation| {
            let unnormalized: Vec<f64> =
                step.particles.iter().zip(&before).map(|(s, w)| w * log_likelihood(s, observation).exp()).collect();
            let evidence: f64 = unnormalized.iter().sum();
            assert!((step.log_evidence - evidence.ln()).abs() < 1e-9, "{} is not ln {evidence}", step.log_evidence);
            for (got, exact) in step.weights.iter().zip(&unnormalized) {
                assert!((got - exact / evidence).abs() < 1e-12, "seed {seed}: {got} is not {}", exact / evidence);
            }
            frames[usize::from(carries(step))] += 1;
            before.fill(1.0 / COUNT as f64);
            if carries(step) {
                before.copy_from_slice(step.weights);
            }
        });
        assert!(frames[0] > 1 && frames[1] > 5, "seed {seed}: {frames:?} frames select, and carry");
    }
}

/// 3 seeds × 40 trackers of 8,000 particles. Means, variances and evidence lie within 5 standard errors of the exact ones (t
/// with 39 degrees of freedom: 13 in 10⁶; 171 comparisons: a correct tracker fails for 2 sets of seeds in 1,000), and
/// within 0.1 deviations (variances: 10 %). The product of the frames' evidence (not its logarithm) is unbiased. Some frames
/// select, about as many carry the weights on.
fn tracker_agrees(make: &dyn Fn() -> Box<dyn Proposal>) {
    let (carried, frames) = (std::cell::Cell::new(0), 3 * TRACKER_RUNS * FRAMES);
    let run = |observations: &[[f64; 5]], seed| {
        let mut count = |step: &Seen<'_>, _: &[f64; 5]| carried.set(carried.get() + usize::from(carries(step)));
        track(make(), TRACKER_PARTICLES, observations, seed, &mut count)
    };
    agrees_with(SPREAD_START, TRACKER_RUNS, 5.0, &run);
    let carried = carried.get();
    assert!(3 * carried > frames && 4 * carried < 3 * frames, "{carried} of {frames} frames carried their weights on");
}

#[test]
fn the_tracker_with_the_prior() {
    tracker_agrees(&prior_of_unit);
}

#[test]
fn the_tracker_with_a_wide_proposal() {
    tracker_agrees(&|| Box::new(Wide));
}
