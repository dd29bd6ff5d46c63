//! Sums over patches of 8 × 8 values of a map, for optical flow.

use crate::level::levels;
use crate::sums::{dot_body, sum_body};

/// Side of a patch.
pub const PATCH: usize = 8;
const VALUES: usize = PATCH * PATCH;

/// A patch and its gradients, each less its mean: a constant change of brightness drops out.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// The values, row after row.
    pub values: [f32; VALUES],
    /// Half the difference of the neighbours across.
    pub across: [f32; VALUES],
    /// Half the difference of the neighbours down.
    pub down: [f32; VALUES],
}

impl Default for Patch {
    fn default() -> Self {
        let zeros = [0.0; VALUES];
        Self { values: zeros, across: zeros, down: zeros }
    }
}

levels! {
    /// `patch` ← the patch with its first value at row 1, column 1 of `map`, which has `stride` values a row. Returns
    /// Σ across², Σ across · down, Σ down².
    ///
    /// # Panics
    /// If `map` has not ten rows of ten values.
    pub fn cut_patch / cut_patch_at (map: &[f32], stride: usize, patch: &mut Patch) -> [f32; 3] = cut_body
}

levels! {
    /// Σ r², Σ r · across, Σ r · down of r, the difference of a map from a moved patch, less its mean. Values are
    /// bilinear between `map` and its neighbours, `part` = (across, down) of the way, 0 to 1.
    ///
    /// # Panics
    /// If `map` has not nine rows of nine values.
    pub fn patch_residual / patch_residual_at (map: &[f32], stride: usize, part: (f32, f32), patch: &Patch) -> [f32; 3] =
        residual_body
}

levels! {
    /// 8 × 8 values between those of a map, as [`patch_residual`] reads them.
    ///
    /// # Panics
    /// If `map` has not nine rows of nine values.
    pub fn patch_between / patch_between_at (map: &[f32], stride: usize, part: (f32, f32)) -> [f32; VALUES] = between_body
}

#[inline(always)]
fn cut_body<const V: u8>(map: &[f32], stride: usize, patch: &mut Patch) -> [f32; 3] {
    let row = |j: usize| map[j * stride..].first_chunk::<{ PATCH + 2 }>().expect("ten values a row");
    let Patch { values, across, down } = patch;
    for j in 0..PATCH {
        let (above, here, below) = (row(j), row(j + 1), row(j + 2));
        for i in 0..PATCH {
            values[j * PATCH + i] = here[i + 1];
            across[j * PATCH + i] = 0.5 * (here[i + 2] - here[i]);
            down[j * PATCH + i] = 0.5 * (below[i + 1] - above[i + 1]);
        }
    }
    for all in [values, &mut *across, &mut *down] {
        let mean = sum_body::<V>(all) / VALUES as f32;
        all.iter_mut().for_each(|v| *v -= mean);
    }
    [dot_body::<V>(across, across), dot_body::<V>(across, down), dot_body::<V>(down, down)]
}

#[inline(always)]
fn between_body<const V: u8>(map: &[f32], stride: usize, (fx, fy): (f32, f32)) -> [f32; VALUES] {
    let mut out = [0.0; VALUES];
    for (j, out) in out.as_chunks_mut::<PATCH>().0.iter_mut().enumerate() {
        let row = |j: usize| map[j * stride..].first_chunk::<{ PATCH + 1 }>().expect("nine values a row");
        let (a, b) = (row(j), row(j + 1));
        for i in 0..PATCH {
            let (upper, lower) = (a[i] + fx * (a[i + 1] - a[i]), b[i] + fx * (b[i + 1] - b[i]));
            out[i] = upper + fy * (lower - upper);
        }
    }
    out
}

#[inline(always)]
fn residual_body<const V: u8>(map: &[f32], stride: usize, part: (f32, f32), patch: &Patch) -> [f32; 3] {
    let mut rest = between_body::<V>(map, stride, part);
    let mean = sum_body::<V>(&rest) / VALUES as f32;
    rest.iter_mut().zip(&patch.values).for_each(|(r, value)| *r = *r - mean - value);
    [dot_body::<V>(&rest, &rest), dot_body::<V>(&rest, &patch.across), dot_body::<V>(&rest, &patch.down)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;
    use crate::sums::tests::values;

    const STRIDE: usize = 13;

    /// Against plain sums in double precision, at every level.
    #[test]
    fn sums_equal_those_of_plain_loops() {
        let map = values(12 * STRIDE, 5);
        let at = |i: usize, j: usize| f64::from(map[j * STRIDE + i]);
        let centred = |of: &dyn Fn(usize, usize) -> f64| {
            let all: Vec<f64> = (0..VALUES).map(|k| of(k % PATCH, k / PATCH)).collect();
            let mean = all.iter().sum::<f64>() / VALUES as f64;
            all.into_iter().map(|v| v - mean).collect::<Vec<f64>>()
        };
        let truth = [
            centred(&|i, j| at(i + 1, j + 1)),
            centred(&|i, j| 0.5 * (at(i + 2, j + 1) - at(i, j + 1))),
            centred(&|i, j| 0.5 * (at(i + 1, j + 2) - at(i + 1, j))),
        ];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (fx, fy) = (0.3f32, 0.8f32);
        let (u, v) = (f64::from(fx), f64::from(fy));
        let line = |i: usize, j: usize| at(i, j) + u * (at(i + 1, j) - at(i, j));
        let moved = |i: usize, j: usize| line(i, j) + v * (line(i, j + 1) - line(i, j));
        let rest: Vec<f64> = centred(&moved).iter().zip(&truth[0]).map(|(moved, value)| moved - value).collect();
        let near = |got: f32, truth: f64| assert!((f64::from(got) - truth).abs() < 1e-5, "{got} is not {truth}");
        for level in Level::all() {
            let mut patch = Patch::default();
            let [xx, xy, yy] = cut_patch_at(level, &map, STRIDE, &mut patch);
            for (got, truth) in [(patch.values, &truth[0]), (patch.across, &truth[1]), (patch.down, &truth[2])] {
                got.iter().zip(truth).for_each(|(got, truth)| near(*got, *truth));
            }
            near(xx, dot(&truth[1], &truth[1]));
            near(xy, dot(&truth[1], &truth[2]));
            near(yy, dot(&truth[2], &truth[2]));
            let got = patch_residual_at(level, &map, STRIDE, (fx, fy), &patch);
            for (got, other) in got.into_iter().zip([&rest, &truth[1], &truth[2]]) {
                near(got, dot(&rest, other));
            }
            let got = patch_between_at(level, &map, STRIDE, (fx, fy));
            got.iter().enumerate().for_each(|(k, got)| near(*got, moved(k % PATCH, k / PATCH)));
        }
    }
}
