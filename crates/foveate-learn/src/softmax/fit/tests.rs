use super::*;
use crate::softmax::tests::drawn;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The columns of three classes' rows in other units, one of them far from 0, and weights.
fn uneven(n: usize) -> (Vec<f64>, Vec<u8>, Vec<f64>) {
    let (rows, labels, _) = drawn(n, 1);
    let units = [(1000.0, 1.0), (0.0, 1e-4), (-3.0, 50.0), (0.5, 1.0)];
    let values = rows.iter().zip(units.iter().cycle()).map(|(x, (from, unit))| from + unit * f64::from(*x)).collect();
    (values, labels, (0..n).map(|i| (i % 4) as f64).collect())
}

#[test]
fn the_gradient_is_that_of_finite_differences() {
    let (values, labels, weights) = uneven(300);
    let examples = Examples { values: &values, width: 4, labels: &labels, weights: Some(&weights), classes: 3 };
    let mut problem = Problem::new(examples, 0.3);
    let at: Vec<f64> = (0..15).map(|i| (f64::from(i) * 0.7).cos()).collect();
    let mut cost = |at: &[f64], gradient: &mut [f64]| problem.cost(at, gradient, &|| false).expect("not stopped");
    let mut gradient = vec![0.0; 15];
    cost(&at, &mut gradient);
    for i in 0..15 {
        let mut moved = |by: f64| {
            let mut at = at.clone();
            at[i] += by;
            cost(&at, &mut [0.0; 15])
        };
        let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        assert!((slope - gradient[i]).abs() < 1e-8, "{i}: {slope} {}", gradient[i]);
    }
}

/// In the plain variables: W and b of the solution make the gradient of the cost as it is written down vanish, whatever the columns'
/// units are.
#[test]
fn the_solution_is_a_minimum_whatever_the_units() {
    let (values, labels, weights) = uneven(400);
    let examples = Examples { values: &values, width: 4, labels: &labels, weights: Some(&weights), classes: 3 };
    let fit = Fit { l2: 1e-3, steps: 500, tolerance: 1e-9 };
    let found = solve(examples, fit, &|| false).expect("good examples");
    assert!(found.converged && found.steps < 100, "{} steps", found.steps);
    let total: f64 = weights.iter().sum();
    let (mut to_w, mut to_b) = (found.weights.iter().map(|w| 1e-3 * w).collect::<Vec<_>>(), [0.0; 3]);
    for ((x, &label), weight) in values.chunks_exact(4).zip(&labels).zip(&weights) {
        let mut q: Vec<f64> =
            (0..3).map(|l| found.bias[l] + (0..4).map(|i| x[i] * found.weights[3 * i + l]).sum::<f64>()).collect();
        normalize(&mut q);
        for l in 0..3 {
            let slope = weight / total * (q[l].exp() - f64::from(u8::from(usize::from(label) == l)));
            to_b[l] += slope;
            (0..4).for_each(|i| to_w[3 * i + l] += slope * x[i]);
        }
    }
    // A column's gradient is in its own unit.
    for (i, unit) in [1000.0, 1e-4, 50.0, 1.0].into_iter().enumerate() {
        assert!((0..3).all(|l| to_w[3 * i + l].abs() < 1e-8 * unit), "column {i}: {to_w:?}");
    }
    assert!(to_b.iter().all(|g| g.abs() < 1e-8), "{to_b:?}");
}

#[test]
fn a_weight_is_a_row_so_many_times() {
    let (values, labels, weights) = uneven(200);
    let fit = Fit { l2: 1e-2, steps: 500, tolerance: 1e-10 };
    let examples = Examples { values: &values, width: 4, labels: &labels, weights: Some(&weights), classes: 3 };
    let weighted = solve(examples, fit, &|| false).expect("good examples");
    let (mut repeated, mut theirs): (Vec<f64>, Vec<u8>) = (vec![], vec![]);
    for ((row, label), weight) in values.chunks_exact(4).zip(&labels).zip(&weights) {
        for _ in 0..*weight as usize {
            repeated.extend(row);
            theirs.push(*label);
        }
    }
    let examples = Examples { values: &repeated, width: 4, labels: &theirs, weights: None, classes: 3 };
    let plain = solve(examples, fit, &|| false).expect("good examples");
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + a.abs()));
    assert!(near(&weighted.weights, &plain.weights) && near(&weighted.bias, &plain.bias));
    for wrong in [vec![1.0; 199], vec![0.0; 200], vec![-1.0; 200], vec![f64::NAN; 200]] {
        let examples = Examples { values: &values, width: 4, labels: &labels, weights: Some(&wrong), classes: 3 };
        assert!(solve(examples, fit, &|| false).is_err());
    }
}

/// Between two questions whether to stop lie 256 rows, however many there are.
#[test]
fn it_stops_within_256_rows() {
    let (values, labels, _) = uneven(2000);
    let examples = Examples { values: &values, width: 4, labels: &labels, weights: None, classes: 3 };
    let asked = AtomicUsize::new(0);
    let after = |n: usize| {
        asked.store(0, Ordering::Relaxed);
        solve(examples, Fit::default(), &|| asked.fetch_add(1, Ordering::Relaxed) + 1 >= n)
    };
    for n in [1, 5, 30] {
        assert!(matches!(after(n), Err(Error::Stopped)));
        assert_eq!(asked.load(Ordering::Relaxed), n, "nothing is done once it was asked to stop");
    }
    let steps = after(usize::MAX).expect("not stopped").steps;
    assert!(asked.load(Ordering::Relaxed) >= 8 * steps, "2000 rows are 8 pieces");
}
