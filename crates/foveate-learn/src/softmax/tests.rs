use super::*;
use foveate_base::rng::Streams;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Rows whose classes are drawn from a known model of three classes and four inputs.
fn drawn(n: usize, seed: u64) -> (Vec<f32>, Vec<u8>, Vec<f64>) {
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
fn the_gradient_is_that_of_finite_differences() {
    let (rows, labels, _) = drawn(300, 1);
    let rows = Rows::new(&rows, 4);
    let at: Vec<f64> = (0..15).map(|i| (f64::from(i) * 0.7).cos()).collect();
    let cost = |at: &[f64], gradient: &mut [f64]| {
        let model = Softmax { weights: narrow(&at[..12]), bias: narrow(&at[12..]), temperature: 1.0 };
        model.cost(rows, &labels, 0.3, gradient)
    };
    let mut gradient = vec![0.0; 15];
    cost(&at, &mut gradient);
    for i in 0..15 {
        let moved = |by: f64| {
            let mut at = at.clone();
            at[i] = f64::from((at[i] + by) as f32);
            (at[i], cost(&at, &mut [0.0; 15]))
        };
        let ((a, f), (b, g)) = (moved(-1e-3), moved(1e-3));
        assert!(((g - f) / (b - a) - gradient[i]).abs() < 1e-4, "{i}: {} {}", (g - f) / (b - a), gradient[i]);
    }
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
fn the_solver_finds_the_bottom_of_a_curved_valley() {
    // Rosenbrock's function: the minimum is 0 at (1, 1).
    let mut rosenbrock = |x: &[f64], g: &mut [f64]| {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        (g[0], g[1]) = (-2.0 * a - 400.0 * x[0] * b, 200.0 * b);
        a * a + 100.0 * b * b
    };
    let mut x = [-1.2, 1.0];
    let steps = minimize(&mut rosenbrock, &mut x, 200, 1e-9);
    assert!((x[0] - 1.0).abs() < 1e-7 && (x[1] - 1.0).abs() < 1e-7 && steps < 60, "{x:?} after {steps} steps");
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
