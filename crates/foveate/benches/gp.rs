//! One step of Gaussian-process gaze selection, one thread: the data's law, the kernel, the priors and the budget of a common
//! peer benchmark. A step takes one more observation, fits the hyper-parameters from where the last step left them, and
//! maximises the upper confidence bound by DIRECT with 500 evaluations.
//!
//! `cargo bench -p foveate --features lab --bench gp -- [rounds]`.
//! One JSON line a figure: the mean over four sets of data, of each the median of the
//! rounds. `singly`: one point at a time rather than all of a sweep together. Then 100,000 steps through a window of 100:
//! time a step in the first and the last tenth.

use foveate::gp::direct::{Direct, Form};
use foveate::gp::{Gp, Hyper, Kernel, Priors, StudentT};
use foveate::rng::{Purpose, Rng, Streams};
use rand::RngExt;
use rand_distr::StandardNormal;

mod clock;

use clock::seconds;

const EVALUATIONS: usize = 500;

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

/// DIRECT's maximum of the upper confidence bound, a sweep's points together or one at a time.
fn acquire(gp: &mut Gp<2>, direct: &mut Direct<2>, evaluations: usize, singly: bool) -> f64 {
    let n = gp.len() as f64;
    let root_beta = (2.0 * (n.powi(3) * std::f64::consts::PI.powi(2) / (3.0 * 0.001)).ln()).sqrt();
    let (lower, upper) = ([0.0; 2], [1.0; 2]);
    if singly {
        let bound = |x: &[f64; 2]| {
            let (mean, variance) = gp.predict(x);
            mean + root_beta * variance.sqrt()
        };
        return direct.maximise(lower, upper, evaluations, bound).1;
    }
    let mut variances = [0.0; EVALUATIONS];
    let bounds = |x: &[[f64; 2]], values: &mut [f64]| {
        gp.predict_many(x, values, &mut variances[..x.len()]);
        values.iter_mut().zip(&variances).for_each(|(m, v)| *m += root_beta * v.sqrt());
    };
    direct.maximise_batches(lower, upper, evaluations, bounds).1
}

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(5);
    for n in [10, 50, 100, 300] {
        step(Kernel::SquaredExponential, n, rounds);
    }
    step(Kernel::Matern52, 100, rounds);
    for every in [1, 5] {
        flat(every);
    }
}

fn step(kernel: Kernel, n: usize, rounds: usize) {
    const SETS: u64 = 4;
    let (priors, mut direct) = (priors(), Direct::new(Form::Original));
    let (mut times, mut evaluations, mut iterations) = ([0.0; 5], 0, 0);
    for seed in 0..SETS {
        let (x, y) = rewards(n, seed);
        let mut before = start(kernel, n);
        for (&x, &y) in x.iter().zip(&y).take(n - 1) {
            before.push(x, y);
        }
        before.fit(&priors, 50);
        let mut gp = before.clone();
        gp.push(x[n - 1], y[n - 1]);
        let fit = gp.fit(&priors, 50);
        assert!(fit.converged);
        (evaluations, iterations) = (evaluations + fit.evaluations, iterations + fit.iterations);
        let push = |gp: &mut Gp<2>| _ = gp.push(x[n - 1], y[n - 1]);
        let part = |work: &mut dyn FnMut()| 1e3 * median(rounds, work) / SETS as f64;
        // The time of the copies is subtracted below.
        times[0] += part(&mut || drop(std::hint::black_box(before.clone())));
        times[1] += part(&mut || push(&mut before.clone()));
        times[2] += part(&mut || {
            let mut gp = before.clone();
            push(&mut gp);
            gp.fit(&priors, 50);
        });
        times[3] += part(&mut || _ = acquire(&mut gp, &mut direct, EVALUATIONS, false));
        times[4] += part(&mut || _ = acquire(&mut gp, &mut direct, EVALUATIONS, true));
    }
    let [copy, push, fit, together, singly] = times;
    println!(
        "{{\"what\": \"fit + acquisition\", \"kernel\": \"{kernel:?}\", \"n\": {n}, \"step_ms\": {:.4}, \
         \"step_ms_singly\": {:.4}, \"push_ms\": {:.4}, \"fit_ms\": {:.4}, \"iterations\": {:.1}, \
         \"fit_evaluations\": {:.1}}}",
        fit + together - copy,
        fit + singly - copy,
        push - copy,
        fit - push,
        iterations as f64 / SETS as f64,
        evaluations as f64 / SETS as f64
    );
}

/// A window of 100 over 100,000 observations of a reward that drifts.
fn flat(every: usize) {
    const STEPS: usize = 100_000;
    let (priors, mut direct) = (priors(), Direct::new(Form::Original));
    let mut rng = Streams::new(5, 0).at(0, Purpose::Look).rng(0);
    let mut gp = start(Kernel::SquaredExponential, 100);
    let mut tenths = [0.0; 10];
    for (tenth, time) in tenths.iter_mut().enumerate() {
        let steps = tenth * STEPS / 10..(tenth + 1) * STEPS / 10;
        *time = seconds(|| {
            for t in steps {
                let x = [rng.random(), rng.random()];
                let y = reward([x[0], x[1] + 0.1 * (t as f64 / 1e4).sin()], &mut rng);
                gp.push(x, y);
                if t >= 10 && t % every == 0 {
                    gp.fit(&priors, 15);
                }
                acquire(&mut gp, &mut direct, 150, false);
            }
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

/// Seconds of a call of `work`: the median of `rounds` of calls that take 50 ms together, because the system
/// counts CPU time in milliseconds.
fn median(rounds: usize, work: &mut dyn FnMut()) -> f64 {
    let (mut repeats, mut whole) = (1, 0.0);
    while whole < 0.05 && repeats < 100_000 {
        repeats *= 2;
        whole = seconds(|| (0..repeats).for_each(|_| work()));
    }
    let mut all: Vec<f64> =
        (0..rounds).map(|_| seconds(|| (0..repeats).for_each(|_| work())) / repeats as f64).collect();
    all.sort_by(f64::total_cmp);
    all[rounds / 2]
}
