//! The features of many glimpses: logistic(v W + b), the matrix product and what follows it in one pass.
//!
//! W (n_v × n_h) is packed once, in tiles of 64 columns: for each word of 32 bits of a glimpse, 64 words
//! side by side. A word is one f32, or two bf16 (the upper halves of two f32, rounded to nearest): then
//! one instruction multiplies and adds 32 pairs of bf16 into 16 sums of f32, twice the rate of f32.
//! Blocks of up to 6 glimpses times one tile stay in registers while all of n_v is summed, in order,
//! so that a glimpse's features depend on no other glimpse.
//!
//! Weights are kept times -log₂ e: then logistic(x) is 1 / (1 + 2^y) of the sum y.

use crate::ends::{End, Energies, Features, Overlaps, Pooled, TO_EXP2, TOGETHER, padded};
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
#[derive(Clone)]
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
        self.precision == Precision::Bf16 && self.level == Level::Avx512Bf16
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

    /// For each row v (n × n_v), `pooled` (cells × n_h / size) of its cell += √ Σ (gain · (v W) − `thresholds`)², the sum over `size` columns that
    /// follow each other: with a gain and a cell for each row, and a threshold (n_h) for each column.
    ///
    /// Rows are added in their order. Allocates nothing for n_v up to 1365.
    ///
    /// # Panics
    /// If the sizes do not agree, a cell is not in `pooled`, or `size` is not 1, 2, 4 or 8.
    pub fn energies(
        &self,
        rows: &[f32],
        gains: &[f32],
        cells: &[u32],
        (thresholds, size): (&[f32], usize),
        pooled: &mut [f32],
    ) {
        let n = self.rows(rows, thresholds);
        assert!(gains.len() == n && cells.len() == n, "there must be one gain and one cell a row");
        assert!([1, 2, 4, 8].contains(&size) && self.n_h.is_multiple_of(size), "{} columns in {size}s", self.n_h);
        let mut end = Energies::new(gains, thresholds, cells, size, pooled);
        energies_at(self.level, self, rows, &mut end);
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
                    tile::multiply(kernel, block, depth, &words[first * depth..][..block * depth], lines, &mut sums);
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

#[inline(always)]
fn energies_body<const V: u8>(weights: &PackedWeights, rows: &[f32], end: &mut Energies<'_>) {
    weights.multiply::<V>(rows, end);
}

levels! {
    fn energies_at(weights: &PackedWeights, rows: &[f32], end: &mut Energies<'_>) = energies_body
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
mod tests {
    use super::*;
    use crate::sums::root_overlap;
    use crate::sums::tests::values;

    /// Weights like those of a trained machine: of both signs, near 0.05.
    fn weights(n: usize) -> Vec<f32> {
        values(n, 3).iter().map(|x| (x - 0.5) * 0.2).collect()
    }

    fn every_kind() -> impl Iterator<Item = (Level, Precision)> {
        Level::all().flat_map(|level| [(level, Precision::F32), (level, Precision::Bf16)])
    }

    /// Features in f64 of rounded inputs, and in f64 of the inputs themselves.
    fn truth(glimpse: &[f32], w: &[f32], bias: &[f32], rounded: bool) -> Vec<f64> {
        let round = |x: f32| if rounded { f32::from_bits(round_to_bf16(x)) as f64 } else { x as f64 };
        let (n_h, scale) = (bias.len(), TO_EXP2 as f64);
        (0..n_h)
            .map(|j| {
                let x: f64 =
                    glimpse.iter().enumerate().map(|(i, &v)| round(v) * round(TO_EXP2 * w[i * n_h + j]) / scale).sum();
                1.0 / (1.0 + (-x - bias[j] as f64).exp())
            })
            .collect()
    }

    #[test]
    fn features_agree_with_f64() {
        for (n, n_v, n_h) in
            [(1, 1, 1), (7, 3, 5), (6, 240, 500), (13, 64, 64), (11, 33, 129), (61, 20, 70), (3, 1500, 9)]
        {
            let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
            for (level, precision) in every_kind() {
                let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
                let mut h = vec![f32::NAN; n * n_h];
                packed.features(&glimpses, &bias, &mut h);
                let rounded = precision == Precision::Bf16;
                for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
                    for (&h, truth) in h.iter().zip(truth(glimpse, &w, &bias, rounded)) {
                        let error = (h as f64 - truth).abs();
                        assert!(error < 2e-6, "{level:?} {precision:?} {n} x {n_v} x {n_h}: {h}, not {truth}");
                    }
                }
            }
        }
    }

    /// The bound that `PackedWeights::bf16` states, and what is typical.
    #[test]
    fn bf16_is_as_accurate_as_stated() {
        let (n, n_v, n_h) = (12, 240, 500);
        let (glimpses, w, bias) = (values(n * n_v, 4), weights(n_v * n_h), vec![0.0; n_h]);
        let mut h = vec![0.0; n * n_h];
        PackedWeights::bf16(n_v, n_h, &w).features(&glimpses, &bias, &mut h);
        let mut square = 0.0;
        for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
            for (j, (&h, truth)) in h.iter().zip(truth(glimpse, &w, &bias, false)).enumerate() {
                let error = (h as f64 - truth).abs();
                let terms = glimpse.iter().enumerate().map(|(i, v)| (v * w[i * n_h + j]).abs() as f64);
                // A logistic's slope is at most a quarter.
                assert!(error < terms.sum::<f64>() / 256.0 / 4.0 + 1e-6);
                square += error * error / (n * n_h) as f64;
            }
        }
        assert!(square.sqrt() < 4e-4, "root mean square error {}", square.sqrt());
    }

    #[test]
    fn overlaps_are_those_of_the_features() {
        for (n, n_v, n_h) in [(1, 4, 3), (100, 240, 500), (49, 7, 65)] {
            let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
            let template: Vec<f32> = values(n_h, 5).iter().map(|x| x.sqrt()).collect();
            for (level, precision) in every_kind() {
                let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
                let (mut h, mut totals, mut overlaps) = (vec![0.0; n * n_h], vec![0.0; n], vec![0.0; n]);
                packed.features(&glimpses, &bias, &mut h);
                packed.overlaps(&glimpses, &bias, &template, &mut totals, &mut overlaps);
                for (h, got) in h.chunks(n_h).zip(totals.into_iter().zip(overlaps)) {
                    let (total, overlap) = root_overlap(h, &template);
                    assert!((got.0 - total).abs() < 1e-6 * total, "{level:?} {precision:?}: {} not {total}", got.0);
                    assert!(
                        (got.1 - overlap).abs() < 1e-6 * overlap,
                        "{level:?} {precision:?}: {} not {overlap}",
                        got.1
                    );
                }
            }
        }
    }

    /// A row alone gives the bits it gives in a batch.
    #[test]
    fn a_row_depends_on_itself_alone() {
        let (n, n_v, n_h) = (64, 31, 70);
        let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
        for (level, precision) in every_kind() {
            let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
            let (mut h, mut totals, mut overlaps) = (vec![0.0; n * n_h], vec![0.0; n], vec![0.0; n]);
            packed.features(&glimpses, &bias, &mut h);
            packed.overlaps(&glimpses, &bias, &bias, &mut totals, &mut overlaps);
            for (r, glimpse) in glimpses.chunks(n_v).enumerate() {
                let (mut alone, mut total, mut overlap) = (vec![0.0; n_h], [0.0], [0.0]);
                packed.features(glimpse, &bias, &mut alone);
                packed.overlaps(glimpse, &bias, &bias, &mut total, &mut overlap);
                assert_eq!(alone, h[r * n_h..][..n_h], "{level:?} {precision:?} row {r}");
                assert_eq!((total[0], overlap[0]), (totals[r], overlaps[r]), "{level:?} {precision:?} row {r}");
            }
        }
    }

    #[test]
    fn infinite_sums_saturate_and_nan_stays() {
        for (level, precision) in every_kind() {
            let packed = PackedWeights::new(level, precision, 1, 3, &[1.0, -1.0, 0.0]);
            let mut h = [0.0; 3];
            packed.features(&[1e30], &[0.0, 0.0, f32::NAN], &mut h);
            assert!(h[0] == 1.0 && h[1] < 5e-39 && h[2].is_nan(), "{level:?} {precision:?}: {h:?}");
            let (mut total, mut overlap) = ([0.0], [0.0]);
            packed.overlaps(&[1e30], &[0.0; 3], &[1.0; 3], &mut total, &mut overlap);
            assert!((total[0] - 1.5).abs() < 1e-6 && (overlap[0] - (1.0 + 0.5f32.sqrt())).abs() < 1e-6);
        }
    }

    #[test]
    fn bf16_rounds_to_nearest_even() {
        for (value, rounded) in
            [(1.0, 1.0), (1.003_906_3, 1.0), (1.011_718_8, 1.015_625), (1.004, 1.007_812_5), (-3.0, -3.0)]
        {
            assert_eq!(f32::from_bits(round_to_bf16(value)), rounded);
        }
        assert!(f32::from_bits(round_to_bf16(f32::from_bits(0x7f80_0001))).is_nan());
        assert_eq!(f32::from_bits(round_to_bf16(f32::INFINITY)), f32::INFINITY);
        assert_eq!(pair_of_bf16(1.0, -2.0), 0xc000_3f80);
    }

    #[test]
    fn repacked_is_packed_anew() {
        let (n, n_v, n_h) = (3, 9, 70);
        let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
        for (level, precision) in every_kind() {
            let (mut h, mut again) = (vec![0.0; n * n_h], vec![1.0; n * n_h]);
            PackedWeights::new(level, precision, n_v, n_h, &w).features(&glimpses, &bias, &mut h);
            let mut packed = PackedWeights::new(level, precision, n_v, n_h, &vec![9.0; n_v * n_h]);
            packed.repack(&w);
            packed.features(&glimpses, &bias, &mut again);
            assert_eq!(h, again, "{level:?} {precision:?}");
        }
    }

    #[test]
    fn pooled_sums_agree_with_f64() {
        for (n, n_v, n_h) in [(1, 1, 1), (7, 3, 5), (100, 25, 100), (49, 25, 129)] {
            let (rows, w, thresholds) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
            let gains: Vec<f32> = values(n, 6).iter().map(|x| 5.0 * x).collect();
            let cells: Vec<u32> = (0..n).map(|r| (r * r % 3) as u32).collect();
            let mut truth = vec![0.25f64; 3 * n_h];
            for r in 0..n {
                for j in 0..n_h {
                    let sum: f64 = (0..n_v).map(|i| f64::from(rows[r * n_v + i]) * f64::from(w[i * n_h + j])).sum();
                    let above = f64::from(gains[r]) * sum - f64::from(thresholds[j]);
                    truth[cells[r] as usize * n_h + j] += above.max(0.0);
                }
            }
            for level in Level::all() {
                let mut pooled = vec![0.25; 3 * n_h];
                let packed = PackedWeights::new(level, Precision::F32, n_v, n_h, &w);
                packed.pool(&rows, &gains, &cells, &thresholds, &mut pooled);
                for (&got, &truth) in pooled.iter().zip(&truth) {
                    assert!((f64::from(got) - truth).abs() < 1e-5 * (1.0 + truth), "{level:?}: {got}, not {truth}");
                }
            }
        }
    }

    #[test]
    fn energies_agree_with_f64() {
        for (n, n_v, n_h, size) in [(1, 1, 2, 2), (7, 3, 5, 1), (100, 25, 100, 4), (49, 25, 136, 8)] {
            let (rows, w, thresholds) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
            let gains: Vec<f32> = values(n, 6).iter().map(|x| 5.0 * x).collect();
            let cells: Vec<u32> = (0..n).map(|r| (r * r % 3) as u32).collect();
            let width = n_h / size;
            let mut truth = vec![0.25f64; 3 * width];
            for r in 0..n {
                let above = |j: usize| {
                    let sum: f64 = (0..n_v).map(|i| f64::from(rows[r * n_v + i]) * f64::from(w[i * n_h + j])).sum();
                    f64::from(gains[r]) * sum - f64::from(thresholds[j])
                };
                for i in 0..width {
                    let energy: f64 = (i * size..(i + 1) * size).map(|j| above(j).powi(2)).sum();
                    truth[cells[r] as usize * width + i] += energy.sqrt();
                }
            }
            for level in Level::all() {
                let mut pooled = vec![0.25; 3 * width];
                let packed = PackedWeights::new(level, Precision::F32, n_v, n_h, &w);
                packed.energies(&rows, &gains, &cells, (&thresholds, size), &mut pooled);
                for (&got, &truth) in pooled.iter().zip(&truth) {
                    assert!((f64::from(got) - truth).abs() < 1e-5 * (1.0 + truth), "{level:?}: {got}, not {truth}");
                }
            }
        }
    }

    #[test]
    fn no_glimpses_no_features() {
        PackedWeights::bf16(2, 3, &[0.0; 6]).features(&[], &[0.0; 3], &mut []);
    }
}
