//! Hybrid Monte Carlo (Duane et al. 1987; Neal 2011): samples from p(x) ∝ exp(−F(x)), given only F and its gradient.
//!
//! A row x gets a momentum p ~ N(0, 1), moves by leapfrog steps along H = F(x) + ½‖p‖², and is accepted with probability min(1, exp(H₀ −
//! H₁)); otherwise it stays unchanged. The density is invariant for any step length.

use foveate::learn::rbm::product::block_of;
use foveate::rng::Rng;
use foveate::rows::Rows;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Decay of the running rejection rate, and relative change of the step per batch (the authors' code).
const REMEMBERED: f32 = 0.9;
const FASTER: f32 = 1.01;
const SLOWER: f32 = 0.99;
/// Minimum and maximum step (the authors' code).
const LEAST_STEP: f32 = 0.001;
const MOST_STEP: f32 = 0.25;

/// F and its gradient, for many rows at a time.
pub(super) trait Potential: Sync {
    /// Buffers, grown once.
    type Scratch: Default + Send;
    /// Computes `gradient` (m × n) ← ∂F/∂x at rows `x` (m × n) and, if given, `energy` (m) ← F in nats. A row's results must depend on that
    /// row alone.
    fn gradient(&self, x: Rows<'_>, scratch: &mut Self::Scratch, gradient: &mut [f32], energy: Option<&mut [f64]>);
}

/// The length of a leapfrog step, adapted to a target rejection rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Length of a leapfrog step.
    pub(super) size: f32,
    /// Running mean of the rejection rate.
    pub(super) rejection: f32,
}

impl Step {
    /// Adapts the step to a batch's rejection rate, towards `target`.
    pub(super) fn adapt(&mut self, rejected: f32, target: f32) {
        self.rejection = REMEMBERED * self.rejection + (1.0 - REMEMBERED) * rejected;
        self.size *= if self.rejection < target { FASTER } else { SLOWER };
        self.size = self.size.clamp(LEAST_STEP, MOST_STEP);
    }
}

/// Buffers of a block of rows.
#[derive(Debug, Default)]
pub(super) struct Work<S> {
    blocks: Vec<Block<S>>,
}

#[derive(Debug, Default)]
struct Block<S> {
    x: Vec<f32>,
    momentum: Vec<f32>,
    gradient: Vec<f32>,
    before: Vec<f64>,
    after: Vec<f64>,
    uniform: Vec<f64>,
    scratch: S,
}

/// Moves every row of `x` (m × n) by one proposal of `steps` leapfrog steps of length `step`; `stream(i)` is the random stream of row i.
/// Returns the number of rejected rows. The result has the same bits for any number of threads.
pub(super) fn transition<P: Potential>(
    potential: &P,
    x: &mut [f32],
    n: usize,
    (steps, step): (usize, f32),
    stream: impl Fn(usize) -> Rng + Sync,
    work: &mut Work<P::Scratch>,
) -> usize {
    let rows = x.len() / n;
    let block = block_of(rows);
    work.blocks.resize_with(work.blocks.len().max(rows.div_ceil(block)), Block::default);
    let blocks = x.par_chunks_mut(block * n).zip(&mut work.blocks).enumerate();
    let rejected = blocks.map(|(b, (x, w))| {
        let m = x.len() / n;
        w.x.clear();
        w.x.extend_from_slice(x);
        w.momentum.resize(m * n, 0.0);
        w.gradient.resize(m * n, 0.0);
        w.before.resize(m, 0.0);
        w.after.resize(m, 0.0);
        // The first number of a row's stream decides on acceptance, the others are its momentum.
        w.uniform.clear();
        for (r, p) in w.momentum.chunks_exact_mut(n).enumerate() {
            let mut rng = stream(b * block + r);
            w.uniform.push(rng.random());
            p.iter_mut().for_each(|p| *p = StandardNormal.sample(&mut rng));
        }
        leapfrog(potential, (steps, step), n, w);
        let mut rejected = 0;
        for (r, row) in x.chunks_exact_mut(n).enumerate() {
            // NaN counts as rejected.
            if w.uniform[r].ln() < w.before[r] - w.after[r] {
                row.copy_from_slice(&w.x[r * n..][..n]);
            } else {
                rejected += 1;
            }
        }
        rejected
    });
    rejected.sum()
}

/// Does the leapfrog steps of the rows in `w`, with H before and after.
fn leapfrog<P: Potential>(potential: &P, (steps, step): (usize, f32), n: usize, w: &mut Block<P::Scratch>) {
    let kick = |momentum: &mut [f32], gradient: &[f32], by: f32| {
        momentum.iter_mut().zip(gradient).for_each(|(p, g)| *p -= by * g);
    };
    let kinetic = |momentum: &[f32], energy: &mut [f64]| {
        for (p, e) in momentum.chunks_exact(n).zip(energy) {
            *e += 0.5 * f64::from(foveate_kernels::dot(p, p));
        }
    };
    potential.gradient(Rows::new(&w.x, n), &mut w.scratch, &mut w.gradient, Some(&mut w.before));
    kinetic(&w.momentum, &mut w.before);
    kick(&mut w.momentum, &w.gradient, 0.5 * step);
    for i in 1..=steps {
        w.x.iter_mut().zip(&w.momentum).for_each(|(x, p)| *x += step * p);
        let last = i == steps;
        let energy = if last { Some(&mut w.after[..]) } else { None };
        potential.gradient(Rows::new(&w.x, n), &mut w.scratch, &mut w.gradient, energy);
        kick(&mut w.momentum, &w.gradient, if last { 0.5 * step } else { step });
    }
    kinetic(&w.momentum, &mut w.after);
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::rng::{Purpose, Streams};

    /// Independent normal numbers of these precisions around 0.
    struct Normal([f32; 3]);

    impl Potential for Normal {
        type Scratch = ();
        fn gradient(&self, x: Rows<'_>, (): &mut (), gradient: &mut [f32], energy: Option<&mut [f64]>) {
            for (x, g) in x.iter().zip(gradient.chunks_exact_mut(3)) {
                (0..3).for_each(|i| g[i] = self.0[i] * x[i]);
            }
            for (x, e) in x.iter().zip(energy.unwrap_or_default()) {
                *e = (0..3).map(|i| 0.5 * f64::from(self.0[i] * x[i] * x[i])).sum();
            }
        }
    }

    /// Rows drawn from the density itself.
    fn drawn(normal: &Normal, rows: usize) -> Vec<f32> {
        let mut rng = Streams::new(8, 0).rng(0);
        (0..rows * 3)
            .map(|e| {
                let z: f32 = StandardNormal.sample(&mut rng);
                z / normal.0[e % 3].sqrt()
            })
            .collect()
    }

    /// A coarse step, with a third of the proposals rejected: without that decision the variances would be far off.
    #[test]
    fn a_known_gaussian_stays_as_it_is() {
        let normal = Normal([0.25, 1.0, 16.0]);
        let rows = 4000;
        let mut x = drawn(&normal, rows);
        let (mut work, mut rejected) = (Work::default(), 0);
        for t in 0..30 {
            let streams = Streams::new(9, 0).at(t, Purpose::Train);
            rejected += transition(&normal, &mut x, 3, (4, 0.43), |r| streams.rng(r as u64), &mut work);
        }
        let rate = rejected as f64 / (30 * rows) as f64;
        assert!((0.1..0.6).contains(&rate), "{rate} of the proposals were rejected");
        // 4000 rows, seed 9. Means and second moments within 4.5 sd: a false alarm in 10⁴ seeds for all nine together.
        let n = rows as f64;
        for i in 0..3 {
            let column = x.iter().skip(i).step_by(3).map(|&x| f64::from(x) * f64::from(normal.0[i].sqrt()));
            let (mean, square) = column.clone().fold((0.0, 0.0), |(m, s), x| (m + x / n, s + x * x / n));
            let lag: f64 =
                column.clone().zip(x.iter().skip((i + 1) % 3).step_by(3)).map(|(a, b)| a * f64::from(*b)).sum();
            let lag = lag / n * f64::from(normal.0[(i + 1) % 3].sqrt());
            assert!(mean.abs() < 4.5 / n.sqrt(), "mean {mean}");
            assert!((square - 1.0).abs() < 4.5 * (2.0 / n).sqrt(), "second moment {square}");
            assert!(lag.abs() < 4.5 / n.sqrt(), "covariance {lag}");
        }
    }

    #[test]
    fn leapfrog_is_reversible_and_hardly_changes_the_energy() {
        let normal = Normal([0.25, 1.0, 16.0]);
        let start = drawn(&normal, 5);
        let mut block = Block::<()> {
            x: start.clone(),
            momentum: drawn(&Normal([1.0; 3]), 5),
            gradient: vec![0.0; 15],
            before: vec![0.0; 5],
            after: vec![0.0; 5],
            ..Block::default()
        };
        let push = block.momentum.clone();
        leapfrog(&normal, (50, 0.02), 3, &mut block);
        for (a, b) in block.before.iter().zip(&block.after) {
            assert!((a - b).abs() < 0.02 * a.max(1.0), "H from {a} to {b}");
        }
        block.momentum.iter_mut().for_each(|p| *p = -*p);
        leapfrog(&normal, (50, 0.02), 3, &mut block);
        for ((x, s), (p, q)) in block.x.iter().zip(&start).zip(block.momentum.iter().zip(&push)) {
            assert!((x - s).abs() < 1e-4 && (p + q).abs() < 1e-3, "{x} is not {s}, or {p} not -{q}");
        }
    }

    #[test]
    fn rows_do_not_depend_on_threads_and_steps_find_their_rate() {
        let normal = Normal([0.25, 1.0, 16.0]);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let (mut x, mut work) = (drawn(&normal, 100), Work::default());
                let mut step = Step { size: 0.01, rejection: 0.0 };
                let mut last = 0.0;
                for t in 0..600 {
                    let streams = Streams::new(2, 0).at(t, Purpose::Train);
                    let rejected =
                        transition(&normal, &mut x, 3, (20, step.size), |r| streams.rng(r as u64), &mut work);
                    step.adapt(rejected as f32 / 100.0, 0.1);
                    last += if t >= 500 { rejected as f32 / 1e4 } else { 0.0 };
                }
                (x, step, last)
            })
        };
        let (x, step, last) = run(1);
        assert_eq!(run(3), (x, step, last));
        assert!((0.05..0.2).contains(&last), "{last} rejected at step {}", step.size);
    }

    /// Where the energy is not a number nothing moves.
    #[test]
    fn what_is_not_a_number_is_rejected() {
        let normal = Normal([f32::NAN; 3]);
        let mut x = vec![1.0; 6];
        let rejected =
            transition(&normal, &mut x, 3, (2, 0.1), |r| Streams::new(1, 0).rng(r as u64), &mut Work::default());
        assert_eq!((rejected, x), (2, vec![1.0; 6]));
    }
}
