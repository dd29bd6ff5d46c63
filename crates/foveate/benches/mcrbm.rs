//! A training step of the factored RBM beside a large matrix product, one thread: 160 values before whitening, 256 factors, 256
//! covariance and 100 mean units, batch 128, 20 leapfrog steps.
//!
//! `cargo bench -p foveate --features lab --bench mcrbm -- [rounds]`.
//! One JSON line a round: operations of the products alone (two for each
//! multiplication) over all the time of a step, the rate of one large product in the same seconds, and their ratio.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use foveate::learn::rbm::factored::{Recipe, Sizes, Trainer};
use foveate::rows::Rows;

mod clock;

use clock::seconds;

/// Side of the large product.
const SIDE: usize = 512;
/// Steps, and products, between two looks at the clock.
const STEPS: usize = 20;
const PRODUCTS: usize = 40;

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(7);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    pool.install(|| run(rounds));
}

fn run(rounds: usize) {
    // Noise with some directions weak, as glimpses have them.
    let noise = |i: usize| ((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
    let rows: Vec<f32> = (0..20_000 * 160).map(|i| noise(i) * if i % 160 < 130 { 1.0 } else { 0.01 }).collect();
    let recipe = Recipe { settle: 0, learn_pooling: Some(0), epochs: usize::MAX, ..Recipe::new(256, 100) };
    let (batch, leapfrog) = (recipe.batch as f64, recipe.leapfrog_steps as f64);
    let mut trainer = Trainer::new(recipe, Rows::new(&rows, 160)).expect("rows that vary");
    let Sizes { white, factors, covariance, mean } = trainer.learned().sizes();
    let [x, f, c, m] = [white, factors, covariance, mean].map(|n| n as f64);
    let forward = 2.0 * (x * f + f * c + x * m);
    // Gradients on the way, hidden units and u ∘ P h of both phases, and the three outer products.
    let step = batch * ((leapfrog + 1.0) * 2.0 * forward + 2.0 * (forward + 2.0 * f * c) + 2.0 * forward);
    let product = 2.0 * (SIDE as f64).powi(3);

    let (a, b) = (Mat::from_fn(SIDE, SIDE, |i, j| noise(i * SIDE + j)), Mat::from_fn(SIDE, SIDE, |i, j| noise(i + j)));
    let mut out = Mat::zeros(SIDE, SIDE);
    let mut multiply = || matmul(out.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), 1.0, Par::Seq);
    (0..5).for_each(|_| trainer.step());
    multiply();
    let mut ratios = vec![];
    for _ in 0..rounds {
        let steps = STEPS as f64 * step / seconds(|| (0..STEPS).for_each(|_| trainer.step()));
        let products = PRODUCTS as f64 * product / seconds(|| (0..PRODUCTS).for_each(|_| multiply()));
        ratios.push(steps / products);
        println!(
            "{{\"what\": \"mcRBM step, {white} whitened\", \"gflops\": {:.1}, \"product_gflops\": {:.1}, \"ratio\": {:.3}}}",
            steps * 1e-9,
            products * 1e-9,
            steps / products
        );
    }
    ratios.sort_by(f64::total_cmp);
    println!("{{\"what\": \"median ratio\", \"ratio\": {:.3}}}", ratios[ratios.len() / 2]);
}
