//! Symmetric matrices of sums of outer products, kept as their lower triangles, row after row: row i has i + 1 values.

use crate::level::{levels, multiply_add};
use crate::sums::dot_body;

levels! {
    /// `gram` ← `keep` · `gram` + `share` · Σ r rᵀ over the rows r of `rows`, each `width` long.
    ///
    /// # Panics
    /// If `rows` is not whole rows, or `gram` not `width (width + 1) / 2` long.
    pub fn add_outer / add_outer_at (rows: &[f32], width: usize, keep: f32, share: f32, gram: &mut [f32]) = add_outer_body
}

levels! {
    /// `out` ← `gram` · `vector`.
    ///
    /// # Panics
    /// If `out` is not as long as `vector`, or `gram` not the triangle of that width.
    pub fn symmetric_times / symmetric_times_at (gram: &[f32], vector: &[f32], out: &mut [f32]) = symmetric_times_body
}

/// Rows that are added at a time.
const TOGETHER: usize = 4;

#[inline(always)]
fn add_outer_body<const V: u8>(rows: &[f32], width: usize, keep: f32, share: f32, gram: &mut [f32]) {
    assert!(width > 0 && rows.len().is_multiple_of(width), "whole rows of {width} values");
    assert!(gram.len() == width * (width + 1) / 2, "a triangle of {width} rows");
    let mut start = 0;
    for i in 0..width {
        let line = &mut gram[start..=start + i];
        start += i + 1;
        line.iter_mut().for_each(|g| *g *= keep);
        let groups = rows.chunks_exact(TOGETHER * width);
        for row in groups.remainder().chunks_exact(width) {
            let factor = share * row[i];
            line.iter_mut().zip(row).for_each(|(g, r)| *g = multiply_add::<V>(factor, *r, *g));
        }
        for group in groups {
            let row: [&[f32]; TOGETHER] = std::array::from_fn(|r| &group[r * width..][..=i]);
            let factor = row.map(|row| share * row[i]);
            for (j, g) in line.iter_mut().enumerate() {
                let first = multiply_add::<V>(factor[0], row[0][j], factor[1] * row[1][j]);
                let second = multiply_add::<V>(factor[2], row[2][j], factor[3] * row[3][j]);
                *g += first + second;
            }
        }
    }
}

#[inline(always)]
fn symmetric_times_body<const V: u8>(gram: &[f32], vector: &[f32], out: &mut [f32]) {
    let width = vector.len();
    assert!(out.len() == width, "as many values out as in");
    assert!(gram.len() == width * (width + 1) / 2, "a triangle of {width} rows");
    let mut start = 0;
    for i in 0..width {
        let line = &gram[start..=start + i];
        start += i + 1;
        let (before, here) = out.split_at_mut(i);
        let factor = vector[i];
        before.iter_mut().zip(line).for_each(|(out, g)| *out = multiply_add::<V>(factor, *g, *out));
        here[0] = dot_body::<V>(line, &vector[..=i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, sums::tests::values};

    #[test]
    fn agree_with_the_twins() {
        for (width, n) in [(1, 1), (5, 3), (16, 4), (33, 9), (70, 14)] {
            let (rows, vector) = (values(n * width, 1), values(width, 2));
            let before = values(width * (width + 1) / 2, 3);
            for level in Level::all() {
                let mut gram = before.clone();
                add_outer_at(level, &rows, width, 0.75, 0.5, &mut gram);
                let at = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
                let mut out = vec![f32::NAN; width];
                symmetric_times_at(level, &gram, &vector, &mut out);
                for i in 0..width {
                    for j in 0..=i {
                        let sum: f64 = rows.chunks(width).map(|r| f64::from(r[i]) * f64::from(r[j])).sum();
                        let exact = 0.75 * f64::from(before[at(i, j)]) + 0.5 * sum;
                        assert!((f64::from(gram[at(i, j)]) - exact).abs() < 1e-5 * (1.0 + n as f64), "{level:?}");
                    }
                    let exact: f64 = (0..width).map(|j| f64::from(gram[at(i, j)]) * f64::from(vector[j])).sum();
                    assert!((f64::from(out[i]) - exact).abs() < 1e-4 * width as f64, "{level:?}");
                }
            }
        }
    }
}
