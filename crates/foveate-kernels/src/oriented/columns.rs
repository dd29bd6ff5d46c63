//! As many columns of cells at a time as leave registers for their eight sums: eight with AVX, four with NEON.

use super::{DIRECTIONS, HALF};
use crate::lanes::{
    self, Lanes, add, add_product, even, load, max, odd, pairs, put, put_even, root, splat, subtract, subtract_product,
    times,
};

/// Columns that are summed at once.
pub(crate) const COLUMNS: usize = lanes::N;

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
    /// The processor has the instructions, `row` is at most `ROWS + 1`, and `left` at most 2.
    #[inline(always)]
    unsafe fn row(&self, row: usize, left: usize) -> Lanes {
        // SAFETY: `new` found all rows with their border.
        unsafe { load(self.cells.as_ptr().add(row * self.stride + left)) }
    }

    /// Sums of gradient of each column over `ROWS` rows, as `add_gradients` has them.
    ///
    /// # Safety
    /// The processor has the instructions, and there are so many rows.
    #[inline(always)]
    pub(crate) unsafe fn gradients<const ROWS: usize>(&self) -> [Lanes; DIRECTIONS] {
        // SAFETY: the caller's word.
        unsafe {
            let (zero, half) = (splat(0.0), splat(HALF));
            let mut sums = [zero; DIRECTIONS];
            for row in 0..ROWS {
                let gx = subtract(self.row(row + 1, 2), self.row(row + 1, 0));
                let gy = subtract(self.row(row + 2, 1), self.row(row, 1));
                let less = times(splat(-HALF), root(add_product(times(gy, gy), gx, gx)));
                let (down, up) = (add_product(less, gy, half), subtract_product(less, gy, half));
                let along = [
                    add(gx, less),
                    add_product(down, gx, half),
                    add(gy, less),
                    subtract_product(down, gx, half),
                    subtract(less, gx),
                    subtract_product(up, gx, half),
                    subtract(less, gy),
                    add_product(up, gx, half),
                ];
                for (sum, along) in sums.iter_mut().zip(along) {
                    *sum = add(*sum, max(along, zero));
                }
            }
            sums
        }
    }

    /// `out` ← the sums of each 2 × 2 cells of two rows, from this one on.
    ///
    /// # Safety
    /// The processor has the instructions, and there are so many rows.
    #[inline(always)]
    pub(crate) unsafe fn squares(&self, row: usize, out: &mut [f32; COLUMNS / 2]) {
        // SAFETY: the caller's word, and `out` has room for all.
        unsafe {
            let pairs = |row: usize| add(self.row(row, 1), self.row(row, 2));
            put_even(add(pairs(row + 1), pairs(row + 2)), out.as_mut_ptr());
        }
    }
}

/// Sums over each four columns, (0 + 1) + (2 + 3): the directions of one block after those of another.
///
/// # Safety
/// The processor has the instructions.
#[inline(always)]
pub(crate) unsafe fn blocks(sums: &[Lanes; DIRECTIONS], out: &mut [f32; COLUMNS / 4 * DIRECTIONS]) {
    for (half, &[a, b, c, d]) in sums.as_chunks().0.iter().enumerate() {
        // SAFETY: the caller's word, and `out` has room for two halves a block.
        unsafe { put(pairs(pairs(a, b), pairs(c, d)), out[4 * half..].as_mut_ptr(), DIRECTIONS) }
    }
}

/// Sums over each two columns: the directions of one half block after those of another.
///
/// # Safety
/// The processor has the instructions.
#[inline(always)]
pub(crate) unsafe fn half_blocks(sums: &[Lanes; DIRECTIONS], out: &mut [f32; COLUMNS / 2 * DIRECTIONS]) {
    for (half, &[a, b, c, d]) in sums.as_chunks().0.iter().enumerate() {
        // SAFETY: the caller's word, and `out` has room for two halves a half block.
        unsafe {
            let (ab, cd) = (pairs(a, b), pairs(c, d));
            put(even(ab, cd), out[4 * half..].as_mut_ptr(), 2 * DIRECTIONS);
            put(odd(ab, cd), out[DIRECTIONS + 4 * half..].as_mut_ptr(), 2 * DIRECTIONS);
        }
    }
}
