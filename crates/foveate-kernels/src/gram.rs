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
    gram.iter_mut().for_each(|sum| *sum *= keep);
    let single = rows.len() / width % TOGETHER * width;
    let (groups, single) = rows.split_at(rows.len() - single);
    for rows in single.chunks_exact(width) {
        add_each::<V, 1>(rows, width, share, gram);
    }
    for rows in groups.chunks(BATCH * width) {
        add_each::<V, TOGETHER>(rows, width, share, gram);
    }
}

/// Rows that are gone through for one line of the triangle before the next.
const BATCH: usize = 32;
/// Neighbouring sums that are taken at once.
const WIDE: usize = 64;
const NARROW: usize = 16;

/// `gram` ← `gram` + `share` · Σ r rᵀ over at most [`BATCH`] rows, `GROUP` at a time.
#[inline(always)]
fn add_each<const V: u8, const GROUP: usize>(rows: &[f32], width: usize, share: f32, gram: &mut [f32]) {
    let (mut factors, mut start) = ([0.0; BATCH], 0);
    for i in 0..width {
        let line = &mut gram[start..=start + i];
        start += i + 1;
        for (factor, row) in factors.iter_mut().zip(rows.chunks_exact(width)) {
            *factor = share * row[i];
        }
        let Some(mut last) = line.last_chunk::<NARROW>().copied() else {
            for (j, sum) in line.as_chunks_mut().0.iter_mut().enumerate() {
                add_to::<V, GROUP, 1>(rows, width, &factors, j, sum);
            }
            continue;
        };
        // The last sums overlap others, with the same values.
        add_to::<V, GROUP, NARROW>(rows, width, &factors, i + 1 - NARROW, &mut last);
        let mut j = 0;
        while let Some(sums) = line[j..].first_chunk_mut() {
            add_to::<V, GROUP, WIDE>(rows, width, &factors, j, sums);
            j += WIDE;
        }
        while let Some(sums) = line[j..].first_chunk_mut() {
            add_to::<V, GROUP, NARROW>(rows, width, &factors, j, sums);
            j += NARROW;
        }
        line[i + 1 - NARROW..].copy_from_slice(&last);
    }
}

/// Adds the rows from column `j` on, each times its factor, to `sums`.
#[inline(always)]
fn add_to<const V: u8, const GROUP: usize, const N: usize>(
    rows: &[f32],
    width: usize,
    factors: &[f32; BATCH],
    j: usize,
    sums: &mut [f32; N],
) {
    let mut all = *sums;
    for (rows, f) in rows.chunks_exact(GROUP * width).zip(factors.chunks_exact(GROUP)) {
        if GROUP == TOGETHER {
            let (a, b) = (&rows[j..][..N], &rows[width + j..][..N]);
            let (c, d) = (&rows[2 * width + j..][..N], &rows[3 * width + j..][..N]);
            for k in 0..N {
                let first = multiply_add::<V>(f[0], a[k], f[1] * b[k]);
                let second = multiply_add::<V>(f[2], c[k], f[3] * d[k]);
                all[k] += first + second;
            }
        } else {
            let a = &rows[j..][..N];
            for k in 0..N {
                all[k] = multiply_add::<V>(f[0], a[k], all[k]);
            }
        }
    }
    *sums = all;
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
    use crate::Level;
    use crate::sums::tests::values;

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
