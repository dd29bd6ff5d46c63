//! Histograms of gradient orientations over blocks of a square patch (Dalal & Triggs 2005), of one sign each.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) mod columns;
mod parts;

pub use parts::Lengths;
pub(crate) use parts::{bring_to_length, places};

#[cfg(target_arch = "x86_64")]
use crate::level::AVX512;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::level::FUSED;
use crate::level::{greater, levels, multiply_add};

/// Number of gradient directions, 45° apart.
pub const DIRECTIONS: usize = 8;
/// Pixels along a block's side.
pub const BLOCK: usize = 4;
/// Blocks along a patch's side, at most.
pub(crate) const MOST_BLOCKS: usize = 8;

levels! {
    /// `gradients` ← for each block of 4 × 4 pixels of a patch, row by row, the sums of gradient in 8 directions; `squares` ← for each half
    /// block of 2 × 2 pixels the sum of its values. The patch is square, with a border of one pixel around its blocks.
    ///
    /// A gradient counts for the two directions beside it: in direction k with max(0, g · eₖ − |g| cos 45°).
    ///
    /// # Panics
    /// If the patch is not `(4 blocks + 2)²` values, blocks more than 8, `gradients` not `8 blocks²` or `squares` not `4 blocks²`.
    pub fn oriented / oriented_at (patch: &[f32], blocks: usize, gradients: &mut [f32], squares: &mut [f32]) = oriented_body
}

levels! {
    /// `out` ← [`oriented`] of the grey cells of a glimpse and its two colour channels, each part scaled by
    /// [`Lengths`].
    ///
    /// # Panics
    /// If `glimpse` is not `(4 blocks + 2)²` values and those of two channels, or `out` not as long as [`Lengths::sizes`] add up to.
    pub fn oriented_features / oriented_features_at (
        glimpse: &[f32], blocks: usize, lengths: &Lengths, out: &mut [f32]
    ) = oriented_features_body
}

#[inline(always)]
fn oriented_features_body<const V: u8>(glimpse: &[f32], blocks: usize, lengths: &Lengths, out: &mut [f32]) {
    let (patch, colour) = glimpse.split_at((BLOCK * blocks + 2).pow(2));
    assert!(colour.len().is_multiple_of(2), "two channels of colour");
    const COUNT: usize = AT_ONCE * AT_ONCE;
    if blocks == AT_ONCE && colour.len() == 2 * COUNT {
        let (colour, mut room) = (&colour[..2 * COUNT], [0.0; 4 * COUNT]);
        return features::<V>(patch, colour, AT_ONCE, lengths, &mut room, out); // with numbers that are known
    }
    let mut room = [0.0; 4 * MOST_BLOCKS * MOST_BLOCKS];
    features::<V>(patch, colour, blocks, lengths, &mut room[..4 * blocks * blocks], out);
}

#[inline(always)]
fn features<const V: u8>(
    patch: &[f32],
    colour: &[f32],
    blocks: usize,
    lengths: &Lengths,
    room: &mut [f32],
    out: &mut [f32],
) {
    let [gradients, squares, opponent] = places(lengths, blocks, colour.len(), room, out);
    oriented_body::<V>(patch, blocks, gradients, squares);
    gradients.iter_mut().for_each(|x| *x = x.sqrt());
    opponent.iter_mut().zip(colour).for_each(|(out, value)| *out = value - lengths.neither);
    bring_to_length::<V>(lengths, blocks, colour.len(), out);
}

#[inline(always)]
fn oriented_body<const V: u8>(patch: &[f32], blocks: usize, gradients: &mut [f32], squares: &mut [f32]) {
    let side = BLOCK * blocks + 2;
    assert!((1..=MOST_BLOCKS).contains(&blocks), "1 to 8 blocks, not {blocks}");
    assert!(patch.len() == side * side, "a patch of {side} x {side}");
    let count = blocks * blocks;
    assert!(gradients.len() == DIRECTIONS * count && squares.len() == 4 * count, "8 and 4 values a block");
    if blocks == AT_ONCE {
        return histograms::<V>(patch, AT_ONCE * BLOCK + 2, AT_ONCE, gradients, squares); // with numbers that are known
    }
    if blocks.is_multiple_of(AT_ONCE) {
        return histograms::<V>(patch, side, blocks, gradients, squares);
    }
    // Filled up with zeros, whose sums are not written.
    let mut room = [0.0; WIDEST * WIDEST];
    for (line, room) in patch.chunks_exact(side).zip(room.chunks_exact_mut(WIDEST)) {
        room[..side].copy_from_slice(line);
    }
    histograms::<V>(&room, WIDEST, blocks, gradients, squares)
}

/// Blocks beside each other that are summed at once, and their pixels.
pub(crate) const AT_ONCE: usize = 4;
pub(crate) const WIDTH: usize = AT_ONCE * BLOCK;
/// The side of the largest patch.
const WIDEST: usize = MOST_BLOCKS * BLOCK + 2;

/// For a patch with rows `stride` apart that are as long as whole strips of blocks.
#[inline(always)]
fn histograms<const V: u8>(patch: &[f32], stride: usize, blocks: usize, gradients: &mut [f32], squares: &mut [f32]) {
    for (block, first) in (0..blocks).flat_map(|block| (0..blocks).step_by(AT_ONCE).map(move |first| (block, first))) {
        let count = AT_ONCE.min(blocks - first);
        let (mut strip, mut fours) = ([0.0; AT_ONCE * DIRECTIONS], [[0.0; WIDTH / 2]; 2]);
        sum_strip::<V>(&patch[block * BLOCK * stride + first * BLOCK..], stride, &mut strip, &mut fours);
        put(&strip, count, &mut gradients[(block * blocks + first) * DIRECTIONS..]);
        for (row, fours) in fours.iter().enumerate() {
            put(fours, count, &mut squares[(2 * block + row) * 2 * blocks + 2 * first..]);
        }
    }
}

/// For a strip of blocks with its border: the directions, block after block, and two rows of sums of four.
#[inline(always)]
fn sum_strip<const V: u8>(
    patch: &[f32],
    stride: usize,
    strip: &mut [f32; AT_ONCE * DIRECTIONS],
    fours: &mut [[f32; WIDTH / 2]; 2],
) {
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    if V == FUSED {
        for (k, strip) in strip.as_chunks_mut().0.iter_mut().enumerate() {
            let cells = columns::Cells::new::<BLOCK>(&patch[k * columns::COLUMNS..], stride);
            // SAFETY: by `V` the caller is compiled for the instructions, and runs only where they are there.
            unsafe {
                columns::blocks(&cells.gradients::<BLOCK>(), strip);
                for (half, fours) in fours.iter_mut().enumerate() {
                    cells.squares(half * (BLOCK / 2), &mut fours.as_chunks_mut().0[k]);
                }
            }
        }
        return;
    }
    let mut sums = [[0.0; WIDTH]; DIRECTIONS];
    for (half, fours) in fours.iter_mut().enumerate() {
        let mut pairs = [0.0; WIDTH];
        for row in 0..BLOCK / 2 {
            let top = half * (BLOCK / 2) + row;
            let rows: [&[f32; WIDTH + 2]; 3] =
                std::array::from_fn(|i| patch[(top + i) * stride..].first_chunk().expect("as wide as whole strips"));
            add_gradients::<V>(&rows, &mut sums);
            for (x, pair) in pairs.iter_mut().enumerate() {
                *pair += rows[1][x + 1] + rows[1][x + 2];
            }
        }
        *fours = std::array::from_fn(|x| pairs[2 * x]);
    }
    *strip = across::<V>(&sums);
}

/// Sums over each block's columns, (0 + 1) + (2 + 3): the directions of one block after those of another.
#[inline(always)]
fn across<const V: u8>(sums: &[[f32; WIDTH]; DIRECTIONS]) -> [f32; AT_ONCE * DIRECTIONS] {
    let mut out = [0.0; AT_ONCE * DIRECTIONS];
    #[cfg(target_arch = "x86_64")]
    if V >= AVX512 {
        use std::arch::x86_64::*;
        // SAFETY: by `V` the caller is compiled for AVX-512, and runs only where it is there.
        unsafe {
            // Four directions of four columns become four columns of four directions, in each quarter, which is a block.
            let mut halves = [_mm512_setzero_ps(); 2];
            for (half, sums) in halves.iter_mut().zip(sums.chunks_exact(DIRECTIONS / 2)) {
                let (a, b) = (_mm512_loadu_ps(sums[0].as_ptr()), _mm512_loadu_ps(sums[1].as_ptr()));
                let (c, d) = (_mm512_loadu_ps(sums[2].as_ptr()), _mm512_loadu_ps(sums[3].as_ptr()));
                let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
                let first = _mm512_add_ps(_mm512_shuffle_ps::<0x44>(ab, cd), _mm512_shuffle_ps::<0xee>(ab, cd));
                let (ab, cd) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
                let second = _mm512_add_ps(_mm512_shuffle_ps::<0x44>(ab, cd), _mm512_shuffle_ps::<0xee>(ab, cd));
                *half = _mm512_add_ps(first, second);
            }
            let [a, b] = halves;
            let near = _mm512_setr_epi32(0, 1, 2, 3, 16, 17, 18, 19, 4, 5, 6, 7, 20, 21, 22, 23);
            let far = _mm512_setr_epi32(8, 9, 10, 11, 24, 25, 26, 27, 12, 13, 14, 15, 28, 29, 30, 31);
            _mm512_storeu_ps(out.as_mut_ptr(), _mm512_permutex2var_ps(a, near, b));
            _mm512_storeu_ps(out[16..].as_mut_ptr(), _mm512_permutex2var_ps(a, far, b));
        }
        return out;
    }
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    {
        use std::arch::wasm32::*;
        // Four directions of a block's four columns become four columns of four directions.
        for (place, out) in out.chunks_exact_mut(DIRECTIONS / 2).enumerate() {
            let (block, half) = (place / 2, place % 2);
            let four = &sums[half * (DIRECTIONS / 2)..];
            // SAFETY: four values of a block's four, and of `out`.
            unsafe {
                let [a, b, c, d] = [0, 1, 2, 3].map(|k| v128_load(four[k][block * BLOCK..].as_ptr().cast()));
                let (ab, cd) = (i32x4_shuffle::<0, 4, 1, 5>(a, b), i32x4_shuffle::<0, 4, 1, 5>(c, d));
                let first = f32x4_add(i64x2_shuffle::<0, 2>(ab, cd), i64x2_shuffle::<1, 3>(ab, cd));
                let (ab, cd) = (i32x4_shuffle::<2, 6, 3, 7>(a, b), i32x4_shuffle::<2, 6, 3, 7>(c, d));
                let second = f32x4_add(i64x2_shuffle::<0, 2>(ab, cd), i64x2_shuffle::<1, 3>(ab, cd));
                v128_store(out.as_mut_ptr().cast(), f32x4_add(first, second));
            }
        }
        return out;
    }
    #[allow(unreachable_code)]
    for (column, out) in out.chunks_exact_mut(DIRECTIONS).enumerate() {
        for (out, sums) in out.iter_mut().zip(sums) {
            let s: [f32; BLOCK] = std::array::from_fn(|x| sums[column * BLOCK + x]);
            *out = (s[0] + s[1]) + (s[2] + s[3]);
        }
    }
    out
}

/// Copies `count` of a strip's blocks.
#[inline(always)]
fn put<const N: usize>(from: &[f32; N], count: usize, to: &mut [f32]) {
    match to.first_chunk_mut().filter(|_| count == AT_ONCE) {
        Some(to) => *to = *from,
        None => to[..N / AT_ONCE * count].copy_from_slice(&from[..N / AT_ONCE * count]),
    }
}

/// cos 45°.
const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Adds max(0, g · eₖ − |g| cos 45°) to the sums of direction k, with g the gradients of the middle one of three rows.
#[inline(always)]
pub(crate) fn add_gradients<const V: u8>(
    [above, here, below]: &[&[f32; WIDTH + 2]; 3],
    sums: &mut [[f32; WIDTH]; DIRECTIONS],
) {
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    {
        use std::arch::wasm32::*;
        let (half, minus) = (f32x4_splat(HALF), f32x4_splat(-HALF));
        for four in (0..WIDTH).step_by(4) {
            // SAFETY: rows have two values more than sums.
            unsafe {
                let at = |row: &[f32; WIDTH + 2], x: usize| v128_load(row[four + x..].as_ptr().cast());
                let gx = f32x4_sub(at(here, 2), at(here, 0));
                let gy = f32x4_sub(at(below, 1), at(above, 1));
                let less = f32x4_mul(minus, f32x4_sqrt(f32x4_add(f32x4_mul(gx, gx), f32x4_mul(gy, gy))));
                let down = f32x4_add(f32x4_mul(gy, half), less);
                let up = f32x4_add(f32x4_mul(gy, minus), less);
                let (right, left) = (f32x4_mul(gx, half), f32x4_mul(gx, minus));
                let along = [
                    f32x4_add(gx, less),
                    f32x4_add(right, down),
                    f32x4_add(gy, less),
                    f32x4_add(left, down),
                    f32x4_sub(less, gx),
                    f32x4_add(left, up),
                    f32x4_sub(less, gy),
                    f32x4_add(right, up),
                ];
                for (sums, along) in sums.iter_mut().zip(along) {
                    let sums = sums[four..].as_mut_ptr().cast();
                    v128_store(sums, f32x4_add(v128_load(sums), f32x4_pmax(f32x4_splat(0.0), along)));
                }
            }
        }
        return;
    }
    #[allow(unreachable_code)]
    let gx: [f32; WIDTH] = std::array::from_fn(|x| here[x + 2] - here[x]);
    let gy: [f32; WIDTH] = std::array::from_fn(|x| below[x + 1] - above[x + 1]);
    for x in 0..WIDTH {
        let (gx, gy) = (gx[x], gy[x]);
        let less = -HALF * multiply_add::<V>(gx, gx, gy * gy).sqrt();
        let (down, up) = (multiply_add::<V>(gy, HALF, less), multiply_add::<V>(gy, -HALF, less));
        let along = [
            gx + less,
            multiply_add::<V>(gx, HALF, down),
            gy + less,
            multiply_add::<V>(gx, -HALF, down),
            less - gx,
            multiply_add::<V>(gx, -HALF, up),
            less - gy,
            multiply_add::<V>(gx, HALF, up),
        ];
        for (sums, along) in sums.iter_mut().zip(along) {
            sums[x] += greater(along, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;
    use crate::sums::tests::values;

    #[test]
    fn agree_with_the_twin() {
        for blocks in [1, 3, 4, 5, 8] {
            let side = 4 * blocks + 2;
            let patch = values(side * side, 1);
            let at = |x: usize, y: usize| f64::from(patch[y * side + x]);
            for level in Level::all() {
                let mut out = vec![f32::NAN; 12 * blocks * blocks];
                let (gradients, squares) = out.split_at_mut(8 * blocks * blocks);
                oriented_at(level, &patch, blocks, gradients, squares);
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
        let mut gradients = [0.0; 32];
        oriented(&patch, 2, &mut gradients, &mut [0.0; 16]);
        for block in gradients.chunks(DIRECTIONS) {
            assert!((block[0] - 16.0 * 0.2 * (1.0 - std::f32::consts::FRAC_1_SQRT_2)).abs() < 1e-5, "{block:?}");
            assert!(block[2..7].iter().all(|&other| other == 0.0), "{block:?}");
        }
    }
}
