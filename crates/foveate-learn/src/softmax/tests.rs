use super::*;
use foveate_base::rng::Streams;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Rows whose classes are drawn from a known model of three classes and four inputs.
pub(super) fn drawn(n: usize, seed: u64) -> (Vec<f32>, Vec<u8>, Vec<f64>) {
    let mut rng = Streams::new(seed, 0).rng(0);
    let truth: Vec<f64> = (0..12).map(|i| 1.5 * f64::from(i).sin()).collect();
    let (mut rows, mut labels) = (vec![], vec![]);
    for _ in 0..n {
        let x: Vec<f32> = (0..4).map(|_| StandardNormal.sample(&mut rng)).collect();
        let mut q: Vec<f64> = (0..3).map(|l| (0..4).map(|i| f64::from(x[i]) * truth[i * 3 + l]).sum()).collect();
        normalize(&mut q);
        let mut left: f64 = rng.random();
        let label = q.iter().position(|q| {
            left -= q.exp();
            left < 0.0
        });
        labels.push(label.unwrap_or(2) as u8);
        rows.extend(x);
    }
    (rows, labels, truth)
}

#[test]
fn it_finds_the_model_that_drew_the_data() {
    // 20,000 rows, seed 2: standard errors of differences of weights are about 0.03; 5 of them.
    let (rows, labels, truth) = drawn(20_000, 2);
    let fit = Fit { l2: 0.0, steps: 100, tolerance: 1e-6 };
    let (model, steps) = Softmax::fit(Rows::new(&rows, 4), &labels, 3, fit).expect("good data");
    assert!((3..100).contains(&steps), "{steps}");
    for i in 0..4 {
        for l in 1..3 {
            let found = f64::from(model.weights[i * 3 + l] - model.weights[i * 3]);
            assert!((found - (truth[i * 3 + l] - truth[i * 3])).abs() < 0.15);
        }
    }
    let mut sharp = Softmax { weights: model.weights.iter().map(|w| 2.5 * w).collect(), ..model.clone() };
    sharp.calibrate(Rows::new(&rows, 4), &labels).expect("good data");
    assert!((sharp.temperature() - 2.5).abs() < 0.15, "weights 2.5 times too large ask for that temperature");
}

#[test]
fn classifiers_come_back_from_files_and_damaged_ones_are_refused() {
    let (rows, labels, _) = drawn(100, 3);
    let (mut model, _) = Softmax::fit(Rows::new(&rows, 4), &labels, 3, Fit::default()).expect("good data");
    model.calibrate(Rows::new(&rows, 4), &labels).expect("good data");
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    model.save(&path, &Metadata::default()).expect("a writable folder");
    assert_eq!(Softmax::load(&path).expect("whole").0, model);
    let bytes = std::fs::read(&path).expect("just written");
    for i in (0..bytes.len()).step_by(5) {
        let mut damaged = bytes.clone();
        damaged[i] ^= 4;
        std::fs::write(&path, &damaged).expect("a writable folder");
        assert!(Softmax::load(&path).is_err());
    }
    let rows = Rows::new(&rows, 4);
    assert!(Softmax::fit(rows, &labels[1..], 3, Fit::default()).is_err());
    assert!(Softmax::fit(rows, &labels, 2, Fit::default()).is_err() && model.calibrate(rows, &[7; 100]).is_err());
}
