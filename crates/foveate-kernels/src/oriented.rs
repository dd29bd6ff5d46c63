//! Histograms of gradient orientations over blocks of a square patch (Dalal & Triggs 2005), of one sign each.

use crate::level::{levels, multiply_add};

/// Directions of gradients that are told apart, 45° from one to the next.
pub const DIRECTIONS: usize = 8;
/// Pixels along a block's side.
pub const BLOCK: usize = 4;
/// Blocks along a patch's side, at most.
pub const MOST_BLOCKS: usize = 8;

levels! {
    /// `out` ← for each block of 4 × 4 pixels of a patch, row by row, the sums of gradient in 8 directions; then, for each half block of
    /// 2 × 2 pixels, the sum of its values. The patch is square, with a border of one pixel around its blocks.
    ///
    /// A gradient counts for the two directions beside it: in direction k with max(0, g · eₖ − |g| cos 45°).
    ///
    /// # Panics
    /// If the patch is not `(4 blocks + 2)²` values, blocks more than 8, or `out` not `12 blocks²`.
    pub fn oriented / oriented_at (patch: &[f32], blocks: usize, out: &mut [f32]) = oriented_body
}

#[inline(always)]
fn oriented_body<const V: u8>(patch: &[f32], blocks: usize, out: &mut [f32]) {
    let side = BLOCK * blocks + 2;
    assert!((1..=MOST_BLOCKS).contains(&blocks), "1 to 8 blocks, not {blocks}");
    assert!(patch.len() == side * side, "a patch of {side} x {side}");
    assert!(out.len() == (DIRECTIONS + 4) * blocks * blocks, "12 values a block");
    if blocks <= 4 { histograms::<V, 16>(patch, blocks, out) } else { histograms::<V, 32>(patch, blocks, out) }
}

/// Rows of `WIDTH` pixels at a time, of which the first `4 blocks` count.
#[inline(always)]
fn histograms<const V: u8, const WIDTH: usize>(patch: &[f32], blocks: usize, out: &mut [f32]) {
    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
    const AT: [(f32, f32); DIRECTIONS] =
        [(1.0, 0.0), (HALF, HALF), (0.0, 1.0), (-HALF, HALF), (-1.0, 0.0), (-HALF, -HALF), (0.0, -1.0), (HALF, -HALF)];
    let (n, side) = (BLOCK * blocks, BLOCK * blocks + 2);
    let (histograms, sums_of_four) = out.split_at_mut(DIRECTIONS * blocks * blocks);
    for block in 0..blocks {
        let mut sums = [[0.0f32; WIDTH]; DIRECTIONS];
        for row in block * BLOCK..(block + 1) * BLOCK {
            let (mut gx, mut gy, mut less) = ([0.0f32; WIDTH], [0.0f32; WIDTH], [0.0f32; WIDTH]);
            let line = |i: usize| &patch[(row + i) * side..][..side];
            let (above, here, below) = (line(0), line(1), line(2));
            for (x, (gx, gy)) in gx.iter_mut().zip(&mut gy).enumerate().take(n) {
                *gx = here[x + 2] - here[x];
                *gy = below[x + 1] - above[x + 1];
            }
            for x in 0..WIDTH {
                less[x] = -HALF * multiply_add::<V>(gx[x], gx[x], gy[x] * gy[x]).sqrt();
            }
            for (sums, (cos, sin)) in sums.iter_mut().zip(AT) {
                for x in 0..WIDTH {
                    sums[x] += multiply_add::<V>(gx[x], cos, multiply_add::<V>(gy[x], sin, less[x])).max(0.0);
                }
            }
            for (x, sum) in sums_of_four[row / 2 * (2 * blocks)..][..2 * blocks].iter_mut().enumerate() {
                let pair = here[2 * x + 1] + here[2 * x + 2];
                *sum = if row % 2 == 0 { pair } else { *sum + pair };
            }
        }
        for column in 0..blocks {
            let out = &mut histograms[(block * blocks + column) * DIRECTIONS..][..DIRECTIONS];
            for (out, sums) in out.iter_mut().zip(&sums) {
                let s = &sums[column * BLOCK..][..BLOCK];
                *out = (s[0] + s[1]) + (s[2] + s[3]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, sums::tests::values};

    #[test]
    fn agree_with_the_twin() {
        for blocks in [1, 3, 4, 5, 8] {
            let side = 4 * blocks + 2;
            let patch = values(side * side, 1);
            let at = |x: usize, y: usize| f64::from(patch[y * side + x]);
            for level in Level::all() {
                let mut out = vec![f32::NAN; 12 * blocks * blocks];
                oriented_at(level, &patch, blocks, &mut out);
                let mut exact = vec![0.0; out.len()];
                for (y, x) in (0..4 * blocks).flat_map(|y| (0..4 * blocks).map(move |x| (y, x))) {
                    let (gx, gy) = (at(x + 2, y + 1) - at(x, y + 1), at(x + 1, y + 2) - at(x + 1, y));
                    for k in 0..DIRECTIONS {
                        let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
                        let along = gx * cos + gy * sin - gx.hypot(gy) * std::f64::consts::FRAC_1_SQRT_2;
                        exact[(y / BLOCK * blocks + x / BLOCK) * DIRECTIONS + k] += along.max(0.0);
                    }
                    exact[DIRECTIONS * blocks * blocks + y / 2 * (2 * blocks) + x / 2] += at(x + 1, y + 1);
                }
                for (out, exact) in out.iter().zip(&exact) {
                    assert!((f64::from(*out) - exact).abs() < 2e-5, "{level:?}: {out} is not {exact}");
                }
            }
        }
    }

    /// A ramp has the gradient of its slope, in one direction.
    #[test]
    fn a_ramp_points_one_way() {
        let patch: Vec<f32> = (0..100).map(|i| (i % 10) as f32 * 0.1).collect();
        let mut out = [0.0; 48];
        oriented(&patch, 2, &mut out);
        for block in out[..32].chunks(DIRECTIONS) {
            assert!((block[0] - 16.0 * 0.2 * (1.0 - std::f32::consts::FRAC_1_SQRT_2)).abs() < 1e-5, "{block:?}");
            assert!(block[2..7].iter().all(|&other| other == 0.0), "{block:?}");
        }
    }
}
