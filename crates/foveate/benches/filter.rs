//! A bootstrap filter's step and systematic resampling, one thread: the model, the data's law and the figures of
//! a common peer benchmark (position and velocity on two axes, full process covariance, positions observed).
//!
//! `cargo bench -p foveate --features lab --bench filter -- [rounds]`.
//! One JSON line a figure. `error` is the estimate's distance from the exact
//! (Kalman) mean in posterior deviations, root mean square over the run, mean of eight sets of data.

use foveate::conformance::blank_image;
use foveate::control::{Belief, Dynamics, Prior, Proposal, Resampling, Scheme, normalize};
use foveate::geometry::State;
use foveate::rng::{Purpose, Rng, Streams};
use foveate::scene::Scene;
use foveate_kernels::Normals;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::sync::Arc;

mod clock;

use clock::seconds;

/// x' = x + v + a₁₁ n₁, v' = v + a₂₁ n₁ + a₂₂ n₂: white acceleration of density Q over one frame.
struct WhiteAcceleration {
    chol: [f64; 3],
}

const Q: f64 = 0.05;
const R: f64 = 0.5;

impl WhiteAcceleration {
    fn new() -> Self {
        let a11 = (Q / 3.0f64).sqrt();
        let a21 = Q / 2.0 / a11;
        Self { chol: [a11, a21, (Q - a21 * a21).sqrt()] }
    }
}

impl WhiteAcceleration {
    #[inline]
    fn step(&self, s: &State, first: [f64; 2], second: [f64; 2]) -> State {
        let [a11, a21, a22] = self.chol;
        State {
            x: s.x + s.vx + a11 * first[0],
            y: s.y + s.vy + a11 * first[1],
            vx: s.vx + a21 * first[0] + a22 * second[0],
            vy: s.vy + a21 * first[1] + a22 * second[1],
            ..*s
        }
    }
}

impl Dynamics for WhiteAcceleration {
    fn expected(&self, s: &State) -> State {
        self.step(s, [0.0; 2], [0.0; 2])
    }
    fn spread(&self) -> f64 {
        self.chol[0]
    }
    fn sized(&self, _: f64) -> Arc<dyn Dynamics> {
        Arc::new(Self::new())
    }
    fn sample(&self, s: &State, rng: &mut Rng) -> State {
        let mut pair = || [rng.sample(StandardNormal), rng.sample(StandardNormal)];
        self.step(s, pair(), pair())
    }
    fn sample_each(&self, previous: &[State], next: &mut [State], rng: &mut Rng) {
        let mut noise = [[[0.0; 2]; 2]; 64];
        let mut stream = Normals::new(rng.random());
        for (previous, next) in previous.chunks(64).zip(next.chunks_mut(64)) {
            stream.fill(noise.as_flattened_mut().as_flattened_mut());
            for ((next, previous), noise) in next.iter_mut().zip(previous).zip(&noise) {
                *next = self.step(previous, noise[0], noise[1]);
            }
        }
    }
    fn log_density(&self, _: &State, _: &State) -> f64 {
        unreachable!("the bootstrap filter draws only")
    }
}

fn observations(data: u64, frames: usize) -> Vec<[f64; 2]> {
    let mut rng = Streams::new(data, 2).rng(0);
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let mut state = State::from_array([normal(), normal(), normal(), normal(), 0.0, 0.0, 0.0]);
    let (model, mut world) = (WhiteAcceleration::new(), Streams::new(data, 3).rng(0));
    let mut see = |t| {
        if t > 0 {
            state = model.sample(&state, &mut world);
        }
        [state.x + R.sqrt() * normal(), state.y + R.sqrt() * normal()]
    };
    (0..frames).map(&mut see).collect()
}

/// Exact means, and the exact deviations of (x, v), which both axes share.
fn kalman(observations: &[[f64; 2]]) -> Vec<([f64; 4], [f64; 2])> {
    let mut mean = [0.0; 4]; // x, y, vx, vy
    let (mut xx, mut xv, mut vv) = (1.0, 0.0, 1.0);
    let mut exact = Vec::new();
    for (t, observation) in observations.iter().enumerate() {
        if t > 0 {
            mean = [mean[0] + mean[2], mean[1] + mean[3], mean[2], mean[3]];
            (xx, xv, vv) = (xx + 2.0 * xv + vv + Q / 3.0, xv + vv + Q / 2.0, vv + Q);
        }
        let (gain_x, gain_v) = (xx / (xx + R), xv / (xx + R));
        for axis in 0..2 {
            let innovation = observation[axis] - mean[axis];
            mean[axis] += gain_x * innovation;
            mean[axis + 2] += gain_v * innovation;
        }
        (xx, xv, vv) = (xx - gain_x * xx, xv - gain_x * xv, vv - gain_v * xv);
        exact.push((mean, [xx.sqrt(), vv.sqrt()]));
    }
    exact
}

/// Everything a filter of n particles needs.
struct Filter {
    prior: Prior,
    particles: Vec<State>,
    predicted: Vec<State>,
    log_weights: Vec<f64>,
    weights: Vec<f64>,
    ancestors: Vec<usize>,
}

impl Filter {
    fn new(n: usize) -> Self {
        Self {
            prior: Prior::new(Arc::new(WhiteAcceleration::new())),
            particles: vec![State::default(); n],
            predicted: vec![State::default(); n],
            log_weights: vec![0.0; n],
            weights: vec![0.0; n],
            ancestors: vec![0; n],
        }
    }
    /// The mean's distance from the exact mean.
    fn error(&mut self, observations: &[[f64; 2]], seed: u64) -> f64 {
        let (mut exact, mut squares) = (kalman(observations).into_iter(), 0.0);
        self.run(observations, seed, |mean| {
            let ([x, y, vx, vy], [sd_x, sd_v]) = exact.next().expect("one mean a frame");
            let z = [(mean.x - x) / sd_x, (mean.y - y) / sd_x, (mean.vx - vx) / sd_v, (mean.vy - vy) / sd_v];
            squares += z.iter().map(|z| z * z).sum::<f64>() / 4.0;
        });
        (squares / observations.len() as f64).sqrt()
    }
    fn run(&mut self, observations: &[[f64; 2]], seed: u64, mut each: impl FnMut(State)) {
        let (frame, streams, resampling) = (blank_image(), Streams::new(seed, 0), Resampling::default());
        let mut rng = streams.at(0, Purpose::Start).rng(0);
        for (t, observation) in observations.iter().enumerate() {
            let at = |purpose| streams.at(t as u64, purpose);
            if t == 0 {
                let mut normal = || -> f64 { rng.sample(StandardNormal) };
                let mut first = || State::from_array([normal(), normal(), normal(), normal(), 0.0, 0.0, 0.0]);
                self.predicted.iter_mut().for_each(|state| *state = first());
                self.log_weights.fill(0.0);
            } else {
                let scene = Scene { image: &frame, detections: &[] };
                let (children, ratio) = (&mut self.predicted, &mut self.log_weights);
                self.prior.propose(scene, &self.particles, children, ratio, at(Purpose::Predict));
            }
            for (log_w, state) in self.log_weights.iter_mut().zip(&self.predicted) {
                let (dx, dy) = (state.x - observation[0], state.y - observation[1]);
                *log_w -= (dx * dx + dy * dy) * (0.5 / R);
            }
            normalize(&self.log_weights, &mut self.weights);
            each(Belief { states: &self.predicted, weights: &self.weights }.mean());
            resampling.select(&self.weights, &mut self.ancestors, &mut at(Purpose::Select).rng(0));
            for (particle, &ancestor) in self.particles.iter_mut().zip(&self.ancestors) {
                *particle = self.predicted[ancestor];
            }
        }
    }
}

/// Nanoseconds for each of `items`, of which a call of `work` does so many: the median of `rounds`.
fn nanoseconds(rounds: usize, items: usize, mut work: impl FnMut()) -> f64 {
    let repeats = 16_000_000usize.div_ceil(items);
    let mut round = || 1e9 * seconds(|| (0..repeats).for_each(|_| work())) / (repeats * items) as f64;
    round();
    let mut times: Vec<f64> = (0..rounds).map(|_| round()).collect();
    times.sort_by(f64::total_cmp);
    times[rounds / 2]
}

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(11);
    for n in [1000, 10_000, 100_000] {
        let frames = (2_000_000 / n).clamp(5, 50);
        let mut filter = Filter::new(n);
        let error = (0..8).map(|data| filter.error(&observations(data, frames), data)).sum::<f64>() / 8.0;
        let (observations, mut sink) = (observations(0, frames), 0.0);
        let ns = nanoseconds(rounds, n * frames, || filter.run(&observations, 1, |mean| sink += mean.x));
        println!(
            r#"{{"what": "bootstrap filter", "n": {n}, "us_per_step": {:.1}, "ns_per_particle_step": {ns:.1}, "error": {error:.4}}}"#,
            1e-3 * ns * n as f64
        );
        assert!(f64::is_finite(sink));
    }
    for n in [1000, 10_000, 100_000] {
        let mut rng = Streams::new(1, 0).rng(0);
        let log_weights: Vec<f64> = (0..n).map(|_| 2.0 * rng.sample::<f64, _>(StandardNormal)).collect();
        let (mut weights, mut ancestors) = (vec![0.0; n], vec![0; n]);
        let ns = nanoseconds(rounds, n, || {
            std::hint::black_box(normalize(&log_weights, &mut weights));
        });
        println!(r#"{{"what": "normalize", "n": {n}, "ns_per_particle": {ns:.2}}}"#);
        for scheme in [Scheme::Systematic, Scheme::Stratified, Scheme::Residual, Scheme::Multinomial] {
            let resampling = Resampling { scheme, below: 1.0 };
            let ns = nanoseconds(rounds, n, || resampling.select(&weights, &mut ancestors, &mut rng));
            println!(r#"{{"what": "resampling, {scheme:?}", "n": {n}, "ns_per_particle": {ns:.2}}}"#);
        }
    }
}
