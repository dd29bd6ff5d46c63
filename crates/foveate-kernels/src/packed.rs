//! The features of many glimpses: logistic(v W + b), matrix product and logistic in one pass.
//!
//! W (n_v × n_h) is packed once, in tiles of 64 columns: for each word of 32 bits of a glimpse, 64 words
//! side by side. A word is one f32, or two bf16 (the upper halves of two f32, rounded to nearest): then
//! one instruction multiplies and adds 32 pairs of bf16 into 16 sums of f32, twice the rate of f32.
//! Blocks of up to 6 glimpses times one tile stay in registers while all of n_v is summed, in order,
//! so that a glimpse's features depend on no other glimpse.
//!
//! Weights are kept times -log₂ e: then logistic(x) is 1 / (1 + 2^y) of the sum y.

use crate::ends::{End, Features, Overlaps, Pooled, TO_EXP2, TOGETHER, padded};
use crate::level::{Level, levels};
use crate::tile::{self, BLOCK, Kernel, Line, Sums, TILE};

/// Words of glimpses that fit on the stack: 34 glimpses of 240 values in f32.
const STACK: usize = 8192;

/// How weights and glimpses are rounded; products are added in f32 either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Not at all.
    F32,
    /// To 8 significant bits (bf16).
    Bf16,
}

/// Weights W (n_v × n_h) in the order in which the kernels read them.
#[derive(Clone, Debug)]
pub struct PackedWeights {
    n_v: usize,
    n_h: usize,
    precision: Precision,
    level: Level,
    /// Words of a glimpse.
    depth: usize,
    /// Tiles of 64 columns, each `depth` × 4 lines.
    lines: Vec<Line>,
}

impl PackedWeights {
    /// Packs `weights` (n_v × n_h, row-major) as they are.
    ///
    /// # Panics
    /// If `weights` are not n_v × n_h, or there are none.
    pub fn f32(n_v: usize, n_h: usize, weights: &[f32]) -> Self {
        Self::new(Level::best(), Precision::F32, n_v, n_h, weights)
    }

    /// Packs `weights` (n_v × n_h, row-major) rounded to bf16; glimpses will be rounded too.
    ///
    /// A sum then differs from the exact one by at most 2^-8 Σ |v W|, typically by 2^-9.5 times the root of Σ (v W)².
    /// Processors without the instruction add the same rounded products in f32.
    ///
    /// # Panics
    /// If `weights` are not n_v × n_h, or there are none.
    pub fn bf16(n_v: usize, n_h: usize, weights: &[f32]) -> Self {
        Self::new(Level::best(), Precision::Bf16, n_v, n_h, weights)
    }

    pub(crate) fn new(level: Level, precision: Precision, n_v: usize, n_h: usize, weights: &[f32]) -> Self {
        assert!(n_v > 0 && n_h > 0, "no weights");
        assert_eq!(weights.len(), n_v * n_h, "weights must be {n_v} x {n_h}");
        let mut packed = Self { n_v, n_h, precision, level, depth: n_v, lines: Vec::new() };
        if packed.pairs() {
            packed.depth = n_v.div_ceil(2);
        }
        packed.lines = vec![Line([0; 16]); n_h.div_ceil(TILE) * packed.depth * 4];
        packed.repack(weights);
        packed
    }

    /// Takes new weights of the same shape, without allocating.
    ///
    /// # Panics
    /// If `weights` are not n_v × n_h.
    pub fn repack(&mut self, weights: &[f32]) {
        let (n_v, n_h, depth, pairs) = (self.n_v, self.n_h, self.depth, self.pairs());
        assert_eq!(weights.len(), n_v * n_h, "weights must be {n_v} x {n_h}");
        for (left, tile) in (0..n_h).step_by(TILE).zip(self.lines.chunks_exact_mut(4 * depth)) {
            for (k, lines) in tile.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let row = |i: usize| match weights.get(i * n_h + left..(i + 1) * n_h) {
                    Some(row) => padded(row, 0).map(|w| TO_EXP2 * w),
                    None => [0.0; TILE],
                };
                let words = match (self.precision, pairs) {
                    (Precision::F32, _) => row(k).map(f32::to_bits),
                    (Precision::Bf16, false) => row(k).map(round_to_bf16),
                    (Precision::Bf16, true) => {
                        let (first, second) = (row(2 * k), row(2 * k + 1));
                        std::array::from_fn(|c| pair_of_bf16(first[c], second[c]))
                    }
                };
                for (line, words) in lines.iter_mut().zip(words.as_chunks().0) {
                    line.0 = *words;
                }
            }
        }
    }

    /// Whether a word is a pair of bf16.
    fn pairs(&self) -> bool {
        self.precision == Precision::Bf16 && self.level == Level::Avx512Dots
    }

    /// (n_v, n_h): the values of a glimpse, and of its features.
    pub fn shape(&self) -> (usize, usize) {
        (self.n_v, self.n_h)
    }

    /// How weights and glimpses are rounded.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// `features` (n × n_h) ← logistic(`glimpses` W + `bias`), for `glimpses` (n × n_v) and `bias` (n_h).
    ///
    /// Error below 1e-6 beside that of the sums; no feature is below 4e-39. NaN stays NaN.
    /// A row's features depend on that row alone. Allocates nothing for n_v up to 1365.
    ///
    /// # Panics
    /// If the sizes do not agree.
    pub fn features(&self, glimpses: &[f32], bias: &[f32], features: &mut [f32]) {
        let n = self.rows(glimpses, bias);
        assert_eq!(features.len(), n * self.n_h, "features must be {n} x {}", self.n_h);
        let mut end = Features::new(bias, features);
        features_at(self.level, self, glimpses, &mut end);
    }

    /// For each glimpse (n × n_v) with features h = logistic(v W + `bias`): `totals` (n) ← Σ h and `overlaps` (n) ←
    /// Σ √h · `template_root` (n_h), the sums of [`crate::root_overlap`], without writing h anywhere.
    ///
    /// A row's sums depend on that row alone. Allocates nothing for n_v up to 1365.
    ///
    /// # Panics
    /// If the sizes do not agree.
    pub fn overlaps(
        &self,
        glimpses: &[f32],
        bias: &[f32],
        template_root: &[f32],
        totals: &mut [f32],
        overlaps: &mut [f32],
    ) {
        let n = self.rows(glimpses, bias);
        assert_eq!(template_root.len(), self.n_h, "template_root must be as long as the features");
        assert!(totals.len() == n && overlaps.len() == n, "there must be one total and one overlap a glimpse");
        let mut end = Overlaps::new(bias, template_root, totals, overlaps);
        overlaps_at(self.level, self, glimpses, &mut end);
    }

    /// For each row v (n × n_v), `pooled` (cells × n_h) of its cell += max(0, gain · (v W) − `thresholds`): with a gain and a cell for
    /// each row, and a threshold (n_h) for each column.
    ///
    /// Rows are added in their order. Allocates nothing for n_v up to 1365.
    ///
    /// # Panics
    /// If the sizes do not agree, or a cell is not in `pooled`.
    pub fn pool(&self, rows: &[f32], gains: &[f32], cells: &[u32], thresholds: &[f32], pooled: &mut [f32]) {
        let n = self.rows(rows, thresholds);
        assert!(gains.len() == n && cells.len() == n, "there must be one gain and one cell a row");
        let mut end = Pooled::new(gains, thresholds, cells, pooled);
        pool_at(self.level, self, rows, &mut end);
    }

    /// The number of glimpses.
    fn rows(&self, glimpses: &[f32], bias: &[f32]) -> usize {
        assert!(
            glimpses.len().is_multiple_of(self.n_v),
            "{} values are not whole glimpses of {}",
            glimpses.len(),
            self.n_v
        );
        assert_eq!(bias.len(), self.n_h, "bias must be as long as the features");
        glimpses.len() / self.n_v
    }

    /// Multiplies block after block and gives the sums to `end`.
    #[inline(always)]
    fn multiply<const V: u8>(&self, glimpses: &[f32], end: &mut impl End) {
        let depth = self.depth;
        let kernel = if self.pairs() { Kernel::Bf16 } else { Kernel::F32(self.level) };
        let (mut stack, mut heap) = ([0; STACK], Vec::new());
        let words: &mut [u32] = if BLOCK * depth <= STACK {
            &mut stack
        } else {
            heap.resize(BLOCK * depth, 0);
            &mut heap
        };
        // As many blocks as there is room for share a tile while it is in the cache.
        let together = (words.len() / (BLOCK * depth) * BLOCK).min(TOGETHER);
        let mut sums: Sums = [[0.0; TILE]; BLOCK];
        for glimpses in glimpses.chunks(together * self.n_v) {
            let rows = glimpses.len() / self.n_v;
            for (glimpse, words) in glimpses.chunks_exact(self.n_v).zip(words.chunks_exact_mut(depth)) {
                match (self.precision, self.pairs()) {
                    (Precision::F32, _) => words.iter_mut().zip(glimpse).for_each(|(word, v)| *word = v.to_bits()),
                    (Precision::Bf16, false) => {
                        words.iter_mut().zip(glimpse).for_each(|(word, &v)| *word = round_to_bf16(v))
                    }
                    (Precision::Bf16, true) => {
                        let (pairs, last) = glimpse.as_chunks::<2>();
                        words.iter_mut().zip(pairs).for_each(|(word, &[a, b])| *word = pair_of_bf16(a, b));
                        if let &[last] = last {
                            words[depth - 1] = pair_of_bf16(last, 0.0);
                        }
                    }
                }
            }
            for (t, lines) in self.lines.chunks_exact(4 * depth).enumerate() {
                end.tile(t * TILE);
                for first in (0..rows).step_by(BLOCK) {
                    let block = BLOCK.min(rows - first);
                    tile::multiply::<false>(kernel, block, depth, &words[first * depth..], lines, &mut sums);
                    end.take::<V>(first, &sums[..block]);
                }
            }
            end.finish::<V>(rows);
        }
    }
}

/// The upper half of a value rounded to nearest, ties to even; a NaN stays one.
#[inline(always)]
fn round_to_bf16(value: f32) -> u32 {
    let bits = value.to_bits();
    let rounded = bits.wrapping_add(0x7fff + ((bits >> 16) & 1)) & 0xffff_0000;
    if value.is_nan() { (bits | 0x40_0000) & 0xffff_0000 } else { rounded }
}

/// Two bf16 in a word, the first in the lower half.
#[inline(always)]
fn pair_of_bf16(first: f32, second: f32) -> u32 {
    round_to_bf16(first) >> 16 | round_to_bf16(second)
}

#[inline(always)]
fn features_body<const V: u8>(weights: &PackedWeights, glimpses: &[f32], end: &mut Features<'_>) {
    weights.multiply::<V>(glimpses, end);
}

#[inline(always)]
fn overlaps_body<const V: u8>(weights: &PackedWeights, glimpses: &[f32], end: &mut Overlaps<'_>) {
    weights.multiply::<V>(glimpses, end);
}

#[inline(always)]
fn pool_body<const V: u8>(weights: &PackedWeights, rows: &[f32], end: &mut Pooled<'_>) {
    weights.multiply::<V>(rows, end);
}

levels! {
    fn pool_at(weights: &PackedWeights, rows: &[f32], end: &mut Pooled<'_>) = pool_body
}

levels! {
    fn features_at(weights: &PackedWeights, glimpses: &[f32], end: &mut Features<'_>) = features_body
}

levels! {
    fn overlaps_at(weights: &PackedWeights, glimpses: &[f32], end: &mut Overlaps<'_>) = overlaps_body
}

#[cfg(test)]
mod tests;
