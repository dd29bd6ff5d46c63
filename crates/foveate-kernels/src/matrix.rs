//! Products of matrices.
//!
//! A stretch of the inner side at a time, the right matrix is packed in tiles of columns, and a block of rows of the left one
//! times a tile stays in registers. Where most of the left matrix is 0, its rows are multiplied one by one without their zeros.
//! Sums run over the inner side in one order, so that an entry depends on its own row and column alone, to the last bit, however
//! many others there are.

use crate::level::{Level, fused, levels, multiply_add};
use crate::tile::{self, BLOCK, Kernel, Line, TILE};
use crate::zeros::{self, DEPTH, Present, TOGETHER};

/// A matrix in memory: entry (i, j) is `data[i · down + j · across]`.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a, T> {
    data: &'a [T],
    rows: usize,
    columns: usize,
    down: usize,
    across: usize,
}

impl<'a, T: Copy> Matrix<'a, T> {
    /// Rows of `columns` values each, one after the other.
    ///
    /// # Panics
    /// If `data` are not whole rows, or `columns` is 0.
    pub fn new(data: &'a [T], columns: usize) -> Self {
        assert!(
            columns > 0 && data.len().is_multiple_of(columns),
            "{} values are not whole rows of {columns}",
            data.len()
        );
        Self { data, rows: data.len() / columns, columns, down: columns, across: 1 }
    }

    /// Columns become rows.
    #[must_use]
    pub fn transposed(self) -> Self {
        Self { rows: self.columns, columns: self.rows, down: self.across, across: self.down, ..self }
    }

    /// `count` columns, from `first` on.
    ///
    /// # Panics
    /// If it has fewer.
    #[must_use]
    pub fn columns(self, first: usize, count: usize) -> Self {
        assert!(
            count <= self.columns && first <= self.columns - count,
            "{count} columns from {first} on, of {}",
            self.columns
        );
        let data = self.data.get(first * self.across..).unwrap_or_default();
        Self { data, columns: count, ..self }
    }
}

/// What a product does with its output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Write {
    /// Output ← product.
    Replace,
    /// Output += product.
    Add,
}

/// Where a product goes: entry (i, j) is `data[i · down + j · across]`.
struct Out<'a, T> {
    data: &'a mut [T],
    columns: usize,
    down: usize,
    across: usize,
}

/// `out` (m × n) ← or += `factor` · `left` (m × k) · `right` (k × n). Allocates nothing.
///
/// Faster where most of `left` is 0; 0 times what is not finite is NaN or 0.
///
/// # Panics
/// If the sizes do not agree.
pub fn matrix_product(left: Matrix<'_, f32>, right: Matrix<'_, f32>, factor: f32, write: Write, out: &mut [f32]) {
    product(Level::best(), left, right, factor, write, out);
}

fn product(level: Level, left: Matrix<'_, f32>, right: Matrix<'_, f32>, factor: f32, write: Write, out: &mut [f32]) {
    let out = start(&left, &right, write, out);
    // Columns that lie one after the other take longer to pack: for few rows the other matrix is packed.
    let (left, right, out) = if right.across != 1 && left.rows <= COLUMNS {
        (
            right.transposed(),
            left.transposed(),
            Out { data: out.data, columns: left.rows, down: out.across, across: out.down },
        )
    } else {
        (left, right, out)
    };
    if right.columns <= COLUMNS || left.rows <= ROWS {
        strips_at(level, left, right, factor, out);
    } else {
        tiles_at(level, Kernel::F32(level), left, right, factor, out);
    }
}

/// `out` (m × n) ← or += `left` (m × k) · `right` (k × n) in f64. Allocates nothing.
///
/// # Panics
/// If the sizes do not agree.
pub fn matrix_product_f64(left: Matrix<'_, f64>, right: Matrix<'_, f64>, write: Write, out: &mut [f64]) {
    product_f64(Level::best(), left, right, write, out);
}

fn product_f64(level: Level, left: Matrix<'_, f64>, right: Matrix<'_, f64>, write: Write, out: &mut [f64]) {
    let out = start(&left, &right, write, out);
    strips_f64_at(level, left, right, 1.0, out);
}

/// Checks the sizes, and sets the output to 0 unless the product is added to it.
fn start<'a, T: Default + Copy>(
    left: &Matrix<'_, T>,
    right: &Matrix<'_, T>,
    write: Write,
    out: &'a mut [T],
) -> Out<'a, T> {
    assert_eq!(left.columns, right.rows, "the inner sides of a product");
    assert_eq!(out.len(), left.rows * right.columns, "the product is {} x {}", left.rows, right.columns);
    if write == Write::Replace {
        out.fill(T::default());
    }
    Out { data: out, columns: right.columns, down: right.columns, across: 1 }
}

#[inline(always)]
fn tiles_body<const V: u8>(
    kernel: Kernel,
    left: Matrix<'_, f32>,
    right: Matrix<'_, f32>,
    factor: f32,
    mut out: Out<'_, f32>,
) {
    let mut work = Work { kernel, lines: [Line([0; 16]); 4 * DEPTH], present: Present::NONE };
    // Stretches of about one length.
    let stretches = left.columns.div_ceil(DEPTH);
    for stretch in 0..stretches {
        let first = stretch * left.columns / stretches;
        let depth = (stretch + 1) * left.columns / stretches - first;
        // Packing the tile or taking up the rows: what takes longer is done once.
        if left.across == 1 {
            let words = bits(left.data).get(first..).unwrap_or_default();
            let whole = zeros::split(words, left.down, left.rows, depth) == 0;
            let together = if whole { left.rows.max(1) } else { TOGETHER };
            for from in (0..left.rows).step_by(together) {
                let (words, count) = (&words[from * left.down..], together.min(left.rows - from));
                work.multiply::<V>((words, left.down), (first, depth), right, factor, (from, count), &mut out);
            }
        } else {
            let mut words = [0; TOGETHER * DEPTH];
            for from in (0..left.rows).step_by(TOGETHER) {
                let count = TOGETHER.min(left.rows - from);
                turn(&left.data[first * left.across + from..], left.across, (depth, count), |row, k, values| {
                    words[row * depth + k..][..values.len()].copy_from_slice(values);
                });
                work.multiply::<V>((&words, depth), (first, depth), right, factor, (from, count), &mut out);
            }
        }
    }
}

/// Scratch of a product.
struct Work {
    kernel: Kernel,
    lines: [Line; 4 * DEPTH],
    present: Present,
}

impl Work {
    /// Adds the product of rows `from ..`, whose words begin every `stride`, and columns, both of a stretch.
    #[inline(always)]
    fn multiply<const V: u8>(
        &mut self,
        (words, stride): (&[u32], usize),
        (first, depth): (usize, usize),
        right: Matrix<'_, f32>,
        factor: f32,
        (from, count): (usize, usize),
        out: &mut Out<'_, f32>,
    ) {
        let Self { kernel, lines, present } = self;
        let lines = &mut lines[..4 * depth];
        present.find(words, stride, count, depth);
        let split = present.split;
        for column in (0..right.columns).step_by(TILE) {
            pack(right, first, column, lines);
            for row in (0..count).step_by(BLOCK) {
                let (rows, words) = (BLOCK.min(count - row), &words[row * stride..]);
                let mut sums = [[0.0; TILE]; BLOCK];
                if split == 0 {
                    tile::multiply::<false>(*kernel, rows, stride, words, lines, &mut sums);
                } else {
                    present.multiply::<V>((row, rows), stride, words, lines, &mut sums);
                    tile::multiply::<true>(*kernel, rows, stride, &words[split..], &lines[4 * split..], &mut sums);
                }
                add(&sums[..rows], factor, (from + row, column), out);
            }
        }
    }
}

levels! {
    fn tiles_at(kernel: Kernel, left: Matrix<'_, f32>, right: Matrix<'_, f32>, factor: f32, out: Out<'_, f32>) = tiles_body
}

/// Rows from `first` on of the columns of a tile from `column` on; columns that are not there are 0.
#[inline(always)]
fn pack(right: Matrix<'_, f32>, first: usize, column: usize, lines: &mut [Line]) {
    let width = TILE.min(right.columns - column);
    if width < TILE {
        lines.fill(Line([0; 16]));
    }
    if right.across == 1 {
        for (k, lines) in lines.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let row = &right.data[(first + k) * right.down + column..][..width];
            for (line, row) in lines.iter_mut().zip(row.chunks(16)) {
                line.0.iter_mut().zip(row).for_each(|(word, w)| *word = w.to_bits());
            }
        }
    } else {
        // As many lines as stay in the nearest cache while all columns are written to them.
        for (part, lines) in lines.chunks_mut(4 * 16).enumerate() {
            let depth = lines.len() / 4;
            let start = column * right.across + first + 16 * part;
            turn(&right.data[start..], right.across, (width, depth), |k, c, values| {
                lines[4 * k + c / 16].0[c % 16..][..values.len()].copy_from_slice(values);
            });
        }
    }
}

/// Turns rows (one every `stride` values) by `columns` values: gives `to` the columns in pieces of up to 4 values, with the
/// column and the row where a piece begins. Row 16 and its multiples begin a piece.
#[inline(always)]
fn turn(from: &[f32], stride: usize, (rows, columns): (usize, usize), mut to: impl FnMut(usize, usize, &[u32])) {
    let mut row = 0;
    while row + 4 <= rows {
        let lines: [&[f32]; 4] = std::array::from_fn(|r| &from[(row + r) * stride..][..columns]);
        let [a, b, c, d] = lines.map(|line| line.as_chunks::<4>().0);
        for (i, (((a, b), c), d)) in a.iter().zip(b).zip(c).zip(d).enumerate() {
            for j in 0..4 {
                to(4 * i + j, row, &[a[j], b[j], c[j], d[j]].map(f32::to_bits));
            }
        }
        for k in columns / 4 * 4..columns {
            to(k, row, &lines.map(|line| line[k].to_bits()));
        }
        row += 4;
    }
    for row in row..rows {
        for (k, value) in from[row * stride..][..columns].iter().enumerate() {
            to(k, row, &[value.to_bits()]);
        }
    }
}

/// Values as words.
fn bits(values: &[f32]) -> &[u32] {
    // SAFETY: the two types have the same size and alignment, and any bits are a u32.
    unsafe { std::slice::from_raw_parts(values.as_ptr().cast(), values.len()) }
}

/// Adds the sums of a block of rows and a tile, times `factor`, to `out` from (row, column) on.
#[inline(always)]
fn add(sums: &[[f32; TILE]], factor: f32, (row, column): (usize, usize), out: &mut Out<'_, f32>) {
    let width = TILE.min(out.columns - column);
    for (r, sums) in sums.iter().enumerate() {
        let out_row = &mut out.data[(row + r) * out.down + column * out.across..];
        if let (1, Some(whole)) = (out.across, out_row.first_chunk_mut::<TILE>().filter(|_| width == TILE)) {
            whole.iter_mut().zip(sums).for_each(|(o, s)| *o += factor * s);
        } else {
            let some = out_row.iter_mut().step_by(out.across);
            some.zip(&sums[..width]).for_each(|(o, s)| *o += factor * s);
        }
    }
}

/// Rows and columns of a block where one matrix is narrow, and in f64.
const ROWS: usize = 4;
/// See [`ROWS`].
const COLUMNS: usize = 16;

macro_rules! strips {
    ($body:ident, $at:ident, $block:ident, $float:ty, $fused:ident) => {
        #[inline(always)]
        fn $block<const V: u8>(
            lines: &[[$float; COLUMNS]],
            values: impl Fn(usize) -> [$float; ROWS],
        ) -> [[$float; COLUMNS]; ROWS] {
            let [mut s, mut t, mut u, mut v]: [[$float; COLUMNS]; ROWS] = [[0.0; COLUMNS]; ROWS];
            for (k, line) in lines.iter().enumerate() {
                let [a, b, c, d] = values(k);
                for j in 0..COLUMNS {
                    s[j] = $fused::<V>(a, line[j], s[j]);
                    t[j] = $fused::<V>(b, line[j], t[j]);
                    u[j] = $fused::<V>(c, line[j], u[j]);
                    v[j] = $fused::<V>(d, line[j], v[j]);
                }
            }
            [s, t, u, v]
        }

        #[inline(always)]
        fn $body<const V: u8>(
            left: Matrix<'_, $float>,
            right: Matrix<'_, $float>,
            factor: $float,
            out: Out<'_, $float>,
        ) {
            let mut lines: [[$float; COLUMNS]; DEPTH] = [[0.0; COLUMNS]; DEPTH];
            let stretches = left.columns.div_ceil(DEPTH);
            for stretch in 0..stretches {
                let first = stretch * left.columns / stretches;
                let lines = &mut lines[..(stretch + 1) * left.columns / stretches - first];
                for column in (0..right.columns).step_by(COLUMNS) {
                    let width = COLUMNS.min(right.columns - column);
                    for (k, line) in lines.iter_mut().enumerate() {
                        let row = &right.data[(first + k) * right.down + column * right.across..];
                        match row.first_chunk::<COLUMNS>() {
                            Some(row) if right.across == 1 && width == COLUMNS => *line = *row,
                            _ => {
                                let row = row.iter().step_by(right.across).take(width);
                                line.iter_mut().zip(row).for_each(|(x, w)| *x = *w);
                            }
                        }
                    }
                    for row in (0..left.rows).step_by(ROWS) {
                        // The rows that an incomplete block lacks are its first again, and not written.
                        let rows: [&[$float]; ROWS] = std::array::from_fn(|r| {
                            let row = if row + r < left.rows { row + r } else { row };
                            &left.data[row * left.down + first * left.across..]
                        });
                        let sums = if left.across == 1 {
                            let rows = rows.map(|row| &row[..lines.len()]);
                            $block::<V>(lines, |k| rows.map(|row| row[k]))
                        } else {
                            $block::<V>(lines, |k| rows.map(|row| row[k * left.across]))
                        };
                        for (r, sums) in sums.iter().enumerate().take(left.rows - row) {
                            let entries = out.data[(row + r) * out.down + column * out.across..].iter_mut();
                            entries.step_by(out.across).zip(&sums[..width]).for_each(|(o, s)| *o += factor * s);
                        }
                    }
                }
            }
        }

        levels! {
            fn $at(left: Matrix<'_, $float>, right: Matrix<'_, $float>, factor: $float, out: Out<'_, $float>) = $body
        }
    };
}

strips!(strips_body, strips_at, block, f32, multiply_add);
strips!(strips_f64_body, strips_f64_at, block_f64, f64, fused);

#[cfg(test)]
mod tests;
