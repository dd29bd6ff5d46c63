//! The three matrix products of an RBM, on row-major slices.
//!
//! An entry of a product depends on its own row and column alone, to the last bit, however many rows are multiplied
//! at once: the kernels add along the inner side in one order.

use foveate_base::rows::Rows;
use foveate_kernels::{Matrix, Write, matrix_product};

/// Rows a thread takes at a time: all of them for one thread, so that weights are packed once; any number gives the
/// same bits.
pub fn block_of(rows: usize) -> usize {
    rows.div_ceil(rayon::current_num_threads()).max(8)
}

/// `out` (m × n) = `rows` (m × k) · `weights` (k × n).
pub fn rows_times(rows: Rows<'_>, weights: &[f32], out: &mut [f32]) {
    let weights = Matrix::new(weights, weights.len() / rows.width());
    matrix_product(Matrix::new(rows.data(), rows.width()), weights, 1.0, Write::Replace, out);
}

/// `out` (m × k) = `rows` (m × n) · `weights`ᵀ, with `weights` (k × n).
pub fn rows_times_transposed(rows: Rows<'_>, weights: &[f32], out: &mut [f32]) {
    let weights = Matrix::new(weights, rows.width()).transposed();
    matrix_product(Matrix::new(rows.data(), rows.width()), weights, 1.0, Write::Replace, out);
}

/// `weights` (k × n) += `factor` · `left`ᵀ · `right`, with columns `from .. from + k` of `left` (m rows) and `right` (m × n).
pub fn add_outer(weights: &mut [f32], factor: f32, left: Rows<'_>, from: usize, right: Rows<'_>) {
    outer(weights, Write::Add, factor, left, from, right);
}

/// The same, with `weights` = in place of +=.
pub fn set_outer(weights: &mut [f32], factor: f32, left: Rows<'_>, from: usize, right: Rows<'_>) {
    outer(weights, Write::Replace, factor, left, from, right);
}

fn outer(weights: &mut [f32], write: Write, factor: f32, left: Rows<'_>, from: usize, right: Rows<'_>) {
    let k = weights.len() / right.width();
    let left = Matrix::new(left.data(), left.width()).columns(from, k).transposed();
    matrix_product(left, Matrix::new(right.data(), right.width()), factor, write, weights);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    fn random(n: usize, seed: u64) -> Vec<f32> {
        let mut rng = foveate_base::rng::Streams::new(seed, 0).rng(0);
        (0..n).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    /// Shapes with edges of every block; products against f64 loops.
    #[test]
    fn products_are_right_and_a_row_does_not_depend_on_its_neighbours() {
        for (k, n) in [
            (3, 2),
            (1, 40),
            (40, 1),
            (32, 64),
            (33, 64),
            (47, 101),
            (132, 500),
            (240, 515),
            (784, 500),
            (8, 1027),
            (17, 2300),
        ] {
            let (a, w) = (random(203 * k, 1), random(k * n, 2));
            let all = Rows::new(&a, k);
            let mut whole = vec![0.0; 203 * n];
            rows_times(all, &w, &mut whole);
            for i in [0, 101, 202] {
                for j in 0..n {
                    let exact: f64 = (0..k).map(|l| f64::from(all.row(i)[l]) * f64::from(w[l * n + j])).sum();
                    assert!((f64::from(whole[i * n + j]) - exact).abs() < 1e-5 * k as f64, "{k} x {n}, ({i}, {j})");
                }
            }
            // The same weights, transposed, through the other product.
            let mut wt = vec![0.0; n * k];
            (0..k * n).for_each(|e| wt[e % n * k + e / n] = w[e]);
            let mut transposed = vec![0.0; 203 * n];
            rows_times_transposed(all, &wt, &mut transposed);
            assert!(whole == transposed, "{k} x {n}: the two products add in the same order");
            for m in [1, 2, 3, 4, 5, 7, 31, 96, 97, 100, 128, 200] {
                let some = Rows::new(&a[3 * k..][..m * k], k);
                let (mut part, mut other) = (vec![0.0; m * n], vec![0.0; m * n]);
                rows_times(some, &w, &mut part);
                rows_times_transposed(some, &wt, &mut other);
                assert!(part == whole[3 * n..][..m * n] && part == other, "{k} x {n}, {m} rows");
            }
        }
    }

    #[test]
    fn outer_products_add_up() {
        let (m, k, n) = (7, 50, 60);
        let (a, b) = (random(m * k, 3), random(m * n, 4));
        let mut w = vec![1.0; k * n];
        add_outer(&mut w[..20 * n], 0.5, Rows::new(&a, k), 0, Rows::new(&b, n));
        add_outer(&mut w[20 * n..], 0.5, Rows::new(&a, k), 20, Rows::new(&b, n));
        for (e, &got) in w.iter().enumerate() {
            let exact: f32 = 1.0 + 0.5 * (0..m).map(|r| a[r * k + e / n] * b[r * n + e % n]).sum::<f32>();
            assert!((got - exact).abs() < 1e-5);
        }
        let mut fresh = vec![f32::NAN; k * n];
        set_outer(&mut fresh, 0.5, Rows::new(&a, k), 0, Rows::new(&b, n));
        assert!(fresh.iter().zip(&w).all(|(fresh, w)| (fresh + 1.0 - w).abs() < 1e-5), "what was there is gone");
    }
}
