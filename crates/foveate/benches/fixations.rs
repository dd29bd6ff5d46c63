//! A training step of the multi-fixation RBM beside the matrix products it is made of, one thread.
//!
//! `cargo bench -p foveate --features lab --bench fixations -- [rounds]`.
//! 500 features a fixation, 3 fixations, 250 factors, 500 hidden units, 10
//! classes, batch 100; pseudo-random data. Every round times the same number of multiplications as plain products of the
//! sizes the step has (the tall one alone would not be representative), and 1024 × 1024 × 1024 besides; shares are medians of the
//! rounds' own. One JSON line a figure.

use foveate::learn::rbm::fixations::{Code, Cost, Places, Recipe, Sequences, Trainer};
use foveate::learn::training::Training;
use foveate::rows::Rows;

mod clock;

use clock::seconds;

const N_V: usize = 500;
const FACTORS: usize = 250;
const HIDDEN: usize = 500;
const WINDOW: usize = 3;
const BATCH: usize = 100;

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(5);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    pool.install(|| run(rounds));
}

fn noise(n: usize) -> Vec<f32> {
    (0..n as u64).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / (1u64 << 24) as f32).collect()
}

/// The products of a step: (rows, inner, columns), and how many of each; see `rbm/fixations/gradient.rs`.
fn products(sequential: bool) -> Vec<((usize, usize, usize), usize)> {
    let n = BATCH * WINDOW;
    let m = if sequential { n } else { BATCH };
    vec![
        ((n, N_V, FACTORS), 2),        // Fᵀx of data and reconstruction
        ((n, FACTORS, N_V), 1),        // the reconstruction
        ((N_V, 2 * n, FACTORS), 1),    // ∂F
        ((m, FACTORS, HIDDEN), 2),     // up to h
        ((m, HIDDEN, FACTORS), 1),     // down from h
        ((2 * m, HIDDEN, FACTORS), 1), // ∂g
        ((FACTORS, 2 * m, HIDDEN), 1), // ∂P
    ]
}

fn run(rounds: usize) {
    let sequences = 10 * BATCH;
    let x = noise(sequences * WINDOW * N_V);
    let codes: Vec<Code> = (0..sequences * WINDOW).map(|i| Code::one_hot(i % 9)).collect();
    let labels: Vec<u8> = (0..sequences).map(|i| (i % 10) as u8).collect();
    let data = Sequences::new(Rows::new(&x, N_V), &codes, &labels, WINDOW).expect("they fit");
    let places = Places::grid(3, 0.5).expect("nine places");
    for (name, cost) in [("hybrid", Cost::Hybrid), ("hybrid-sequential", Cost::HybridSequential)] {
        let usual = Recipe::new(cost, WINDOW, 10, places.clone());
        let recipe = Recipe { hidden: HIDDEN, factors: FACTORS, batch: BATCH, epochs: 1000, ..usual };
        let mut trainer = Trainer::new(recipe, data).expect("they fit");
        trainer.epoch(data);
        let of_step = products(cost == Cost::HybridSequential);
        let operations: f64 = of_step.iter().map(|((m, k, n), times)| 2.0 * (m * k * n * times) as f64).sum();
        let (mut step, mut plain, mut cubes) = (vec![], vec![], vec![]);
        for _ in 0..rounds {
            step.push(seconds(|| trainer.epoch(data)) / 10.0);
            let mut spent = 0.0;
            for &((m, k, n), times) in &of_step {
                spent += seconds_of_product(m, k, n, 10 * times) / 10.0;
            }
            plain.push(spent);
            cubes.push(seconds_of_product(1024, 1024, 1024, 2) / 2.0 * operations / (2.0 * 1024f64.powi(3)));
        }
        // Each: seconds that the step's operations take. How much of a rate is reached: a step's seconds in theirs.
        let share = |of: &[f64]| median(of.iter().zip(&step).map(|(of, step)| of / step).collect());
        let (share, share_of_cube) = (share(&plain), share(&cubes));
        let (step, plain, cube) = (median(step), median(plain), median(cubes));
        println!(
            "{{\"what\": \"step, {name}\", \"s\": {step:.6}, \"gflop_per_s\": {:.1}, \"its_products_gflop_per_s\": {:.1}, \"share_of_their_rate\": {share:.3}, \"gemm_1024_gflop_per_s\": {:.1}, \"share_of_that\": {:.3}}}",
            operations / step * 1e-9,
            operations / plain * 1e-9,
            operations / cube * 1e-9,
            share_of_cube
        );
    }
}

fn seconds_of_product(m: usize, k: usize, n: usize, times: usize) -> f64 {
    use faer::linalg::matmul::matmul;
    use faer::{Accum, MatMut, MatRef, Par};
    let (a, b, mut c) = (noise(m * k), noise(k * n), vec![0.0; m * n]);
    let (a, b) = (MatRef::from_row_major_slice(&a, m, k), MatRef::from_row_major_slice(&b, k, n));
    let mut product = || matmul(MatMut::from_row_major_slice_mut(&mut c, m, n), Accum::Replace, a, b, 1.0, Par::Seq);
    product();
    seconds(|| (0..times).for_each(|_| product()))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
