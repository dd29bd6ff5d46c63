//! One step of Gaussian-process gaze selection, one thread: the data's law, the kernel, the priors and the budget of a common
//! peer benchmark. A step takes one more observation, fits the hyper-parameters from where the last step left them, and
//! evaluates the upper confidence bound at 500 points.
//!
//! `cargo bench --bench gp -- [rounds]`. One JSON line a figure: the mean over eight sets of data, of each the median of the
//! rounds. `singly`: the 500 points one at a time rather than a few together, as DIRECT divides its rectangles. Then 100,000
//! steps through a window of 100: time a step in the first and the last tenth.

use foveate::gp::{Gp, Hyper, Kernel, Priors, StudentT};
use foveate::rng::{Purpose, Rng, Streams};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::time::Instant;

const EVALUATIONS: usize = 500;
/// Rectangles that DIRECT divides at a time in two dimensions, about.
const BATCHES: [usize; 8] = [1, 4, 4, 6, 4, 8, 6, 12];

fn reward(x: [f64; 2], rng: &mut Rng) -> f64 {
    let bump = |a: f64, b: f64, v: f64, w: f64| (-(x[0] - a).powi(2) / v - (x[1] - b).powi(2) / w).exp();
    bump(0.35, 0.6, 0.04, 0.02) + 0.6 * bump(0.8, 0.2, 0.02, 0.02) + 0.05 * rng.sample::<f64, _>(StandardNormal)
}

fn rewards(n: usize, seed: u64) -> (Vec<[f64; 2]>, Vec<f64>) {
    let mut rng = Streams::new(seed, 0).at(0, Purpose::Look).rng(0);
    let x: Vec<[f64; 2]> = (0..n).map(|_| [rng.random(), rng.random()]).collect();
    let mut y: Vec<f64> = x.iter().map(|&x| reward(x, &mut rng)).collect();
    let mean = y.iter().sum::<f64>() / n as f64;
    let sd = (y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
    y.iter_mut().for_each(|y| *y = (*y - mean) / sd);
    (x, y)
}

/// The peer's: exp of its bounds on the logarithms.
fn priors() -> Priors<2> {
    let within = |low: f64, high: f64| (low.exp(), high.exp());
    let length = StudentT::new(4.0, 0.3, 0.2, within(-4.0, 2.0)).expect("a proper prior");
    Priors::new([length; 2], within(-6.0, 6.0), within(-9.0, 2.0)).expect("proper bounds")
}

fn start(kernel: Kernel, window: usize) -> Gp<2> {
    Gp::new(kernel, Hyper { length_scales: [0.3; 2], signal_variance: 1.0, noise_variance: 0.1 }, window)
}

/// The largest upper confidence bound of 500 points; which they are does not matter to the time.
fn acquire(gp: &mut Gp<2>, places: &[[f64; 2]], singly: bool) -> f64 {
    let n = gp.len() as f64;
    let root_beta = (2.0 * (n.powi(3) * std::f64::consts::PI.powi(2) / (3.0 * 0.001)).ln()).sqrt();
    let (mut best, mut left, mut batch) = (f64::NEG_INFINITY, places, 0);
    let (mut means, mut variances) = ([0.0; 16], [0.0; 16]);
    while !left.is_empty() {
        let count = if singly { 1 } else { BATCHES[batch % BATCHES.len()].min(left.len()) };
        let (now, later) = left.split_at(count);
        if singly {
            (means[0], variances[0]) = gp.predict(&now[0]);
        } else {
            gp.predict_many(now, &mut means[..count], &mut variances[..count]);
        }
        for (m, v) in means[..count].iter().zip(&variances[..count]) {
            best = best.max(m + root_beta * v.sqrt());
        }
        (left, batch) = (later, batch + 1);
    }
    best
}

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(15);
    for kernel in [Kernel::SquaredExponential, Kernel::Matern52] {
        for n in [10, 50, 100, 300] {
            step(kernel, n, rounds);
        }
    }
    for every in [1, 5] {
        flat(every);
    }
}

fn step(kernel: Kernel, n: usize, rounds: usize) {
    const SETS: u64 = 8;
    let places = rewards(EVALUATIONS, 99).0;
    let (mut times, mut evaluations, mut iterations) = ([0.0; 4], 0, 0);
    for seed in 0..SETS {
        let (x, y) = rewards(n, seed);
        let mut before = start(kernel, n);
        for (&x, &y) in x.iter().zip(&y).take(n - 1) {
            before.push(x, y);
        }
        before.fit(&priors(), 50);
        let mut gp = before.clone();
        let repeats = (20_000 / n).clamp(20, 400);
        let mut measured = [const { Vec::<f64>::new() }; 4];
        for _ in 0..rounds {
            let mut spent = [0.0; 4];
            for _ in 0..repeats {
                gp.clone_from(&before);
                let mut fit = None;
                spent[0] += seconds(|| {
                    gp.push(x[n - 1], y[n - 1]);
                });
                spent[1] += seconds(|| fit = Some(gp.fit(&priors(), 50)));
                let mut best = [0.0; 2];
                spent[2] += seconds(|| best[0] = acquire(&mut gp, &places, false));
                spent[3] += seconds(|| best[1] = acquire(&mut gp, &places, true));
                assert_eq!(best[0], best[1]);
                let fit = fit.expect("just fitted");
                assert!(fit.converged);
                (evaluations, iterations) = (evaluations + fit.evaluations, iterations + fit.iterations);
            }
            for (all, spent) in measured.iter_mut().zip(spent) {
                all.push(1e3 * spent / repeats as f64);
            }
        }
        for (time, all) in times.iter_mut().zip(&mut measured) {
            all.sort_by(f64::total_cmp);
            *time += all[rounds / 2] / SETS as f64;
        }
        if seed == SETS - 1 {
            let fits = (SETS as usize * rounds * repeats) as f64;
            let [push, fit, together, singly] = times;
            println!(
                "{{\"what\": \"fit + acquisition\", \"kernel\": \"{kernel:?}\", \"n\": {n}, \"step_ms\": {:.4}, \
                 \"step_ms_singly\": {:.4}, \"push_ms\": {push:.4}, \"fit_ms\": {fit:.4}, \"iterations\": {:.1}, \
                 \"fit_evaluations\": {:.1}}}",
                push + fit + together,
                push + fit + singly,
                iterations as f64 / fits,
                evaluations as f64 / fits
            );
        }
    }
}

/// A window of 100 over 100,000 observations of a reward that drifts.
fn flat(every: usize) {
    const STEPS: usize = 100_000;
    let places = rewards(EVALUATIONS, 99).0;
    let mut rng = Streams::new(5, 0).at(0, Purpose::Look).rng(0);
    let mut gp = start(Kernel::SquaredExponential, 100);
    let mut tenths = [0.0; 10];
    for t in 0..STEPS {
        let x = [rng.random(), rng.random()];
        let y = reward([x[0], x[1] + 0.1 * (t as f64 / 1e4).sin()], &mut rng);
        tenths[10 * t / STEPS] += seconds(|| {
            gp.push(x, y);
            if t >= 10 && t % every == 0 {
                gp.fit(&priors(), 15);
            }
            acquire(&mut gp, &places[..150], false);
        });
    }
    let us = tenths.map(|s| 1e6 * s * 10.0 / STEPS as f64);
    println!(
        "{{\"what\": \"{STEPS} steps, window 100, 150 evaluations\", \"fit_every\": {every}, \"us_per_step_first_tenth\": {:.1}, \
         \"us_per_step_last_tenth\": {:.1}, \"slowest_tenth\": {:.1}}}",
        us[0],
        us[9],
        us.iter().copied().fold(0.0, f64::max)
    );
}

/// CPU seconds would cost more to ask for than many of these pieces take.
fn seconds(work: impl FnOnce()) -> f64 {
    let before = Instant::now();
    work();
    before.elapsed().as_secs_f64()
}
