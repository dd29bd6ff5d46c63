//! Machines so small that all their states can be counted: energies, conditionals, classes, gradients, learning.

use super::gradient::{Work, gradient};
use super::parameters::{Parameters, Shape};
use super::*;
use crate::training::{Training, interrupted};
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::Rows;
use rand::RngExt;

const SHAPE: Shape = Shape { n_v: 3, factors: 4, hidden: 5, places: 4, classes: 3 };
const WINDOW: usize = 2;

fn random(shape: Shape, seed: u64) -> Parameters {
    let mut rng = Streams::new(seed, 0).at(0, Purpose::Train).rng(0);
    let mut p = Parameters::zeros(shape);
    p.all_mut().into_iter().flatten().for_each(|x| *x = 2.0 * rng.random::<f32>() - 1.0);
    p
}

fn machine(shape: Shape, seed: u64) -> FixationRbm {
    FixationRbm::new(shape, random(shape, seed), vec![0.3, -0.2, 0.6], places(), WINDOW).expect("finite")
}

/// All vectors of n bits.
fn bits(n: usize) -> impl Iterator<Item = Vec<f32>> {
    (0..1u32 << n).map(move |i| (0..n).map(|b| (i >> b & 1) as f32).collect())
}

/// A place, and a point between places.
fn codes(rbm: &FixationRbm) -> [Code; WINDOW] {
    [Code::one_hot(2), rbm.places().code(0.1, -0.35)]
}

fn log_sum(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + values.iter().map(|v| (v - most).exp()).sum::<f64>().ln()
}

#[test]
fn free_energy_classes_and_hidden_units_are_those_of_all_states() {
    for seed in 0..4 {
        let rbm = machine(SHAPE, seed);
        let z = codes(&rbm);
        for x in bits(SHAPE.n_v * WINDOW) {
            let x = Rows::new(&x, SHAPE.n_v);
            let of = |h: &[f32], l| -rbm.energy(x, &z, h, Some(l));
            let free: Vec<f64> = (0..3).map(|l| -log_sum(bits(5).map(|h| of(&h, l)))).collect();
            for (l, free) in free.iter().enumerate() {
                assert!((rbm.free_energy(x, &z, Some(l)) - free).abs() < 1e-9);
            }
            let norm = log_sum(free.iter().map(|f| -f));
            for (log_p, free) in rbm.log_posterior(x, &z, WINDOW).iter().zip(&free) {
                assert!((log_p - (-free - norm)).abs() < 1e-5, "p(y | x) is exact");
            }
            // p(h | x) as the paper has it: of the machine without its classes.
            let bare = FixationRbm { shape: Shape { classes: 0, ..SHAPE }, ..rbm.clone() };
            let all: Vec<(Vec<f32>, f64)> = bits(5).map(|h| (h.clone(), -bare.energy(x, &z, &h, None))).collect();
            let norm = log_sum(all.iter().map(|a| a.1));
            for (j, p) in rbm.hidden_probabilities(x, &z, WINDOW).iter().enumerate() {
                let exact: f64 = all.iter().map(|(h, e)| f64::from(h[j]) * (e - norm).exp()).sum();
                assert!((f64::from(*p) - exact).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn a_reading_equals_whole_sequences_and_drops_old_glimpses() {
    let rbm = machine(SHAPE, 9);
    let mut rng = Streams::new(1, 0).rng(0);
    let x: Vec<f32> = (0..6 * SHAPE.n_v).map(|_| rng.random()).collect();
    let z: Vec<Code> = (0..6).map(|_| rbm.places().code(rng.random(), rng.random())).collect();
    let mut reading = rbm.reading();
    for k in 0..6 {
        reading.fixate(&rbm, &x[k * 3..][..3], z[k]);
        let from = (k + 1).saturating_sub(WINDOW);
        let (now, codes) = (Rows::new(&x[from * 3..(k + 1) * 3], 3), &z[from..=k]);
        let (mut log_p, mut h) = ([0.0; 3], [0.0; 5]);
        reading.log_posterior(&rbm, &mut log_p);
        reading.hidden_probabilities(&rbm, &mut h);
        assert_eq!(reading.count(), codes.len());
        for (a, b) in log_p.iter().zip(rbm.log_posterior(now, codes, codes.len())) {
            assert!((a - b).abs() < 1e-5);
        }
        for (a, b) in h.iter().zip(rbm.hidden_probabilities(now, codes, codes.len())) {
            assert!((a - b).abs() < 1e-6);
        }
    }
    reading.clear();
    assert_eq!(reading.count(), 0);
}

/// The gradient that training takes is that of log p(y | x) and of the free energies of data and reconstruction.
#[test]
fn gradients_are_those_of_finite_differences() {
    for (cost, classes) in
        [(Cost::Hybrid, 3), (Cost::HybridSequential, 3), (Cost::Generative, 0), (Cost::Generative, 3)]
    {
        let shape = Shape { classes, ..SHAPE };
        let recipe = Recipe { hidden: 5, factors: 4, alpha: 0.7, ..Recipe::new(cost, WINDOW, classes, places()) };
        let rbm = machine(shape, 3);
        let n = 70;
        let mut rng = Streams::new(2, 0).rng(0);
        let x: Vec<f32> = (0..n * WINDOW * 3).map(|_| rng.random()).collect();
        let z: Vec<Code> = (0..n * WINDOW).map(|_| rbm.places().code(rng.random(), rng.random())).collect();
        let y: Vec<u8> = if classes == 0 { vec![] } else { (0..n).map(|i| (i % 3) as u8).collect() };
        let mut work = Work::default();
        let centred = x.iter().enumerate().map(|(i, x)| x - rbm.offset[i % 3]).collect();
        (work.x, work.codes, work.labels) = (centred, z.clone(), y.clone());
        let mut found = Parameters::zeros(shape);
        let stream = |m: usize| Streams::new(5, 0).rng(m as u64);
        let machine = (shape, &rbm.parameters, &*rbm.parameters.gates, &*rbm.offset);
        let tally = gradient(machine, &recipe, &stream, &mut work, &mut found);

        // Minus the cost, with the reconstruction held.
        let (sharp, soft) = recipe.shares();
        let dreamt: Vec<f32> = (n * WINDOW * 3..work.x.len()).map(|i| work.x[i] + rbm.offset[i % 3]).collect();
        let value = |p: Parameters| -> f64 {
            let rbm = FixationRbm::new(shape, p, rbm.offset.clone(), rbm.places.clone(), WINDOW).expect("finite");
            let mut sum = 0.0;
            for i in 0..n {
                let label = (classes > 0).then(|| usize::from(y[i]));
                let lengths = if recipe.sequential() { 1..=WINDOW } else { WINDOW..=WINDOW };
                for k in lengths {
                    let z = &z[i * WINDOW..][..k];
                    let row = |x: &[f32], k: usize| x[(i * WINDOW + k) * 3..][..3].to_vec();
                    let seen: Vec<f32> = (0..k).flat_map(|k| row(&x, k)).collect();
                    let kept = if recipe.sequential() { k - 1 } else { 0 };
                    let dream: Vec<f32> = (0..k).flat_map(|k| row(if k < kept { &x } else { &dreamt }, k)).collect();
                    let m = if recipe.sequential() { i * WINDOW + k - 1 } else { i };
                    let fantasy = (classes > 0).then(|| usize::from(work.fantasy[m]));
                    let free = |x: &[f32], l| rbm.free_energy(Rows::new(x, 3), z, l);
                    if sharp > 0.0 {
                        let all = log_sum((0..classes).map(|l| -free(&seen, Some(l))));
                        sum += f64::from(sharp) * (-free(&seen, label) - all);
                    }
                    sum += f64::from(soft) * (free(&dream, fantasy) - free(&seen, label));
                }
            }
            sum
        };
        for part in 0..7 {
            let size = found.all()[part].len();
            for i in (0..size).step_by(1 + size / 7) {
                let moved = |by: f32| {
                    let mut p = rbm.parameters.clone();
                    p.all_mut()[part][i] += by;
                    (f64::from(p.all()[part][i]), value(p))
                };
                let ((x0, f0), (x1, f1)) = (moved(-1e-3), moved(1e-3));
                let (exact, found) = ((f1 - f0) / (x1 - x0), f64::from(found.all()[part][i]));
                assert!((exact - found).abs() < 2e-3 * (1.0 + exact.abs()), "{cost:?} {part} {i}: {exact} {found}");
            }
        }
        if classes > 0 {
            let log_p = rbm.log_posterior(Rows::new(&x, 3), &z, WINDOW);
            let sum: f64 = y.iter().zip(log_p.chunks_exact(3)).map(|(&y, q)| q[usize::from(y)]).sum();
            assert!((tally.log_posterior - sum).abs() < 1e-3 && tally.wrong <= n);
        }
    }
}

/// Sequences of two glimpses of one of three patterns, of which each place shows a part.
fn patterns(n: usize, seed: u64) -> (Vec<f32>, Vec<Code>, Vec<u8>) {
    let mut rng = Streams::new(seed, 0).rng(0);
    let (mut x, mut z, mut y) = (vec![], vec![], vec![]);
    for _ in 0..n {
        let class = rng.random_range(0..3usize);
        for _ in 0..WINDOW {
            let place = rng.random_range(0..4usize);
            x.extend((0..3).map(|i| f32::from(u8::from((i + place) % 3 == class))));
            z.push(Code::one_hot(place));
        }
        y.push(class as u8);
    }
    (x, z, y)
}

fn places() -> Places {
    Places::grid(2, 0.5).expect("four places")
}

fn recipe(cost: Cost, classes: usize) -> Recipe {
    Recipe {
        hidden: 12,
        factors: 12,
        epochs: 30,
        batch: 20,
        rate: 0.02,
        ..Recipe::new(cost, WINDOW, classes, places())
    }
}

#[test]
fn learning_finds_the_classes_and_raises_the_exact_likelihood() {
    let (x, z, y) = patterns(300, 1);
    for cost in [Cost::Hybrid, Cost::HybridSequential, Cost::Generative] {
        let data = Sequences::new(Rows::new(&x, 3), &z, &y, WINDOW).expect("they fit");
        let mut trainer = Trainer::new(recipe(cost, 3), data).expect("they fit");
        // log p(x, y) of some of the data, every normaliser by all states.
        let likelihood = |rbm: &FixationRbm| -> f64 {
            let log_p = |i: usize| {
                let z = &z[i * WINDOW..][..WINDOW];
                let free = |x: &[f32], l: usize| -rbm.free_energy(Rows::new(x, 3), z, Some(l));
                let all = bits(6).flat_map(|x| (0..3).map(move |l| (x.clone(), l)));
                free(&x[i * 6..][..6], usize::from(y[i])) - log_sum(all.map(|(x, l)| free(&x, l)))
            };
            (0..20).map(log_p).sum::<f64>() / 20.0
        };
        let before = likelihood(&trainer.learned().expect("finite"));
        while !trainer.is_done() {
            trainer.epoch(data);
        }
        let (log_p, wrong) = trainer.take_tally();
        assert!(log_p.is_finite() && wrong < 0.7 && trainer.take_tally().0.is_nan());
        let rbm = trainer.learned().expect("finite");
        let after = likelihood(&rbm);
        assert!(after > before + 1.0, "{cost:?}: {before} to {after} nats");
        let (x, z, y) = patterns(200, 2);
        let log_p = rbm.log_posterior(Rows::new(&x, 3), &z, WINDOW);
        let right = y.iter().zip(log_p.chunks_exact(3)).filter(|(y, q)| q[usize::from(**y)] > (0.5f64).ln()).count();
        assert!(right >= 190, "{cost:?}: {right} of 200");
    }
}

#[test]
fn resumed_training_ends_with_the_same_bits_for_any_number_of_threads() {
    let (x, z, y) = patterns(90, 3);
    let data = Sequences::new(Rows::new(&x, 3), &z, &y, WINDOW).expect("they fit");
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.checkpoint");
    for (cost, gates) in [(Cost::HybridSequential, Gates::Logistic), (Cost::Hybrid, Gates::Linear)] {
        let recipe = Recipe { epochs: 3, gates, ..recipe(cost, 3) };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut whole = Trainer::new(recipe.clone(), data).expect("they fit");
            pool.install(|| (0..3).for_each(|_| whole.epoch(data)));
            whole.learned().expect("finite")
        };
        let whole = run(1);
        assert!(whole == run(3), "threads change nothing");
        let cut: Trainer = interrupted(&recipe, data, 2, &path).expect("they fit");
        assert!(cut.learned().expect("finite") == whole);
        let why = |recipe: &Recipe, sha: &str| {
            Trainer::resume(&path, recipe.clone(), data, sha).expect_err("refused").to_string()
        };
        assert!(why(&recipe, "def").contains("other data"));
        assert!(why(&Recipe { alpha: 9.0, ..recipe.clone() }, "abc").contains("it was begun as"));
        let bytes = std::fs::read(&path).expect("just written");
        for cut in (0..bytes.len()).step_by(997) {
            std::fs::write(&path, &bytes[..cut]).expect("a writable folder");
            assert!(why(&recipe, "abc").contains("c.checkpoint"));
        }
    }
}

#[test]
fn models_come_back_from_files_and_damaged_ones_are_refused() {
    let about = About { metadata: Default::default(), first_layer: "12ab".into(), temperature: 1.5 };
    for classes in [3, 0] {
        let shape = Shape { classes, ..SHAPE };
        let rbm = machine(shape, 7);
        let path = std::path::Path::new("m.safetensors");
        let bytes = rbm.to_bytes(&about);
        let (back, kept) = FixationRbm::from_bytes(&bytes, path).expect("whole");
        assert!(back == rbm && kept == about && back.to_bytes(&about) == bytes);
        for cut in 0..bytes.len() {
            assert!(FixationRbm::from_bytes(&bytes[..cut], path).is_err());
        }
        for i in (0..bytes.len()).step_by(3) {
            let mut damaged = bytes.clone();
            damaged[i] ^= 1 << (i % 8);
            assert!(FixationRbm::from_bytes(&damaged, path).is_err(), "byte {i}");
        }
    }
}

/// Four terabytes, by the product of the shapes of two small tensors.
#[test]
fn claimed_shapes_are_not_allocated() {
    let about = About { metadata: Default::default(), first_layer: String::new(), temperature: 1.0 };
    let rbm = machine(SHAPE, 7);
    let file = super::io::File { window: 2, places: rbm.places.clone(), about };
    let long = vec![0.0; 1 << 20];
    let tensors = [("filters", vec![1, 1 << 20], &long), ("pooling", vec![1, 1 << 20], &long)];
    let bytes = super::super::io::pack(
        "fixations",
        file,
        &tensors.each_ref().map(|(name, shape, values)| (*name, shape.clone(), &values[..])),
    );
    let error =
        FixationRbm::from_bytes(&bytes, std::path::Path::new("m.safetensors")).expect_err("impossible").to_string();
    assert!(error.contains("tensor"), "{error}");
}

#[test]
fn recipes_and_data_that_cannot_be_are_refused() {
    let good = recipe(Cost::Hybrid, 3);
    for (bad, word) in [
        (Recipe { hidden: 0, ..good.clone() }, "at least 1"),
        (Recipe { classes: 1, ..good.clone() }, "two classes"),
        (Recipe { alpha: f32::NAN, ..good.clone() }, "alpha"),
        (Recipe { average: 1.0, ..good.clone() }, "mean"),
        (Recipe { window: 999, ..good.clone() }, "256 fixations"),
    ] {
        assert!(bad.check().expect_err("bad").to_string().contains(word));
    }
    let (x, z, y) = patterns(10, 1);
    let rows = Rows::new(&x, 3);
    assert!(Sequences::new(rows, &z[1..], &y, WINDOW).is_err() && Sequences::new(rows, &z, &y[1..], WINDOW).is_err());
    assert!(Sequences::new(Rows::new(&[2.0; 60], 3), &z, &y, WINDOW).is_err(), "values beyond 1");
    let data = Sequences::new(rows, &z, &y, WINDOW).expect("they fit");
    let few = Places::grid(1, 0.5).expect("one place");
    assert!(
        Trainer::new(Recipe { places: few, ..good.clone() }, data)
            .expect_err("four places")
            .to_string()
            .contains("does not fit")
    );
    let two = Recipe { classes: 2, ..good };
    assert!(Trainer::new(two, data).is_err(), "a label of 2");
}

/// A diverging training is an error.
#[test]
fn divergence_is_an_error() {
    let (x, z, y) = patterns(40, 1);
    let data = Sequences::new(Rows::new(&x, 3), &z, &y, WINDOW).expect("they fit");
    let wild = Recipe { rate: 1e30, ..recipe(Cost::Hybrid, 3) };
    let mut trainer = Trainer::new(wild, data).expect("they fit");
    trainer.epoch(data);
    trainer.epoch(data);
    assert!(trainer.learned().expect_err("diverged").to_string().contains("lower rate"));
}
