//! A particle filter in ten lines: follow a point that wanders, seen in noise only.
//!
//! If everything is linear and Gaussian, the Kalman filter is exact, so the error of ten lines can be measured.
//! `cargo run --release -p foveate --example 01_particle_filter`

use foveate::conformance::blank_image;
use foveate::control::{Autoregressive, Belief, Prior, Proposal, Resampling, normalize};
use foveate::geometry::State;
use foveate::rng::{Purpose, Streams};
use foveate::scene::Scene;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::sync::Arc;

const N: usize = 1000;
const WALK: f64 = 1.0; // pixels a frame, on each axis
const NOISE: f64 = 3.0; // pixels

fn main() {
    let walk = Autoregressive { damping: 0.0, velocity: 0.0, position: WALK, ..Autoregressive::default() };
    let (mut prior, resampling, streams) = (Prior::new(Arc::new(walk)), Resampling::default(), Streams::new(1, 0));
    let (frame, mut particles, mut predicted) = (blank_image(), [State::default(); N], [State::default(); N]);
    let (mut log_weights, mut weights, mut ancestors) = ([0.0; N], [0.0; N], [0; N]);

    let (mut truth, mut kalman, mut variance, mut squares) = ([0.0; 2], [0.0; 2], 0.0, [0.0; 3]);
    println!("frame   truth (x, y)    particles      Kalman");
    for t in 1..=100 {
        // The world: the point moves, and is seen with noise.
        let mut world = streams.at(t, Purpose::Scene).rng(0);
        let mut normal = |sd: f64| sd * world.sample::<f64, _>(StandardNormal);
        truth = truth.map(|x| x + normal(WALK));
        let seen = truth.map(|x| x + normal(NOISE));

        // The particle filter: predict, weigh, estimate, select.
        let scene = Scene { image: &frame, detections: &[] };
        prior.propose(scene, &particles, &mut predicted, &mut log_weights, streams.at(t, Purpose::Predict));
        for (log_weight, state) in log_weights.iter_mut().zip(&predicted) {
            *log_weight -= ((state.x - seen[0]).powi(2) + (state.y - seen[1]).powi(2)) / (2.0 * NOISE * NOISE);
        }
        normalize(&log_weights, &mut weights);
        let estimate = Belief { states: &predicted, weights: &weights }.mean();
        resampling.select(&weights, &mut ancestors, &mut streams.at(t, Purpose::Select).rng(0));
        particles = ancestors.map(|ancestor| predicted[ancestor]);

        // The exact answer.
        let gain = (variance + WALK * WALK) / (variance + WALK * WALK + NOISE * NOISE);
        kalman = [0, 1].map(|i| kalman[i] + gain * (seen[i] - kalman[i]));
        variance = gain * NOISE * NOISE;

        let estimate = [estimate.x, estimate.y];
        let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let compared = [distance(estimate, kalman), distance(estimate, truth), distance(seen, truth)];
        squares = [0, 1, 2].map(|i| squares[i] + compared[i]);
        if t % 20 == 0 {
            let place = |p: [f64; 2]| format!("{:6.2} {:6.2}", p[0], p[1]);
            println!("{t:5}  {}  {}  {}", place(truth), place(estimate), place(kalman));
        }
    }
    let [to_kalman, to_truth, unfiltered] = squares.map(|sum| f64::sqrt(sum / 100.0));
    println!("distance to the truth: as seen {unfiltered:.2} px, by particles {to_truth:.2} px");
    println!("particles to Kalman:   {to_kalman:.2} px, where the posterior's deviation is {:.2} px", variance.sqrt());
    assert!(to_truth < 0.75 * unfiltered, "filtering must help");
    assert!(to_kalman < 0.15 * variance.sqrt(), "1,000 particles must come close to the exact answer");
}
