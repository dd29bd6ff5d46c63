//! Small machines against enumeration of their hidden states and finite differences; what training promises.

use super::energy::Scratch;
use super::hmc::Potential;
use super::recipe::Pooling;
use super::*;
use foveate::learn::rbm::Metadata;
use foveate::learn::training::{Training, interrupted};
use foveate::rng::Streams;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use std::path::Path;

const SIZES: Sizes = Sizes { white: 5, factors: 6, covariance: 4, mean: 3 };

fn small() -> Parameters {
    let mut rng = Streams::new(11, 0).rng(0);
    let mut draw = |n: usize, scale: f32| (0..n).map(|_| scale * (2.0 * rng.random::<f32>() - 1.0)).collect::<Vec<_>>();
    let Sizes { white, factors, covariance, mean } = SIZES;
    Parameters {
        filters: draw(white * factors, 1.5),
        pooling: draw(factors * covariance, 1.0).into_iter().map(f32::abs).collect(),
        covariance_bias: draw(covariance, 2.0),
        weights: draw(white * mean, 1.0),
        mean_bias: draw(mean, 1.0),
        visible_bias: draw(white, 1.0),
    }
}

const X: [f64; 10] = [0.3, -1.2, 2.0, 0.1, -0.6, 1.5, 0.7, 0.0, -2.5, 0.4];

fn narrow(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() < tolerance, "{a} is not {b}");
}

#[test]
fn conditionals_and_free_energy_are_those_of_the_joint() {
    let machine = small();
    let model = FactoredRbm::new(Whitening::identity(5), machine.clone()).expect("good shapes");
    let (n_c, n) = (SIZES.covariance, SIZES.covariance + SIZES.mean);
    for x in X.chunks_exact(5) {
        let bit = |state: usize, j: usize| (state >> j & 1) as f64;
        let p: Vec<f64> = (0..1usize << n)
            .map(|h| {
                let h: Vec<f64> = (0..n).map(|j| bit(h, j)).collect();
                (-machine.energy(x, &h[..n_c], &h[n_c..])).exp()
            })
            .collect();
        let total: f64 = p.iter().sum();
        close(machine.free_energy(x), -total.ln(), 1e-9);
        close(model.free_energy(&narrow(x)), -total.ln(), 1e-5);
        let mut h = vec![0.0; n];
        model.features(Rows::new(&narrow(x), 5), Units::Both, RowsMut::new(&mut h, n));
        for (j, &got) in h.iter().enumerate() {
            let on = p.iter().enumerate().map(|(s, p)| p * bit(s, j)).sum::<f64>() / total;
            close(got.into(), if j < n_c { 1.0 - on } else { on }, 1e-6);
        }
        for (units, part) in [(Units::Covariance, &h[..n_c]), (Units::Mean, &h[n_c..])] {
            let mut h = vec![0.0; part.len()];
            model.features(Rows::new(&narrow(x), 5), units, RowsMut::new(&mut h, part.len()));
            assert_eq!(h, part);
        }
        // The energy as printed, without what free energy and features share.
        let r = (x.iter().map(|x| x * x).sum::<f64>() / 5.0 + 0.5).powf(-0.5);
        let (hc, hm) = ([1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 1.0]);
        let at = |values: &[f32], i: usize, j: usize, n: usize| f64::from(values[i * n + j]);
        let mut energy = 0.0;
        for (k, h) in hc.iter().enumerate() {
            for f in 0..6 {
                let u: f64 = (0..5).map(|i| at(&machine.filters, i, f, 6) * x[i] * r).sum();
                energy += 0.5 * h * at(&machine.pooling, f, k, 4) * u * u;
            }
            energy -= f64::from(machine.covariance_bias[k]) * h;
        }
        for (j, h) in hm.iter().enumerate() {
            let wx: f64 = (0..5).map(|i| x[i] * at(&machine.weights, i, j, 3)).sum();
            energy -= h * (f64::from(machine.mean_bias[j]) + wx);
        }
        energy += (0..5).map(|i| 0.5 * x[i] * x[i] - f64::from(machine.visible_bias[i]) * x[i]).sum::<f64>();
        close(machine.energy(x, &hc, &hm), energy, 1e-9);
    }
}

#[test]
fn gradients_are_those_of_the_free_energy() {
    let machine = small();
    let (mut scratch, mut gradient, mut energy) = (Scratch::default(), [0.0; 10], [0.0; 2]);
    machine.gradient(Rows::new(&narrow(&X), 5), &mut scratch, &mut gradient, Some(&mut energy));
    for (r, x) in X.chunks_exact(5).enumerate() {
        close(energy[r], machine.free_energy(x), 1e-5);
        for i in 0..5 {
            let at = |by: f64| {
                let mut x = x.to_vec();
                x[i] += by;
                machine.free_energy(&x)
            };
            close(gradient[5 * r + i].into(), (at(1e-5) - at(-1e-5)) / 2e-5, 1e-4);
        }
    }
    // In the parameters: the direction of a training step, −∂F/∂θ, from the same buffers.
    let s = &scratch;
    let x = narrow(&X);
    let sum = |left: &[f32], i: usize, width: usize, right: &[f32], j: usize, n: usize| -> f64 {
        (0..2).map(|r| f64::from(left[r * width + i]) * f64::from(right[r * n + j])).sum()
    };
    let half_squares: Vec<f32> = s.u.iter().map(|u| 0.5 * u * u).collect();
    type Pick = fn(&mut Parameters) -> &mut Vec<f32>;
    type Moved<'a> = &'a dyn Fn(usize) -> f64;
    let parts: [(Pick, usize, Moved<'_>); 6] = [
        (|p| &mut p.filters, 30, &|e| -sum(&s.hat, e / 6, 5, &s.pull, e % 6, 6)),
        (|p| &mut p.pooling, 24, &|e| -sum(&half_squares, e / 4, 6, &s.covariance, e % 4, 4)),
        (|p| &mut p.covariance_bias, 4, &|e| sum(&[1.0; 2], 0, 1, &s.covariance, e, 4)),
        (|p| &mut p.weights, 15, &|e| sum(&x, e / 3, 5, &s.mean, e % 3, 3)),
        (|p| &mut p.mean_bias, 3, &|e| sum(&[1.0; 2], 0, 1, &s.mean, e, 3)),
        (|p| &mut p.visible_bias, 5, &|e| sum(&[1.0; 2], 0, 1, &x, e, 5)),
    ];
    for (pick, n, moved) in parts {
        for e in 0..n {
            let at = |by: f32| {
                let mut machine = machine.clone();
                let value = &mut pick(&mut machine)[e];
                let before = *value;
                *value += by;
                let moved = f64::from(*value) - f64::from(before);
                (X.chunks_exact(5).map(|x| machine.free_energy(x)).sum::<f64>(), moved)
            };
            let ((up, a), (down, b)) = (at(1e-3), at(-1e-3));
            close(moved(e), -(up - down) / (a - b), 2e-4);
        }
    }
}

/// Rows of pairs that share a random size, so that their squares go together though they are not correlated.
fn rows(n: usize) -> Vec<f32> {
    let mut rng = Streams::new(4, 0).rng(0);
    (0..n)
        .flat_map(|_| {
            let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
            let (a, b) = (normal().exp(), normal().exp());
            [a * normal(), a * normal(), b * normal(), b * normal(), normal(), normal()]
        })
        .collect()
}

fn recipe() -> Recipe {
    let learn_pooling = Some(2);
    Recipe {
        epochs: 4,
        batch: 16,
        leapfrog_steps: 5,
        settle: 1,
        learn_pooling,
        pooling: Pooling::Grid,
        keep: 1.0,
        ..Recipe::new(16, 7)
    }
}

#[test]
fn a_resumed_training_ends_with_the_same_bits_for_any_number_of_threads() {
    let data = rows(100);
    let rows = Rows::new(&data, 6);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.checkpoint");
    for negative in [Negative::Contrastive, Negative::Persistent] {
        let recipe = Recipe { negative, ..recipe() };
        let mut whole = Trainer::new(recipe.clone(), rows).expect("good rows");
        while !whole.is_done() {
            whole.step(rows);
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
        let cut: Trainer = pool.install(|| interrupted(&recipe, rows, 3, &path)).expect("good rows");
        assert_eq!((cut.learned(), cut.progress(), cut.leapfrog()), (whole.learned(), (4, 0), whole.leapfrog()));
        assert_eq!(cut.chains, whole.chains);
    }
}

#[test]
fn normalisations_hold_after_every_step() {
    let data = rows(200);
    let mut trainer = Trainer::new(recipe(), Rows::new(&data, 6)).expect("good rows");
    let sizes = trainer.learned().sizes();
    assert_eq!(sizes, Sizes { white: 6, factors: 16, covariance: 4, mean: 7 });
    let first = trainer.parameters.pooling.clone();
    let column = |values: &[f32], j: usize, n: usize| values.iter().skip(j).step_by(n).copied().collect::<Vec<_>>();
    // Every unit pools nine factors, and no two the same.
    for k in 0..4 {
        assert_eq!(column(&first, k, 4).iter().filter(|p| **p > 0.0).count(), 9);
        assert!((0..k).all(|other| column(&first, k, 4) != column(&first, other, 4)));
    }
    while !trainer.is_done() {
        let before = trainer.length;
        trainer.step(Rows::new(&data, 6));
        let p = &trainer.parameters;
        let lengths: Vec<f32> =
            (0..16).map(|f| column(&p.filters, f, 16).iter().map(|c| c * c).sum::<f32>().sqrt()).collect();
        assert!(lengths.iter().all(|l| (l / trainer.length - 1.0).abs() < 1e-5), "{lengths:?}, {}", trainer.length);
        assert!((trainer.length / before - 1.0).abs() < 0.05, "the common length moves slowly");
        assert!(p.pooling.iter().all(|p| *p >= 0.0));
        for k in 0..4 {
            close(column(&p.pooling, k, 4).into_iter().map(f64::from).sum(), 1.0, 1e-5);
        }
        assert_eq!(p.pooling == first, trainer.progress() <= (2, 0), "P is learned from epoch 2 on");
    }
}

/// Rows with pairs of a common size: the machine prefers them to rows with the same numbers recombined.
#[test]
fn training_learns_what_goes_together() {
    let data = rows(3000);
    let all = Rows::new(&data, 6);
    let recipe = Recipe { epochs: 20, batch: 50, settle: 20, keep: 1.0, rate: 0.2, ..Recipe::new(24, 2) };
    let mut trainer = Trainer::new(recipe, all).expect("good rows");
    let shuffled: Vec<f32> = (0..data.len()).map(|e| data[(e / 6 + 500 * (e % 6)) % 3000 * 6 + e % 6]).collect();
    let gap = |model: &FactoredRbm| -> f64 {
        let mean = |data: &[f32]| data.chunks_exact(6).map(|v| model.free_energy(v)).sum::<f64>() / 3000.0;
        mean(&shuffled) - mean(&data)
    };
    let before = gap(&trainer.learned());
    while !trainer.is_done() {
        trainer.step(all);
    }
    let learned = gap(&trainer.learned());
    assert!(learned > 2.0 * before.abs(), "free energies of shuffled rows: higher by {before}, then by {learned}");
}

#[test]
fn features_of_a_row_do_not_depend_on_its_neighbours() {
    let data = rows(300);
    let mut trainer = Trainer::new(recipe(), Rows::new(&data, 6)).expect("good rows");
    trainer.step(Rows::new(&data, 6));
    let model = trainer.learned();
    let n = model.width(Units::Both);
    let features = |rows: &[f32]| {
        let mut h = vec![f32::NAN; rows.len() / 6 * n];
        model.features(Rows::new(rows, 6), Units::Both, RowsMut::new(&mut h, n));
        h
    };
    let all = features(&data);
    for (v, h) in data.chunks(6 * 7).zip(all.chunks(n * 7)) {
        assert_eq!(features(v), h);
    }
    assert!(all.iter().all(|h| (0.0..=1.0).contains(h)));
}

fn model() -> (FactoredRbm, Metadata, Vec<u8>) {
    let model = FactoredRbm::new(Whitening::identity(5), small()).expect("good shapes");
    let metadata = Metadata { retina: "{}".into(), seed: u64::MAX, ..Default::default() };
    let bytes = model.to_bytes(&metadata);
    (model, metadata, bytes)
}

#[test]
fn models_come_back_and_what_is_not_one_is_refused() {
    let (model, metadata, bytes) = model();
    let path = Path::new("m.safetensors");
    assert_eq!(FactoredRbm::from_bytes(&bytes, path).expect("just made"), (model.clone(), metadata.clone()));
    let why = |bytes: &[u8]| FactoredRbm::from_bytes(bytes, path).expect_err("refused").to_string();
    let rbm =
        foveate::learn::rbm::Rbm::new(foveate::learn::rbm::Visible::Gaussian, vec![0.5; 6], vec![0.0; 2], vec![0.0; 3]);
    let other = rbm.expect("finite").to_bytes(&metadata);
    assert!(why(&other).contains("kind \"rbm\"") && why(&other).contains("train mcrbm"), "{}", why(&other));
    let mut bent = bytes.clone();
    *bent.last_mut().expect("not empty") ^= 1;
    assert!(why(&bent).contains("checksum") || why(&bent).contains("finite"), "{}", why(&bent));
    let mut negative = model.clone();
    negative.parameters.pooling[3] = -1.0;
    assert!(why(&negative.to_bytes(&metadata)).contains("not negative"));
    let mut short = model;
    short.parameters.weights.pop();
    assert!(FactoredRbm::new(short.whitening, short.parameters).is_err());
}

#[test]
fn checkpoints_of_something_else_and_wrong_recipes_are_refused() {
    let data = rows(40);
    let rows = Rows::new(&data, 6);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.checkpoint");
    let mut trainer = Trainer::new(recipe(), rows).expect("good rows");
    trainer.step(rows);
    trainer.save(&path, "abc").expect("a writable folder");
    let why = |recipe: Recipe, sha: &str| Trainer::resume(&path, recipe, rows, sha).expect_err("refused").to_string();
    assert!(why(recipe(), "def").contains("other data"));
    assert!(why(Recipe { leapfrog_steps: 6, ..recipe() }, "abc").contains("it was begun as"));
    assert!(Trainer::resume(&path, Recipe { epochs: 99, ..recipe() }, rows, "abc").is_ok());
    let bytes = std::fs::read(&path).expect("just written");
    for cut in (0..bytes.len()).step_by(97) {
        std::fs::write(&path, &bytes[..cut]).expect("a writable folder");
        assert!(why(recipe(), "abc").contains("c.checkpoint"));
    }
    for wrong in [
        Recipe { factors: 0, ..recipe() },
        Recipe { factors: 15, ..recipe() },
        Recipe { keep: 0.0, ..recipe() },
        Recipe { rate: f32::NAN, ..recipe() },
        Recipe { rejection: 1.0, ..recipe() },
        Recipe { leapfrog_steps: 0, ..recipe() },
        Recipe { batch: 41, ..recipe() },
    ] {
        assert!(Trainer::new(wrong.clone(), rows).is_err(), "{wrong:?}");
    }
    let mut wild = Trainer::new(Recipe { rate: 1e30, ..recipe() }, rows).expect("finite");
    while !wild.is_done() {
        wild.step(rows);
    }
    let message = wild.save(Path::new("no/such/folder"), "").expect_err("diverged").to_string();
    assert!(message.contains("diverged"), "{message}");
}

/// 300 damaged files. None may panic, and none may pass for a model it is not.
#[test]
fn damaged_files_never_panic_and_never_pass() {
    let (good, metadata, bytes) = model();
    for seed in 0..300 {
        if let Ok(read) = FactoredRbm::from_bytes(&foveate_testing::damaged(&bytes, &[], seed), Path::new("m")) {
            assert_eq!(read, (good.clone(), metadata.clone()), "{seed}");
        }
    }
}
