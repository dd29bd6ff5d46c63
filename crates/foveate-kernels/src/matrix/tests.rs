use super::*;
use crate::sums::tests::values;

/// The values of a row-major matrix, column by column.
fn turned<T: Copy>(values: &[T], columns: usize) -> Vec<T> {
    (0..values.len()).map(|e| values[e % (values.len() / columns) * columns + e / (values.len() / columns)]).collect()
}

/// Shapes with edges of every block, at every level, each matrix row after row and column after column.
#[test]
fn products_agree_with_f64_and_are_the_same_bits_however_the_matrices_lie() {
    for (m, k, n) in [(1, 1, 1), (7, 3, 5), (6, 128, 64), (49, 129, 65), (100, 257, 130), (2, 784, 500), (97, 40, 1)] {
        let (a, b) = (values(m * k, 1), values(k * n, 2));
        let (at, bt) = (turned(&a, k), turned(&b, n));
        let lefts = [Matrix::new(&a, k), Matrix::new(&at, m).transposed()];
        let rights = [Matrix::new(&b, n), Matrix::new(&bt, k).transposed()];
        for level in Level::all() {
            let mut first = None;
            for (left, right) in lefts.iter().flat_map(|l| rights.map(|r| (*l, r))) {
                let mut out = vec![f32::NAN; m * n];
                product(level, left, right, 0.5, Write::Replace, &mut out);
                for (e, &got) in out.iter().enumerate() {
                    let exact: f64 = (0..k).map(|l| a[e / n * k + l] as f64 * b[l * n + e % n] as f64).sum();
                    assert!((got as f64 - 0.5 * exact).abs() < 1e-6 * k as f64, "{level:?} {m} x {k} x {n}: {got}");
                }
                let mut twice = out.clone();
                product(level, left, right, 0.5, Write::Add, &mut twice);
                assert!(twice.iter().zip(&out).all(|(two, one)| (two - 2.0 * one).abs() < 1e-5 * one.abs().max(1.0)));
                assert_eq!(first.get_or_insert(out.clone()), &out, "{level:?} {m} x {k} x {n}");
            }
        }
    }
}

#[test]
fn products_in_f64_agree_with_plain_loops() {
    let wide = |n, seed| values(n, seed).into_iter().map(f64::from).collect::<Vec<_>>();
    for (m, k, n) in [(1, 1, 1), (4, 7, 16), (5, 100, 10), (9, 33, 35)] {
        let (a, b) = (wide(m * k, 1), wide(k * n, 2));
        let (at, bt) = (turned(&a, k), turned(&b, n));
        for level in Level::all() {
            for left in [Matrix::new(&a, k), Matrix::new(&at, m).transposed()] {
                for right in [Matrix::new(&b, n), Matrix::new(&bt, k).transposed()] {
                    let mut out = vec![f64::NAN; m * n];
                    product_f64(level, left, right, Write::Replace, &mut out);
                    product_f64(level, left, right, Write::Add, &mut out);
                    for (e, got) in out.iter().enumerate() {
                        let exact: f64 = (0..k).map(|l| a[e / n * k + l] * b[l * n + e % n]).sum();
                        assert!((got - 2.0 * exact).abs() < 1e-12 * k as f64, "{level:?} {m} x {k} x {n}");
                    }
                }
            }
        }
    }
}

/// A row alone is multiplied with all of its zeros.
#[test]
fn zeros_that_are_left_out_change_no_bit() {
    for (m, k, n) in [(100, 784, 500), (133, 200, 70), (784, 200, 65), (7, 16, 17), (300, 257, 64)] {
        let b = values(k * n, 2);
        for ones in [false, true] {
            // Few in the first half, all in the third quarter, none in the last.
            let there = |(e, a): (usize, f32)| match 4 * (e % k) / k {
                0 | 1 if a > 0.2 => 0.0,
                3 => 0.0,
                _ if ones => 1.0,
                _ => a,
            };
            let a: Vec<f32> = values(m * k, 1).into_iter().enumerate().map(there).collect();
            let at = turned(&a, k);
            for level in Level::all() {
                let mut alone = vec![0.0; m * n];
                for (row, alone) in a.chunks_exact(k).zip(alone.chunks_exact_mut(n)) {
                    product(level, Matrix::new(row, k), Matrix::new(&b, n), 1.0, Write::Replace, alone);
                }
                for left in [Matrix::new(&a, k), Matrix::new(&at, m).transposed()] {
                    let mut out = vec![f32::NAN; m * n];
                    product(level, left, Matrix::new(&b, n), 1.0, Write::Replace, &mut out);
                    assert!(out == alone, "{level:?} {m} x {k} x {n}");
                }
            }
        }
    }
}

/// Without rows there is no output; without an inner side it is 0.
#[test]
fn products_of_nothing_are_nothing_or_zero() {
    let a = values(7 * 50, 3);
    let all = Matrix::new(&a, 50);
    matrix_product(Matrix::new(&[], 50), all.transposed(), 1.0, Write::Replace, &mut []);
    let mut out = [f32::NAN; 49];
    matrix_product(all.columns(50, 0), all.columns(0, 0).transposed(), 1.0, Write::Replace, &mut out);
    assert_eq!(out, [0.0; 49]);
}

/// Columns of a matrix, and of one whose columns are rows, as a matrix.
#[test]
fn some_columns_are_taken() {
    let a = values(7 * 50, 3);
    let (mut all, mut some) = (vec![0.0; 50 * 50], vec![0.0; 20 * 50]);
    matrix_product(Matrix::new(&a, 50).transposed(), Matrix::new(&a, 50), 1.0, Write::Replace, &mut all);
    let left = Matrix::new(&a, 50).columns(13, 20);
    matrix_product(left.transposed(), Matrix::new(&a, 50), 1.0, Write::Replace, &mut some);
    assert_eq!(some, all[13 * 50..33 * 50]);
    let rows = Matrix::new(&a, 50).transposed().columns(2, 3);
    let (mut three, mut whole) = (vec![0.0; 3 * 3], vec![0.0; 7 * 7]);
    matrix_product(rows.transposed(), rows, 1.0, Write::Replace, &mut three);
    matrix_product(Matrix::new(&a, 50), Matrix::new(&a, 50).transposed(), 1.0, Write::Replace, &mut whole);
    assert!((0..9).all(|e| three[e] == whole[(2 + e / 3) * 7 + 2 + e % 3]));
}
