//! Zeros that a product leaves out.
//!
//! A zero adds nothing to a sum. A row without its zeros shares no word with its neighbours and so takes longer for each one:
//! it pays if at most half of the words are there.

use crate::level::multiply_add;
use crate::tile::{BLOCK, Line, Sums, TILE};

/// The most words of a row: a byte names one of them.
pub(crate) const DEPTH: usize = 256;
/// The most rows.
pub(crate) const TOGETHER: usize = 22 * BLOCK;
/// Time of a word alone, where one of a whole block takes 1.
const TIME: usize = 2;

/// The words of some rows that are not 0, up to `split`. From there on zeros are multiplied, too.
pub(crate) struct Present {
    pub(crate) split: usize,
    places: [[u8; DEPTH]; TOGETHER],
    counts: [usize; TOGETHER],
    /// Whether all of them are 1.
    ones: bool,
}

/// Up to which word of `depth` it pays to leave zeros out of `rows` rows, one every `stride` words, by at most 32 of them.
#[inline(always)]
pub(crate) fn split(words: &[u32], stride: usize, rows: usize, depth: usize) -> usize {
    const GROUP: usize = 16;
    let (mut there, mut tried) = ([0; DEPTH / GROUP], 0);
    for row in (0..rows).step_by(rows.div_ceil(32).max(1)) {
        for (there, words) in there.iter_mut().zip(words[row * stride..][..depth].chunks(GROUP)) {
            *there += words.iter().map(|w| u32::from(*w != 0)).sum::<u32>() as usize;
        }
        tried += 1;
    }
    let (mut split, mut least, mut time) = (0, 0, 0);
    for (group, there) in there[..depth.div_ceil(GROUP)].iter().enumerate() {
        let (start, end) = (group * GROUP, depth.min((group + 1) * GROUP));
        time += (TIME * there) as isize - (tried * (end - start)) as isize;
        if time < least {
            (split, least) = (end, time);
        }
    }
    split
}

impl Present {
    pub(crate) const NONE: Self = Self { split: 0, places: [[0; DEPTH]; TOGETHER], counts: [0; TOGETHER], ones: true };

    /// Finds them in `rows` rows of `depth` words, one every `stride` words; nothing is left out of more than [`TOGETHER`] rows.
    #[inline(always)]
    pub(crate) fn find(&mut self, words: &[u32], stride: usize, rows: usize, depth: usize) {
        self.split = if rows > TOGETHER { 0 } else { split(words, stride, rows, depth) };
        self.ones = true;
        if self.split == 0 {
            return;
        }
        for (row, (places, count)) in self.places.iter_mut().zip(&mut self.counts).enumerate().take(rows) {
            let words = &words[row * stride..][..self.split];
            self.ones &= words.iter().fold(true, |ones, w| ones & ((*w == 0) | (*w == 1f32.to_bits())));
            *count = 0;
            for (k, word) in words.iter().enumerate() {
                places[*count] = k as u8;
                *count += usize::from(*word != 0);
            }
        }
    }

    /// Adds their products with `lines` to `sums`: `count` of the rows that were found, from `first` on.
    #[inline(always)]
    pub(crate) fn multiply<const V: u8>(
        &self,
        (first, count): (usize, usize),
        stride: usize,
        words: &[u32],
        lines: &[Line],
        sums: &mut Sums,
    ) {
        for (r, sums) in sums.iter_mut().enumerate().take(count) {
            let places = &self.places[first + r][..self.counts[first + r]];
            if self.ones {
                add::<V, true>(places, &[], lines, sums);
            } else {
                add::<V, false>(places, &words[r * stride..], lines, sums);
            }
        }
    }
}

/// Adds the products of the words at `places`, or of ones, to `sums`.
#[inline(always)]
fn add<const V: u8, const ONES: bool>(places: &[u8], words: &[u32], lines: &[Line], sums: &mut [f32; TILE]) {
    // In registers.
    let mut all = [[0.0; 16]; 4];
    all.iter_mut().zip(sums.as_chunks().0).for_each(|(all, sums)| *all = *sums);
    let lines = lines.as_chunks::<4>().0;
    for &k in places {
        let value = if ONES { 1.0 } else { f32::from_bits(words[usize::from(k)]) };
        for (sums, line) in all.iter_mut().zip(&lines[usize::from(k)]) {
            for (sum, w) in sums.iter_mut().zip(&line.0) {
                let w = f32::from_bits(*w);
                *sum = if ONES { *sum + w } else { multiply_add::<V>(value, w, *sum) };
            }
        }
    }
    sums.as_chunks_mut().0.iter_mut().zip(all).for_each(|(sums, all)| *sums = all);
}
