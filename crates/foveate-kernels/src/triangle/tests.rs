use super::*;
use crate::Level;

/// A covariance matrix and a little on its diagonal; beyond `n`, zeros.
fn matrix(n: usize, stride: usize) -> Vec<f64> {
    let mut a = vec![0.0; stride * stride];
    for i in 0..n {
        for j in 0..n {
            let d = (i as f64 - j as f64) / 7.0;
            a[i * stride + j] = (-d * d).exp() + if i == j { 0.01 } else { 0.0 };
        }
    }
    a
}

#[test]
fn factor_and_inverse_multiply_to_the_original() {
    for n in [0usize, 1, 2, 7, 8, 9, 15, 16, 17, 31, 40, 65] {
        let stride = n.next_multiple_of(SQUARE).max(SQUARE);
        let a = matrix(n, stride);
        for level in Level::all() {
            let (mut u, mut w, mut r) = (a.clone(), vec![0.0; stride * stride], vec![0.0; stride]);
            assert_eq!(factor_at(level, &mut u, stride, n, 0.0, &mut r), n);
            invert_at(level, &u, stride, (0, n), &r, &mut w);
            let y: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
            let mut x = y.clone();
            solve_at(level, &u, stride, &r, &mut x);
            solve_back_at(level, &u, stride, &r, &mut x);
            for i in 0..n {
                let back: f64 = (0..n).map(|j| a[i * stride + j] * x[j]).sum();
                assert!((back - y[i]).abs() < 1e-9, "{level:?}, {n}");
                for j in 0..n {
                    let first = i.min(j);
                    let product: f64 = (0..=first).map(|k| u[k * stride + i] * u[k * stride + j]).sum();
                    assert!((product - a[i * stride + j]).abs() < 1e-13, "{level:?}, {n}");
                    let one: f64 = (j..=i).map(|k| u[k * stride + i] * w[k * stride + j]).sum();
                    assert!((one - f64::from(u8::from(i == j))).abs() < 1e-11, "{level:?}, {n}");
                }
            }
        }
    }
}

#[test]
fn a_factor_that_grew_has_the_bits_of_one_made_at_once() {
    let (n, stride) = (53, 64);
    let a = matrix(n, stride);
    for level in Level::all() {
        let (mut grown, mut r) = (vec![0.0; stride * stride], vec![0.0; stride]);
        for i in 0..n {
            let mut column: Vec<f64> = (0..=i).map(|k| a[k * stride + i]).collect();
            // A pivot that is not positive changes nothing.
            let (before, mut doubtful) = ((grown.clone(), r.clone()), column.clone());
            doubtful[i] = f64::NEG_INFINITY;
            assert!(!extend_at(level, &mut grown, stride, 0.0, &mut r, &mut doubtful));
            assert!((&grown, &r) == (&before.0, &before.1), "{level:?}");
            assert!(extend_at(level, &mut grown, stride, 0.0, &mut r, &mut column));
        }
        let (mut once, mut r_once) = (a.clone(), vec![0.0; stride]);
        assert_eq!(factor_at(level, &mut once, stride, n, 0.0, &mut r_once), n);
        assert_eq!(r, r_once, "{level:?}");
        for i in 0..n {
            assert_eq!(grown[i * stride + i + 1..][..n - i - 1], once[i * stride + i + 1..][..n - i - 1]);
        }
    }
}

#[test]
fn a_matrix_that_is_not_positive_is_refused_where_it_fails() {
    for level in Level::all() {
        for bad in [3, 20] {
            for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                let (mut a, mut r) = (matrix(40, 48), vec![0.0; 48]);
                a[bad * 48 + bad] = value;
                assert_eq!(factor_at(level, &mut a, 48, 40, 1e-12, &mut r), bad);
            }
        }
    }
}
