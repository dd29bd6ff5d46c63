//! DIRECT to 10⁻⁴ of a known optimum, one thread: evaluations, time, and what an evaluation costs beside the objective.
//!
//! `cargo bench -p foveate --features lab --bench direct -- [rounds]`.
//! One JSON line a figure. Problems: Branin, Hartmann's in six dimensions,
//! and an upper confidence bound of a Gaussian process on 50 rewards. `gpucb.csv` has in its first line the signal's
//! variance, two length scales, the noise's variance, √β and the known optimum, then places (u, v) and rewards.
//! `overhead_us` is the time of the search less that of the objective alone at the same points, an evaluation.

use foveate::gp::direct::{Direct, Form};
use std::f64::consts::PI;
use std::hint::black_box;

mod clock;

use clock::seconds;

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(9);
    run("branin", rounds, [-5.0, 0.0], [10.0, 15.0], -0.39788735772973816, branin);
    run("hartmann6", rounds, [0.0; 6], [1.0; 6], 3.322368011415515, hartmann6);
    let bound = Bound::read();
    run("gpucb", rounds, [0.0; 2], [1.0; 2], bound.best, |x| bound.at(x));
}

#[inline(never)]
fn branin([x, y]: &[f64; 2]) -> f64 {
    let bowl = y - 5.1 / (4.0 * PI * PI) * x * x + 5.0 / PI * x - 6.0;
    -(bowl * bowl + 10.0 * (1.0 - 0.125 / PI) * x.cos() + 10.0)
}

#[inline(never)]
fn hartmann6(x: &[f64; 6]) -> f64 {
    const HEIGHT: [f64; 4] = [1.0, 1.2, 3.0, 3.2];
    const RATE: [[f64; 6]; 4] = [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ];
    const AT: [[f64; 6]; 4] = [
        [0.1312, 0.1696, 0.5569, 0.0124, 0.8283, 0.5886],
        [0.2329, 0.4135, 0.8307, 0.3736, 0.1004, 0.9991],
        [0.2348, 0.1451, 0.3522, 0.2883, 0.3047, 0.6650],
        [0.4047, 0.8828, 0.8732, 0.5743, 0.1091, 0.0381],
    ];
    let hill = |k: usize| {
        let d: f64 = (0..6).map(|i| RATE[k][i] * (x[i] - AT[k][i]) * (x[i] - AT[k][i])).sum();
        HEIGHT[k] * (-d).exp()
    };
    (0..4).map(hill).sum()
}

/// mean + √β · deviation, by the inverse of the covariance.
struct Bound {
    signal: f64,
    scale: [f64; 2],
    root_beta: f64,
    best: f64,
    at: Vec<[f64; 2]>,
    inverse: Vec<f64>,
    weights: Vec<f64>,
}

impl Bound {
    fn read() -> Self {
        let lines: Vec<Vec<f64>> = include_str!("gpucb.csv")
            .lines()
            .map(|line| line.split(',').map(|v| v.parse().expect("a number")).collect())
            .collect();
        let [signal, u, v, noise, root_beta, best] = lines[0][..] else { panic!("six numbers in the first line") };
        let at: Vec<[f64; 2]> = lines[1..].iter().map(|l| [l[0] / u, l[1] / v]).collect();
        let n = at.len();
        let mut bound = Self { signal, scale: [u, v], root_beta, best, at, inverse: vec![], weights: vec![] };
        // Gauss and Jordan on (K + noise, 1): n is 50, once.
        let mut rows: Vec<Vec<f64>> = (0..n)
            .map(|i| {
                let k = (0..n).map(|j| bound.kernel(bound.at[i], j) + if i == j { noise + 1e-8 } else { 0.0 });
                k.chain((0..n).map(|j| f64::from(u8::from(i == j)))).collect()
            })
            .collect();
        for i in 0..n {
            let pivot = rows[i][i];
            rows[i].iter_mut().for_each(|x| *x /= pivot);
            let row = rows[i].clone();
            for other in (0..n).filter(|&j| j != i) {
                let by = rows[other][i];
                rows[other].iter_mut().zip(&row).for_each(|(x, r)| *x -= by * r);
            }
        }
        bound.inverse = rows.iter().flat_map(|row| row[n..].to_vec()).collect();
        bound.weights = rows.iter().map(|row| (0..n).map(|j| row[n + j] * lines[j + 1][2]).sum()).collect();
        bound
    }
    fn kernel(&self, q: [f64; 2], i: usize) -> f64 {
        let (u, v) = (self.at[i][0] - q[0], self.at[i][1] - q[1]);
        self.signal * (-0.5 * (u * u + v * v)).exp()
    }
    #[inline(never)]
    fn at(&self, x: &[f64; 2]) -> f64 {
        let q = [x[0] / self.scale[0], x[1] / self.scale[1]];
        let mut k = [0.0; 50];
        k.iter_mut().enumerate().for_each(|(i, k)| *k = self.kernel(q, i));
        let mean: f64 = k.iter().zip(&self.weights).map(|(k, w)| k * w).sum();
        let mut explained = [0.0; 50];
        for (k, row) in k.iter().zip(self.inverse.chunks_exact(50)) {
            explained.iter_mut().zip(row).for_each(|(e, r)| *e += k * r);
        }
        let variance = self.signal - k.iter().zip(&explained).map(|(k, e)| k * e).sum::<f64>();
        mean + self.root_beta * variance.max(1e-12).sqrt()
    }
}

fn run<const D: usize>(
    name: &str,
    rounds: usize,
    lower: [f64; D],
    upper: [f64; D],
    best: f64,
    objective: impl Fn(&[f64; D]) -> f64,
) {
    let target = best - 1e-4 * best.abs();
    for form in [Form::Original, Form::LocallyBiased] {
        for batches in [false, true] {
            let mut direct = Direct::new(form).until(target);
            let all = |x: &[[f64; D]], y: &mut [f64]| y.iter_mut().zip(x).for_each(|(y, x)| *y = objective(x));
            let search = |direct: &mut Direct<D>| match batches {
                false => direct.maximise(lower, upper, 20_000, &objective),
                true => direct.maximise_batches(lower, upper, 20_000, all),
            };
            let (_, value) = search(&mut direct);
            let evaluations = direct.evaluations();
            let mut points = Vec::with_capacity(evaluations);
            direct.clone().maximise_batches(lower, upper, evaluations, |x, y| {
                points.extend_from_slice(x);
                all(x, y);
            });
            points.truncate(evaluations);
            // The system counts CPU time in milliseconds.
            let times = 1 + 300_000 / evaluations;
            let per = 1e6 / (times * evaluations) as f64;
            let mut figures: Vec<[f64; 2]> = (0..rounds)
                .map(|_| {
                    let whole = seconds(|| (0..times).for_each(|_| _ = black_box(search(&mut direct))));
                    let replay = || points.iter().for_each(|x| _ = black_box(objective(black_box(x))));
                    let own = seconds(|| (0..times).for_each(|_| replay()));
                    [whole * per, (whole - own) * per]
                })
                .collect();
            figures.sort_by(|a, b| a[1].total_cmp(&b[1]));
            let [whole, overhead] = figures[figures.len() / 2];
            println!(
                "{{\"what\": \"{form:?}\", \"problem\": \"{name}\", \"batches\": {batches}, \"reached\": {}, \
                 \"evals\": {evaluations}, \"us_per_eval\": {whole:.4}, \"overhead_us\": {overhead:.4}, \"best\": {:.4}, \
                 \"rounds\": {rounds}}}",
                value >= target,
                figures[0][1]
            );
        }
    }
}
