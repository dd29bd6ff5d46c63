//! GP-UCB finds the bottom of Branin's function, a usual test, with 60 evaluations; nothing here tracks anything.
//!
//! Ten places at random, then always the place with the largest upper confidence bound (section 4.4), which DIRECT
//! finds; kernel widths and variances are refitted after each evaluation. Random search does far worse.
//! `cargo run --release -p foveate --example 07_gp_ucb_on_branin`

use foveate::gp::direct::{Direct, Form};
use foveate::gp::{Gp, Hyper, Kernel, Priors, StudentT};
use foveate::rng::{Purpose, Rng, Streams};
use rand::RngExt;
use std::f64::consts::PI;

const EVALUATIONS: usize = 60;
const AT_RANDOM: usize = 10;
const LEAST: f64 = 0.397_887;

/// Branin's function of a point of the unit square: x from −5 to 10, y from 0 to 15; three bottoms, of equal height.
fn branin([u, v]: [f64; 2]) -> f64 {
    let (x, y) = (15.0 * u - 5.0, 15.0 * v);
    (y - 5.1 / (4.0 * PI * PI) * x * x + 5.0 / PI * x - 6.0).powi(2) + 10.0 * (1.0 - 0.125 / PI) * x.cos() + 10.0
}

fn main() {
    println!("lowest value after 10, 20 .. 60 evaluations (the least is {LEAST:.3})\n");
    let mut ends = vec![];
    for seed in 0..3 {
        let mut rng = Streams::new(seed, 0).at(0, Purpose::Look).rng(0);
        let (learned, random) = (gp_ucb(&mut rng), (0..EVALUATIONS).map(|_| branin(anywhere(&mut rng))).collect());
        for (name, values) in [("GP-UCB", &learned), ("random", &random)] {
            let least = |n: usize| values[..n].iter().copied().fold(f64::MAX, f64::min);
            println!("seed {seed}  {name}{}", [10, 20, 30, 40, 50, 60].map(|n| format!("{:9.4}", least(n))).concat());
            ends.push(least(EVALUATIONS));
        }
    }
    for pair in ends.chunks(2) {
        assert!(pair[0] < LEAST + 0.01, "GP-UCB ended at {}", pair[0]);
        assert!(pair[0] - LEAST < 0.5 * (pair[1] - LEAST), "random search ended at {}, GP-UCB at {}", pair[1], pair[0]);
    }
}

fn anywhere(rng: &mut Rng) -> [f64; 2] {
    [rng.random(), rng.random()]
}

fn gp_ucb(rng: &mut Rng) -> Vec<f64> {
    let width = StudentT::new(4.0, 0.3, 0.2, (0.02, 5.0)).expect("a prior");
    let priors = Priors::new([width; 2], (0.05, 100.0), (1e-6, 0.1)).expect("priors");
    let start = Hyper { length_scales: [0.3; 2], signal_variance: 1.0, noise_variance: 1e-3 };
    let mut gp = Gp::new(Kernel::SquaredExponential, start, EVALUATIONS);
    let mut direct = Direct::new(Form::LocallyBiased);
    let (mut values, mut rewards) = (vec![], vec![]);
    for t in 1..=EVALUATIONS {
        let at = if t <= AT_RANDOM {
            anywhere(rng)
        } else {
            gp.fit(&priors, 15);
            let root_beta = (2.0 * ((t as f64).powi(3) * PI * PI / (3.0 * 0.001)).ln()).sqrt();
            let mut spread = vec![];
            let bound = |xs: &[[f64; 2]], bounds: &mut [f64]| {
                spread.resize(xs.len(), 0.0);
                gp.predict_many(xs, bounds, &mut spread);
                bounds.iter_mut().zip(&spread).for_each(|(mean, variance)| *mean += root_beta * variance.sqrt());
            };
            direct.maximise_batches([0.0; 2], [1.0; 2], 500, bound).0
        };
        values.push(branin(at));
        gp.push(at, 0.0);
        standardise(&values, &mut rewards);
        gp.set_values(&rewards);
    }
    values
}

/// Rewards with mean 0 and deviation 1, larger for smaller values.
fn standardise(values: &[f64], rewards: &mut Vec<f64>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt().max(1e-9);
    rewards.clear();
    rewards.extend(values.iter().map(|v| (mean - v) / sd));
}
