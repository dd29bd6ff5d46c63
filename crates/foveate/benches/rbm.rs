//! Training an RBM and using it, one thread: 784 → 500, batch 100, CD-1, the figures of one epoch of 60,000 binary rows.
//!
//! `cargo bench -p foveate --features lab --bench rbm -- [rounds]`,
//! with MNIST under $FOVEATE_DATA/mnist or data/mnist; without it, random bits (a
//! time, but nothing to learn). One JSON line a figure; seconds are those of the CPU if the system counts them.

use foveate::learn::rbm::{Negative, Recipe, Trainer, Visible, monitor};
use foveate::learn::training::Training;
use foveate::rows::{Rows, RowsMut};
use std::io::Read;
use std::path::PathBuf;

mod clock;

use clock::seconds;

const N_V: usize = 784;
const N_H: usize = 500;

fn main() {
    let rounds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(5);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    pool.install(|| run(rounds));
}

fn run(rounds: usize) {
    let dir = std::env::var_os("FOVEATE_DATA").map_or_else(|| PathBuf::from("data"), PathBuf::from).join("mnist");
    let read = |name: &str| -> Option<Vec<f32>> {
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(std::fs::File::open(dir.join(name)).ok()?).read_to_end(&mut bytes).ok()?;
        Some(bytes[16..].iter().map(|&x| f32::from(u8::from(x > 127))).collect())
    };
    let bits = |n: u64| {
        (0..n * N_V as u64).map(|i| f32::from(u8::from(i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61 == 0))).collect()
    };
    let train = read("train-images-idx3-ubyte.gz");
    let what = if train.is_some() { "MNIST, threshold 127" } else { "pseudo-random bits" };
    let train = train.unwrap_or_else(|| bits(60_000));
    let test = read("t10k-images-idx3-ubyte.gz").unwrap_or_else(|| bits(1000));
    let (train, test) = (Rows::new(&train, N_V), Rows::new(&test, N_V));
    let recipe = Recipe { momentum: 0.0, l2: 0.0, epochs: 1, rate: 0.1, ..Recipe::new(Visible::Bernoulli, N_H) };

    let piece = Rows::new(&train.data()[..6000 * N_V], N_V);
    for (name, negative) in
        [("CD-1", Negative::Contrastive { steps: 1 }), ("SML-1", Negative::Persistent { chains: 100, steps: 1 })]
    {
        let mut trainer = Trainer::new(Recipe { negative, ..recipe.clone() }, piece).expect("the data are bits");
        trainer.epoch(piece);
        let seconds: Vec<f64> = (0..rounds).map(|_| 10.0 * seconds(|| trainer.epoch(piece))).collect();
        report(&format!("train {name}, 784-500, batch 100, 60000 rows"), what, "s_per_epoch", &seconds);
    }
    let mut trainer =
        Trainer::new(Recipe { momentum: 0.9, l2: 2e-4, ..recipe.clone() }, piece).expect("the data are bits");
    let with: Vec<f64> = (0..rounds).map(|_| 10.0 * seconds(|| trainer.epoch(piece))).collect();
    report("train CD-1 with momentum and decay", what, "s_per_epoch", &with);

    let rbm = trainer.learned();
    let mut h = vec![0.0; 1000 * N_H];
    for n in [1, 100, 1000] {
        let v = Rows::new(&train.data()[..n * N_V], N_V);
        let mut encode = || rbm.h_from_v(v, RowsMut::new(&mut h[..n * N_H], N_H));
        // The system counts CPU time in milliseconds.
        let times = 100_000 / (n + 9);
        let all: Vec<f64> = (0..rounds).map(|_| seconds(|| (0..times).for_each(|_| encode())) / times as f64).collect();
        report(&format!("hidden probabilities, {n} rows at once"), what, "s", &all);
    }

    for (order, shuffle) in [("the data's order, as rbm.py", false), ("shuffled", true)] {
        let mut trainer = Trainer::new(Recipe { shuffle, ..recipe.clone() }, train).expect("the data are bits");
        let s = seconds(|| trainer.epoch(train));
        let rbm = trainer.learned();
        let pseudo = monitor::pseudo_log_likelihood(&rbm, Rows::new(&test.data()[..500 * N_V], N_V));
        println!(
            "{{\"what\": \"one whole epoch, {order}\", \"data\": \"{what}\", \"s\": {s:.3}, \"pseudo_log_likelihood\": {:.3}, \"reconstruction\": {:.3}}}",
            pseudo.expect("binary units"),
            monitor::reconstruction_error(&rbm, test),
        );
    }
}

fn report(what: &str, data: &str, unit: &str, values: &[f64]) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    println!(
        "{{\"what\": \"{what}\", \"data\": \"{data}\", \"{unit}\": {:.6}, \"best\": {:.6}, \"rounds\": {}}}",
        sorted[sorted.len() / 2],
        sorted[0],
        sorted.len()
    );
}
