//! Eight columns of cells at a time, with their eight sums in registers: of sixteen columns, AVX has no room for all sums.

use std::arch::x86_64::*;

use super::{DIRECTIONS, HALF};

/// Columns that are summed at once.
pub(crate) const COLUMNS: usize = 8;

/// Cells of [`COLUMNS`] columns, with a border of one around them.
#[derive(Clone, Copy)]
pub(crate) struct Cells<'a> {
    /// The border's first cell, and all up to its last.
    cells: &'a [f32],
    stride: usize,
}

impl<'a> Cells<'a> {
    /// `ROWS` rows of cells, `stride` apart, whose border begins with the first value.
    #[inline(always)]
    pub(crate) fn new<const ROWS: usize>(cells: &'a [f32], stride: usize) -> Self {
        Self { cells: &cells[..(ROWS + 1) * stride + COLUMNS + 2], stride }
    }

    /// The values from `left` on in a row, of which the border is the first.
    ///
    /// # Safety
    /// The processor has AVX, `row` is at most `ROWS + 1`, and `left` at most 2.
    #[inline(always)]
    unsafe fn row(&self, row: usize, left: usize) -> __m256 {
        // SAFETY: `new` found all rows with their border.
        unsafe { _mm256_loadu_ps(self.cells.as_ptr().add(row * self.stride + left)) }
    }

    /// Sums of gradient of each column over `ROWS` rows, as `add_gradients` has them.
    ///
    /// # Safety
    /// The processor has AVX and FMA, and there are so many rows.
    #[inline(always)]
    pub(crate) unsafe fn gradients<const ROWS: usize>(&self) -> [__m256; DIRECTIONS] {
        // SAFETY: the caller's word.
        unsafe {
            let (zero, half) = (_mm256_setzero_ps(), _mm256_set1_ps(HALF));
            let mut sums = [zero; DIRECTIONS];
            for row in 0..ROWS {
                let gx = _mm256_sub_ps(self.row(row + 1, 2), self.row(row + 1, 0));
                let gy = _mm256_sub_ps(self.row(row + 2, 1), self.row(row, 1));
                let length = _mm256_sqrt_ps(_mm256_fmadd_ps(gx, gx, _mm256_mul_ps(gy, gy)));
                let less = _mm256_mul_ps(_mm256_set1_ps(-HALF), length);
                let (down, up) = (_mm256_fmadd_ps(gy, half, less), _mm256_fnmadd_ps(gy, half, less));
                let along = [
                    _mm256_add_ps(gx, less),
                    _mm256_fmadd_ps(gx, half, down),
                    _mm256_add_ps(gy, less),
                    _mm256_fnmadd_ps(gx, half, down),
                    _mm256_sub_ps(less, gx),
                    _mm256_fnmadd_ps(gx, half, up),
                    _mm256_sub_ps(less, gy),
                    _mm256_fmadd_ps(gx, half, up),
                ];
                for (sum, along) in sums.iter_mut().zip(along) {
                    *sum = _mm256_add_ps(*sum, _mm256_max_ps(along, zero));
                }
            }
            sums
        }
    }

    /// `out` ← the sums of each 2 × 2 cells of two rows, from this one on.
    ///
    /// # Safety
    /// The processor has AVX, and there are so many rows.
    #[inline(always)]
    pub(crate) unsafe fn squares(&self, row: usize, out: &mut [f32; COLUMNS / 2]) {
        // SAFETY: the caller's word, and `out` has room for all.
        unsafe {
            let pairs = |row: usize| _mm256_add_ps(self.row(row, 1), self.row(row, 2));
            let sums = _mm256_add_ps(pairs(row + 1), pairs(row + 2));
            let (low, high) = (_mm256_castps256_ps128(sums), _mm256_extractf128_ps::<1>(sums));
            _mm_storeu_ps(out.as_mut_ptr(), _mm_shuffle_ps::<0b10_00_10_00>(low, high));
        }
    }
}

/// Sums over each four columns, (0 + 1) + (2 + 3): the directions of one block after those of the other.
///
/// # Safety
/// The processor has AVX.
#[inline(always)]
pub(crate) unsafe fn blocks(sums: &[__m256; DIRECTIONS], out: &mut [f32; 2 * DIRECTIONS]) {
    let [a, b, c, d, e, f, g, h] = *sums;
    // SAFETY: the caller's word, and `out` has room for four halves.
    unsafe {
        let first = _mm256_hadd_ps(_mm256_hadd_ps(a, b), _mm256_hadd_ps(c, d));
        let second = _mm256_hadd_ps(_mm256_hadd_ps(e, f), _mm256_hadd_ps(g, h));
        _mm256_storeu_ps(out.as_mut_ptr(), _mm256_permute2f128_ps::<0x20>(first, second));
        _mm256_storeu_ps(out[DIRECTIONS..].as_mut_ptr(), _mm256_permute2f128_ps::<0x31>(first, second));
    }
}

/// Sums over each two columns: the directions of one half block after those of another.
///
/// # Safety
/// The processor has AVX.
#[inline(always)]
pub(crate) unsafe fn half_blocks(sums: &[__m256; DIRECTIONS], out: &mut [f32; 4 * DIRECTIONS]) {
    let [a, b, c, d, e, f, g, h] = *sums;
    // SAFETY: the caller's word, and `out` has room for eight halves.
    unsafe {
        let mut put = |half: usize, [a, b, c, d]: [__m256; 4]| {
            let (ab, cd) = (_mm256_hadd_ps(a, b), _mm256_hadd_ps(c, d));
            let even = _mm256_shuffle_ps::<0b10_00_10_00>(ab, cd);
            let odd = _mm256_shuffle_ps::<0b11_01_11_01>(ab, cd);
            for (k, sums) in [even, odd].into_iter().enumerate() {
                let at = out[k * DIRECTIONS + 4 * half..].as_mut_ptr();
                _mm_storeu_ps(at, _mm256_castps256_ps128(sums));
                _mm_storeu_ps(at.add(2 * DIRECTIONS), _mm256_extractf128_ps::<1>(sums));
            }
        };
        put(0, [a, b, c, d]);
        put(1, [e, f, g, h]);
    }
}
