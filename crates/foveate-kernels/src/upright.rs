//! Bilinear reads at the cells of a grid that is not turned: each row of cells lies in two rows of samples, and each column
//! at the same place in all of them, so that samples are picked from whole vectors instead of one at a time.

use std::arch::x86_64::*;

use crate::level::multiply_add;
use crate::plane::{CELLS, Plane, padded};

/// Vectors of cells along a side, at most.
const PARTS: usize = 4;
/// Pairs of vectors of samples that the cells of one vector may be spread over, at most.
const MOST_PAIRS: usize = 4;

/// Cells that are rows of the same `du`, each row of one `dv`.
pub(crate) struct Grid {
    columns: usize,
    rows: usize,
    /// Columns that are read at a time.
    size: usize,
    across: [[f32; CELLS]; PARTS],
    down: [[f32; CELLS]; PARTS],
}

impl Grid {
    /// The grid that these cells are, if they are one, of at most 64 rows and columns and at least two columns.
    pub(crate) fn of(du: &[f32], dv: &[f32]) -> Option<Self> {
        let columns = dv.iter().take_while(|v| **v == dv[0]).count();
        if !(2..=PARTS * CELLS).contains(&columns) || !du.len().is_multiple_of(columns) {
            return None;
        }
        let rows = du.len() / columns;
        let mut lines = du.chunks(columns).zip(dv.chunks(columns));
        if rows > PARTS * CELLS || !lines.all(|(u, v)| u == &du[..columns] && v.iter().all(|other| *other == v[0])) {
            return None;
        }
        let size = columns.div_ceil(columns.div_ceil(CELLS));
        let (mut across, mut down) = ([[0.0; CELLS]; PARTS], [[0.0; CELLS]; PARTS]);
        across.iter_mut().zip(du[..columns].chunks(size)).for_each(|(across, du)| *across = padded(du));
        (0..rows).for_each(|row| down[row / CELLS][row % CELLS] = dv[row * columns]);
        Some(Self { columns, rows, size, across, down })
    }

    /// Reads the cells under a map without rotation. Returns `false`, with some values undefined, if they are spread
    /// too far.
    ///
    /// # Safety
    /// The processor has AVX-512, and the plane has been checked, and has two columns and two rows at least.
    #[inline(always)]
    pub(crate) unsafe fn read<const V: u8>(&self, plane: &Plane<'_>, map: &[f32; 6], out: &mut [f32]) -> bool {
        let &[cx, cy, ux, _, _, vy] = map;
        let (mut row, mut fy) = ([0; PARTS * CELLS], [0.0; PARTS * CELLS]);
        for (k, down) in self.down[..self.rows.div_ceil(CELLS)].iter().enumerate() {
            let (at, fraction) = along::<V>(cy - plane.y0, vy, down, plane.height);
            for i in 0..CELLS {
                row[k * CELLS + i] = at[i] * plane.stride as i32;
                fy[k * CELLS + i] = fraction[i];
            }
        }
        let mut column = 0;
        for across in &self.across[..self.columns.div_ceil(self.size)] {
            let (at, fx) = along::<V>(cx - plane.x0, ux, across, plane.width);
            // SAFETY: the caller's word; `along` gives samples that have others to the right and below.
            unsafe {
                let at = _mm512_loadu_si512(at.as_ptr().cast());
                let first = _mm512_reduce_min_epi32(at);
                let spread = (_mm512_reduce_max_epi32(at) - first) as usize + 2;
                let columns = Columns {
                    data: plane.data.as_ptr().add(first as usize),
                    stride: plane.stride,
                    spread,
                    at: _mm512_sub_epi32(at, _mm512_set1_epi32(first)),
                    fx: _mm512_loadu_ps(fx.as_ptr()),
                    count: self.size.min(self.columns - column),
                };
                let (row, fy, out) = (&row[..self.rows], &fy[..self.rows], &mut out[column..]);
                match spread.div_ceil(2 * CELLS) {
                    1 => columns.read::<1>(row, fy, out, self.columns),
                    2 => columns.read::<2>(row, fy, out, self.columns),
                    3 => columns.read::<3>(row, fy, out, self.columns),
                    MOST_PAIRS => columns.read::<MOST_PAIRS>(row, fy, out, self.columns),
                    _ => return false,
                }
            }
            column += self.size;
        }
        true
    }
}

/// Position of `origin + step · d` on a side of so many samples: the sample before it, at most the last but one if
/// there are two, and the fraction to the next.
#[inline(always)]
fn along<const V: u8>(origin: f32, step: f32, d: &[f32; CELLS], side: usize) -> ([i32; CELLS], [f32; CELLS]) {
    let (end, last) = ((side - 1) as f32, side.saturating_sub(2) as i32);
    let (mut at, mut fraction) = ([0; CELLS], [0.0; CELLS]);
    for i in 0..CELLS {
        let x = multiply_add::<V>(step, d[i], origin).max(0.0).min(end);
        // SAFETY: x is a number from 0 to below 2^31: `max` takes the number where the other is none.
        let before = unsafe { x.to_int_unchecked::<i32>() }.min(last);
        (at[i], fraction[i]) = (before, x - before as f32);
    }
    (at, fraction)
}

/// Columns of cells that are read together.
struct Columns {
    /// The sample of the leftmost, in the first row.
    data: *const f32,
    stride: usize,
    /// Samples from there to the last that is needed.
    spread: usize,
    /// Places of the samples to the left of the cells, from `data` on.
    at: __m512i,
    fx: __m512,
    count: usize,
}

impl Columns {
    /// Interpolates at the cells of each row; its samples begin at `row`. The output stride is `columns`.
    ///
    /// # Safety
    /// The processor has AVX-512; the samples lie in a plane, and are spread over at most 32 · `PAIRS`.
    #[inline(always)]
    unsafe fn read<const PAIRS: usize>(&self, row: &[i32], fy: &[f32], out: &mut [f32], columns: usize) {
        let (mut needed, mut left_in, mut right_in) = ([[0u16; 2]; PAIRS], [0u16; PAIRS], [0u16; PAIRS]);
        // SAFETY: the caller's word. Loads and stores are masked: of samples to those needed, of cells to those there are.
        unsafe {
            let (left, right) = (self.at, _mm512_add_epi32(self.at, _mm512_set1_epi32(1)));
            for k in 0..PAIRS {
                for (half, needed) in needed[k].iter_mut().enumerate() {
                    let rest = self.spread.saturating_sub((2 * k + half) * CELLS).min(CELLS);
                    *needed = ((1u32 << rest) - 1) as u16;
                }
                let this = _mm512_set1_epi32(k as i32);
                left_in[k] = _mm512_cmpeq_epi32_mask(_mm512_srli_epi32::<5>(left), this);
                right_in[k] = _mm512_cmpeq_epi32_mask(_mm512_srli_epi32::<5>(right), this);
            }
            let cells = ((1u32 << self.count) - 1) as u16;
            for ((row, fy), out) in row.iter().zip(fy).zip(out.chunks_mut(columns)) {
                let above = self.data.add(*row as usize);
                let mut lines = [_mm512_setzero_ps(); 2];
                for (line, from) in lines.iter_mut().zip([above, above.add(self.stride)]) {
                    let (mut a, mut b) = (_mm512_setzero_ps(), _mm512_setzero_ps());
                    for k in 0..PAIRS {
                        let near = _mm512_maskz_loadu_ps(needed[k][0], from.wrapping_add(2 * k * CELLS));
                        let far = _mm512_maskz_loadu_ps(needed[k][1], from.wrapping_add((2 * k + 1) * CELLS));
                        // The last five bits choose among the 32 samples.
                        let (chosen_a, chosen_b) =
                            (_mm512_permutex2var_ps(near, left, far), _mm512_permutex2var_ps(near, right, far));
                        if PAIRS == 1 {
                            (a, b) = (chosen_a, chosen_b);
                        } else {
                            a = _mm512_mask_mov_ps(a, left_in[k], chosen_a);
                            b = _mm512_mask_mov_ps(b, right_in[k], chosen_b);
                        }
                    }
                    *line = _mm512_fmadd_ps(self.fx, _mm512_sub_ps(b, a), a);
                }
                let [above, below] = lines;
                let value = _mm512_fmadd_ps(_mm512_set1_ps(*fy), _mm512_sub_ps(below, above), above);
                _mm512_mask_storeu_ps(out[..self.count].as_mut_ptr(), cells, value);
            }
        }
    }
}
