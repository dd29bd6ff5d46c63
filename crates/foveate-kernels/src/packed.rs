//! The features of many glimpses: logistic(v W + b), matrix product and logistic in one pass.
//!
//! W (n_v × n_h) is packed once, in tiles of 64 columns: for each word of 32 bits of a glimpse, 64 words
//! side by side. A word is one f32, or two bf16 (the upper halves of two f32, rounded to nearest): then
//! one instruction multiplies and adds 32 pairs of bf16 into 16 sums of f32, twice the rate of f32. Or it is four
//! bytes, at four times that rate: v is its least value plus a step times 0 to 255, a column of W a step times −127 to 127,
//! and sums are whole numbers.
//! Blocks of up to 6 glimpses times one tile stay in registers while all of n_v is summed, in order,
//! so that a glimpse's features depend on no other glimpse.
//!
//! Weights are kept times -log₂ e: then logistic(x) is 1 / (1 + 2^y) of the sum y.

use crate::epilogue::{End, Features, Overlaps, Pooled, TO_EXP2, TOGETHER, padded};
use crate::level::{Level, greater, lesser, levels};
use crate::sums::{copy_short, fold};
use crate::tile::{self, BLOCK, Kernel, Line, Sums, TILE};

/// Words of glimpses that fit on the stack: 34 glimpses of 240 values in f32.
const STACK: usize = 8192;

/// How weights and glimpses are rounded; products of the first two are added in f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Not at all.
    F32,
    /// To 8 significant bits (bf16).
    Bf16,
    /// To 256 equal steps from the least to the greatest value of a glimpse, and 255 in each column of weights.
    Int8,
}

/// The least value of a glimpse, and its step.
type Steps = [f32; 2];

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
    /// Of each tile the sums of its columns and their steps, for bytes.
    steps: Vec<[[f32; TILE]; 2]>,
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

    /// Packs `weights` (n_v × n_h, row-major) rounded to 255 equal steps, from minus to plus the greatest size in their column;
    /// glimpses will be rounded to 256 steps, from their least value to the greatest.
    ///
    /// A value is off by at most half a step. Processors without the instruction for bytes give the same sums, to the last bit
    /// for n_v up to 518.
    ///
    /// # Panics
    /// If `weights` are not n_v × n_h, or there are none.
    pub fn int8(n_v: usize, n_h: usize, weights: &[f32]) -> Self {
        Self::new(Level::best(), Precision::Int8, n_v, n_h, weights)
    }

    pub(crate) fn new(level: Level, precision: Precision, n_v: usize, n_h: usize, weights: &[f32]) -> Self {
        assert!(n_v > 0 && n_h > 0, "no weights");
        assert_eq!(weights.len(), n_v * n_h, "weights must be {n_v} x {n_h}");
        let mut packed = Self { n_v, n_h, precision, level, depth: 0, lines: vec![], steps: vec![] };
        packed.depth = n_v.div_ceil(packed.values());
        packed.lines = vec![Line([0; 16]); n_h.div_ceil(TILE) * packed.depth * 4];
        if precision == Precision::Int8 {
            packed.steps = vec![[[0.0; TILE]; 2]; n_h.div_ceil(TILE)];
        }
        packed.repack(weights);
        packed
    }

    /// Takes new weights of the same shape, without allocating.
    ///
    /// # Panics
    /// If `weights` are not n_v × n_h.
    pub fn repack(&mut self, weights: &[f32]) {
        let (n_v, n_h, depth, values) = (self.n_v, self.n_h, self.depth, self.values());
        assert_eq!(weights.len(), n_v * n_h, "weights must be {n_v} x {n_h}");
        for (t, tile) in self.lines.chunks_exact_mut(4 * depth).enumerate() {
            let row = |i: usize| match weights.get(i * n_h + t * TILE..(i + 1) * n_h) {
                Some(row) => padded(row, 0).map(|w| TO_EXP2 * w),
                None => [0.0; TILE],
            };
            let steps = self.steps.get_mut(t).map(|[sums, steps]| {
                (*sums, *steps) = ([0.0; TILE], [0.0; TILE]);
                for row in (0..n_v).map(row) {
                    sums.iter_mut().zip(row).for_each(|(sum, w)| *sum += w);
                    steps.iter_mut().zip(row).for_each(|(step, w)| *step = step.max(w.abs() / 127.0));
                }
                *steps
            });
            let whole = |i: usize| {
                let (row, steps) = (row(i), steps.unwrap_or([1.0; TILE]));
                std::array::from_fn::<f32, TILE, _>(|c| if steps[c] > 0.0 { (row[c] / steps[c]).round() } else { 0.0 })
            };
            for (k, lines) in tile.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let words = match (self.precision, values) {
                    (Precision::F32, _) => row(k).map(f32::to_bits),
                    (Precision::Bf16, 1) => row(k).map(round_to_bf16),
                    (Precision::Bf16, _) => {
                        let (first, second) = (row(2 * k), row(2 * k + 1));
                        std::array::from_fn(|c| pair_of_bf16(first[c], second[c]))
                    }
                    (Precision::Int8, 1) => whole(k).map(f32::to_bits),
                    (Precision::Int8, _) => {
                        let rows: [_; 4] = std::array::from_fn(|i| whole(4 * k + i));
                        std::array::from_fn(|c| u32::from_le_bytes(rows.map(|row| row[c] as i8 as u8)))
                    }
                };
                for (line, words) in lines.iter_mut().zip(words.as_chunks().0) {
                    line.0 = *words;
                }
            }
        }
    }

    /// The values of a word.
    fn values(&self) -> usize {
        match self.precision {
            Precision::Bf16 if self.level == Level::Avx512Dots => 2,
            // 2³¹ holds the sum of more than 2¹⁶ products.
            Precision::Int8 if self.level == Level::Avx512Dots && self.n_v <= 1 << 16 => 4,
            _ => 1,
        }
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
        let kernel = match self.values() {
            2 => Kernel::Bf16,
            4 => Kernel::Int8,
            _ => Kernel::F32(self.level),
        };
        let (mut stack, mut heap) = ([0; STACK], Vec::new());
        let words: &mut [u32] = if BLOCK * depth <= STACK {
            &mut stack
        } else {
            heap.resize(BLOCK * depth, 0);
            &mut heap
        };
        // As many blocks as there is room for share a tile while it is in the cache.
        let together = (words.len() / (BLOCK * depth) * BLOCK).min(TOGETHER);
        let (mut sums, mut steps): (Sums, _) = ([[0.0; TILE]; BLOCK], [Steps::default(); TOGETHER]);
        for glimpses in glimpses.chunks(together * self.n_v) {
            let rows = glimpses.len() / self.n_v;
            let words_of = glimpses.chunks_exact(self.n_v).zip(words.chunks_exact_mut(depth));
            for ((glimpse, words), steps) in words_of.zip(&mut steps) {
                match (self.precision, self.values()) {
                    (Precision::F32, _) => words.iter_mut().zip(glimpse).for_each(|(word, v)| *word = v.to_bits()),
                    (Precision::Bf16, 1) => {
                        words.iter_mut().zip(glimpse).for_each(|(word, &v)| *word = round_to_bf16(v))
                    }
                    (Precision::Bf16, _) => {
                        let (pairs, last) = glimpse.as_chunks::<2>();
                        words.iter_mut().zip(pairs).for_each(|(word, &[a, b])| *word = pair_of_bf16(a, b));
                        if let &[last] = last {
                            words[depth - 1] = pair_of_bf16(last, 0.0);
                        }
                    }
                    (Precision::Int8, values) => {
                        *steps = steps_of(glimpse);
                        if values == 1 {
                            let whole = |v: f32| f32::from(byte(v, *steps));
                            words.iter_mut().zip(glimpse).for_each(|(word, &v)| *word = whole(v).to_bits());
                        } else {
                            for (words, glimpse) in words.chunks_mut(16).zip(glimpse.chunks(64)) {
                                let mut bytes = [0; 64];
                                bytes.iter_mut().zip(glimpse).for_each(|(b, &v)| *b = byte(v, *steps));
                                let bytes = bytes.as_chunks().0;
                                words.iter_mut().zip(bytes).for_each(|(word, b)| *word = u32::from_le_bytes(*b));
                            }
                        }
                    }
                }
            }
            for (t, lines) in self.lines.chunks_exact(4 * depth).enumerate() {
                end.tile(t * TILE);
                for first in (0..rows).step_by(BLOCK) {
                    let block = BLOCK.min(rows - first);
                    tile::multiply::<false>(kernel, block, depth, &words[first * depth..], lines, &mut sums);
                    if let Some([columns, factors]) = self.steps.get(t) {
                        let whole = |sum: f32| if kernel == Kernel::Int8 { sum.to_bits() as i32 as f32 } else { sum };
                        for (sums, &[least, step]) in sums[..block].iter_mut().zip(&steps[first..]) {
                            for ((sum, column), factor) in sums.iter_mut().zip(columns).zip(factors) {
                                *sum = least * column + step * (factor * whole(*sum));
                            }
                        }
                    }
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

/// The least value of a glimpse, and a 255th of the way to the greatest. Neither is a number if a value is not finite.
#[inline(always)]
fn steps_of(glimpse: &[f32]) -> Steps {
    let (mut least, mut most, mut nothing) = ([glimpse[0]; 16], [glimpse[0]; 16], [0.0; 16]);
    let mut take = |values: &[f32; 16]| {
        for (k, &v) in values.iter().enumerate() {
            (least[k], most[k], nothing[k]) = (lesser(v, least[k]), greater(v, most[k]), nothing[k] + 0.0 * v);
        }
    };
    let (values, rest) = glimpse.as_chunks();
    values.iter().for_each(&mut take);
    let mut last = [glimpse[0]; 16];
    copy_short(rest, &mut last);
    take(&last);
    let (least, most) = (least.into_iter().fold(least[0], lesser), most.into_iter().fold(most[0], greater));
    [least, (most - least) / 255.0].map(|number| number + fold(nothing))
}

/// The step that is nearest to a value of the glimpse.
#[inline(always)]
fn byte(value: f32, [least, step]: Steps) -> u8 {
    /// 2²³: the last bits of a number plus this are the number, rounded.
    const WHOLE: f32 = 8_388_608.0;
    ((value - least) * (1.0 / step.max(f32::MIN_POSITIVE)) + WHOLE).to_bits() as u8
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
