//! The features of [`oriented_features`](crate::oriented_features) at all places of a lattice. Its glimpses share
//! cells, so gradients are computed once a cell and summed once a block.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::level::FUSED;
use crate::level::levels;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::oriented::columns;
use crate::oriented::{
    AT_ONCE, BLOCK, DIRECTIONS, Lengths, MOST_BLOCKS, WIDTH, add_gradients, bring_to_length, places,
};

/// Half blocks, 2 × 2 cells, that a strip of [`oriented_halves`] has; rows are whole strips.
pub const HALVES: usize = WIDTH / 2;

levels! {
    /// `gradients` ← for each half block of 2 × 2 cells, in rows of `columns`, the sums of gradient in 8 directions, `grey` ← the sums of
    /// their values. Around the cells of all half blocks is a border of one: rows have `2 columns + 2` cells.
    ///
    /// # Panics
    /// If `columns` is not whole strips of [`HALVES`], or `cells`, `gradients` or `grey` have other sizes than that.
    pub fn oriented_halves / oriented_halves_at (
        cells: &[f32], columns: usize, gradients: &mut [f32], grey: &mut [f32]
    ) = oriented_halves_body
}

levels! {
    /// `blocks` ← for each half block, in rows of `columns`, the roots of the sums over the block that begins with it, of all but the last
    /// row; those of the last column mean nothing.
    ///
    /// # Panics
    /// If `halves` and `blocks` differ in length, or are not whole rows.
    pub fn oriented_blocks / oriented_blocks_at (halves: &[f32], columns: usize, blocks: &mut [f32]) =
        oriented_blocks_body
}

/// The values that the places of a lattice read: rows of `columns`, a value a half block, or 8.
#[derive(Clone, Copy, Debug)]
pub struct Maps<'a> {
    /// Half blocks in a row.
    pub columns: usize,
    /// Of [`oriented_blocks`].
    pub blocks: &'a [f32],
    /// Of [`oriented_halves`].
    pub grey: &'a [f32],
    /// The colour cells of the block that begins there, in two channels.
    pub colour: [&'a [f32]; 2],
}

levels! {
    /// `out` ← [`oriented_features`](crate::oriented_features) of the glimpse that begins with the half block of this
    /// index, up to the order of its sums.
    ///
    /// # Panics
    /// If the glimpse reaches past the maps, blocks are more than 8, or `out` is not as long as [`Lengths::sizes`] add up to with two values
    /// of colour a block.
    pub fn features_among / features_among_at (
        maps: &Maps<'_>, first: usize, blocks: usize, lengths: &Lengths, out: &mut [f32]
    ) = features_among_body
}

#[inline(always)]
fn oriented_halves_body<const V: u8>(cells: &[f32], columns: usize, gradients: &mut [f32], grey: &mut [f32]) {
    let width = 2 * columns + 2;
    assert!(columns > 0 && columns.is_multiple_of(HALVES), "whole strips, not {columns} half blocks");
    assert!(grey.len().is_multiple_of(columns) && gradients.len() == DIRECTIONS * grey.len(), "a sum a half block");
    assert!(cells.len() == width * (2 * grey.len() / columns + 2), "cells of {columns} half blocks, and a border");
    for (j, (gradients, grey)) in
        gradients.chunks_exact_mut(DIRECTIONS * columns).zip(grey.chunks_exact_mut(columns)).enumerate()
    {
        let strips = gradients.as_chunks_mut::<{ HALVES * DIRECTIONS }>().0.iter_mut();
        for (strip, (gradients, grey)) in strips.zip(grey.as_chunks_mut::<HALVES>().0).enumerate() {
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            if V == FUSED {
                for (k, gradients) in gradients.as_chunks_mut().0.iter_mut().enumerate() {
                    let corner = 2 * j * width + strip * WIDTH + k * columns::COLUMNS;
                    let cells = columns::Cells::new::<2>(&cells[corner..], width);
                    // SAFETY: by `V` the caller is compiled for the instructions, and runs only where they are there.
                    unsafe {
                        columns::half_blocks(&cells.gradients::<2>(), gradients);
                        cells.squares(0, &mut grey.as_chunks_mut().0[k]);
                    }
                }
                continue;
            }
            let (mut sums, mut pairs) = ([[0.0; WIDTH]; DIRECTIONS], [0.0; WIDTH]);
            for row in 0..2 {
                let rows: [&[f32; WIDTH + 2]; 3] = std::array::from_fn(|i| {
                    cells[(2 * j + row + i) * width + strip * WIDTH..].first_chunk().expect("whole strips")
                });
                add_gradients::<V>(&rows, &mut sums);
                for (x, pair) in pairs.iter_mut().enumerate() {
                    *pair += rows[1][x + 1] + rows[1][x + 2];
                }
            }
            *grey = std::array::from_fn(|x| pairs[2 * x]);
            *gradients = std::array::from_fn(|i| {
                let (x, sums) = (2 * (i / DIRECTIONS), &sums[i % DIRECTIONS]);
                sums[x] + sums[x + 1]
            });
        }
    }
}

#[inline(always)]
fn oriented_blocks_body<const V: u8>(halves: &[f32], columns: usize, blocks: &mut [f32]) {
    let row = DIRECTIONS * columns;
    assert!(halves.len() == blocks.len() && row > 0 && halves.len().is_multiple_of(row), "whole rows of one size");
    for (block, half) in blocks.chunks_exact_mut(row).zip(halves.windows(2 * row).step_by(row)) {
        let (above, below) = half.split_at(row);
        let left = above.iter().zip(below);
        for (block, ((a, c), (b, d))) in
            block.iter_mut().zip(left.zip(above[DIRECTIONS..].iter().zip(&below[DIRECTIONS..])))
        {
            *block = ((a + b) + (c + d)).sqrt();
        }
    }
}

#[inline(always)]
fn features_among_body<const V: u8>(maps: &Maps<'_>, first: usize, blocks: usize, lengths: &Lengths, out: &mut [f32]) {
    if blocks == AT_ONCE {
        return gather::<V, { AT_ONCE * AT_ONCE }>(maps, first, AT_ONCE, lengths, out); // with a number that is known
    }
    assert!((1..=MOST_BLOCKS).contains(&blocks), "1 to 8 blocks, not {blocks}");
    gather::<V, { MOST_BLOCKS * MOST_BLOCKS }>(maps, first, blocks, lengths, out);
}

/// With room for so many blocks.
#[inline(always)]
fn gather<const V: u8, const ROOM: usize>(
    maps: &Maps<'_>,
    first: usize,
    blocks: usize,
    lengths: &Lengths,
    out: &mut [f32],
) {
    const { assert!(BLOCK == 4) };
    let (Maps { columns, .. }, count, mut room) = (*maps, blocks * blocks, [[0.0; ROOM]; 4]);
    let room = &mut room.as_flattened_mut()[..4 * count];
    let [gradients, squares, colour] = places(lengths, blocks, 2 * count, room, out);
    for (y, row) in gradients.chunks_exact_mut(DIRECTIONS * blocks).enumerate() {
        let from = &maps.blocks[(first + 2 * y * columns) * DIRECTIONS..][..(2 * blocks - 1) * DIRECTIONS];
        for (to, from) in row.chunks_exact_mut(DIRECTIONS).zip(from.chunks(2 * DIRECTIONS)) {
            to.copy_from_slice(&from[..DIRECTIONS]);
        }
    }
    for (y, row) in squares.chunks_exact_mut(2 * blocks).enumerate() {
        row.copy_from_slice(&maps.grey[first + y * columns..][..2 * blocks]);
    }
    for (colour, map) in colour.chunks_exact_mut(count).zip(maps.colour) {
        for (y, row) in colour.chunks_exact_mut(blocks).enumerate() {
            let from = &map[first + 2 * y * columns..][..2 * blocks - 1];
            row.iter_mut().zip(from.iter().step_by(2)).for_each(|(to, from)| *to = from - lengths.neither);
        }
    }
    bring_to_length::<V>(lengths, blocks, 2 * count, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::{AVX512, BASE, FUSED};
    use crate::sums::tests::values;
    use crate::{Level, oriented_features};

    /// Every place of a lattice against its own glimpse.
    #[test]
    fn places_have_the_features_of_their_glimpses() {
        let [some, all] = [[0.8, 0.0, 0.3], [0.8, 0.5, 0.3]];
        for (blocks, columns, rows, length) in
            [(4, 16, 11, some), (4, 16, 11, all), (8, 24, 17, all), (3, 8, 6, all), (1, 8, 2, some)]
        {
            let lengths = Lengths { length, flat: [0.05, 0.1, 0.03], neither: 0.4 };
            let width = 2 * columns + 2;
            let cells = values(width * (2 * rows + 2), 1);
            let colour = [values(columns * rows, 2), values(columns * rows, 3)];
            for level in Level::all() {
                let (mut halves, mut grey) = (vec![f32::NAN; 8 * columns * rows], vec![f32::NAN; columns * rows]);
                let mut sums = vec![f32::NAN; 8 * columns * rows];
                oriented_halves_at(level, &cells, columns, &mut halves, &mut grey);
                oriented_blocks_at(level, &halves, columns, &mut sums);
                let maps = Maps { columns, blocks: &sums, grey: &grey, colour: colour.each_ref().map(|c| &c[..]) };
                for (j, i) in (0..=rows - 2 * blocks).flat_map(|j| (0..=columns - 2 * blocks).map(move |i| (j, i))) {
                    let side = 4 * blocks + 2;
                    let mut glimpse: Vec<f32> =
                        (0..side).flat_map(|y| cells[(2 * j + y) * width + 2 * i..][..side].to_vec()).collect();
                    for map in &colour {
                        let at = |k: usize| map[(j + 2 * (k / blocks)) * columns + i + 2 * (k % blocks)];
                        glimpse.extend((0..blocks * blocks).map(at));
                    }
                    let mut exact = vec![0.0; lengths.sizes(blocks, 2 * blocks * blocks).iter().sum()];
                    oriented_features(&glimpse, blocks, &lengths, &mut exact);
                    let mut out = vec![f32::NAN; exact.len()];
                    features_among_at(level, &maps, j * columns + i, blocks, &lengths, &mut out);
                    for (out, exact) in out.iter().zip(&exact) {
                        assert!((out - exact).abs() < 5e-5, "{level:?}, {blocks} blocks: {out} is not {exact}");
                    }
                }
            }
        }
    }

    /// Bit for bit the same with AVX2, AVX-512 and NEON, so that the track does not depend on the processor.
    #[test]
    fn maps_are_the_same_with_all_that_multiply_and_add_at_once() {
        foveate_testing::need!(foveate_testing::fused_multiply_add());
        let (columns, rows) = (16, 11);
        let cells = values((2 * columns + 2) * (2 * rows + 2), 1);
        let maps = |at: &dyn Fn(&mut [f32], &mut [f32])| {
            let (mut halves, mut grey) = (vec![0.0; 8 * columns * rows], vec![0.0; columns * rows]);
            at(&mut halves, &mut grey);
            [halves, grey].map(|values| values.into_iter().map(f32::to_bits).collect::<Vec<_>>())
        };
        let plain = maps(&|halves, grey| oriented_halves_body::<AVX512>(&cells, columns, halves, grey));
        for level in Level::all().filter(|level| *level != Level::Portable || BASE == FUSED) {
            let these = maps(&|halves, grey| oriented_halves_at(level, &cells, columns, halves, grey));
            assert!(these == plain, "{level:?}: halves and their grey sums");
        }
    }

    #[test]
    #[should_panic(expected = "whole strips")]
    fn half_strips_are_refused() {
        oriented_halves(&[0.0; 72], 5, &mut [0.0; 80], &mut [0.0; 10]);
    }
}
