//! Epilogues of the product: the logistic function, and either the features or their overlap with a template.
//!
//! Sums y come times -log₂ e, so that a feature is h = 1 / (1 + 2^y); the bias is brought to that scale here.

use crate::level::{greater, multiply_add, reciprocal_root};
use crate::logistic::one_plus_exp2;
use crate::sums::fold;
use crate::tile::{BLOCK, TILE};

/// logistic(x) = 1 / (1 + 2^(x × this)).
pub(crate) const TO_EXP2: f32 = -std::f32::consts::LOG2_E;
/// The most glimpses that share a tile while it is in the cache.
pub(crate) const TOGETHER: usize = 8 * BLOCK;

/// An operation on the sums of up to [`TOGETHER`] glimpses.
pub(crate) trait End {
    /// The next sums are of columns `left..left + 64`.
    fn tile(&mut self, left: usize);
    /// Takes the sums of glimpses `first..` of those in hand.
    fn take<const V: u8>(&mut self, first: usize, sums: &[[f32; TILE]]);
    /// All columns of `rows` glimpses have been taken; others follow.
    fn finish<const V: u8>(&mut self, rows: usize);
}

/// `values[left..]`, up to a tile, filled up with zeros.
pub(crate) fn padded(values: &[f32], left: usize) -> [f32; TILE] {
    let mut tile = [0.0; TILE];
    let width = TILE.min(values.len() - left);
    tile[..width].copy_from_slice(&values[left..left + width]);
    tile
}

/// Writes the features.
pub(crate) struct Features<'a> {
    bias: &'a [f32],
    /// Those not yet written.
    features: &'a mut [f32],
    left: usize,
    tile_bias: [f32; TILE],
}

impl<'a> Features<'a> {
    pub(crate) fn new(bias: &'a [f32], features: &'a mut [f32]) -> Self {
        Self { bias, features, left: 0, tile_bias: [0.0; TILE] }
    }
}

impl End for Features<'_> {
    fn tile(&mut self, left: usize) {
        self.left = left;
        self.tile_bias = padded(self.bias, left).map(|b| TO_EXP2 * b);
    }

    #[inline(always)]
    fn take<const V: u8>(&mut self, first: usize, sums: &[[f32; TILE]]) {
        let rows = self.features[first * self.bias.len()..].chunks_exact_mut(self.bias.len());
        for (sums, row) in sums.iter().zip(rows) {
            // Written in place where the tile is whole: a copy would wait for the stores just before it.
            let row = &mut row[self.left..];
            if let Some(row) = row.first_chunk_mut::<TILE>() {
                for ((h, sum), b) in row.iter_mut().zip(sums).zip(&self.tile_bias) {
                    *h = 1.0 / one_plus_exp2::<V>(sum + b);
                }
            } else {
                for ((h, sum), b) in row.iter_mut().zip(sums).zip(&self.tile_bias) {
                    *h = 1.0 / one_plus_exp2::<V>(sum + b);
                }
            }
        }
    }

    #[inline(always)]
    fn finish<const V: u8>(&mut self, rows: usize) {
        self.features = &mut std::mem::take(&mut self.features)[rows * self.bias.len()..];
    }
}

/// Sums the features and their overlap with the template, in 16 lanes.
pub(crate) struct Overlaps<'a> {
    bias: &'a [f32],
    template_root: &'a [f32],
    /// Those not yet written.
    totals: &'a mut [f32],
    overlaps: &'a mut [f32],
    tile_bias: [f32; TILE],
    tile_root: [f32; TILE],
    /// 1 for a column that exists, else 0.
    tile_exists: [f32; TILE],
    /// Of each glimpse in hand: the total and the overlap.
    lanes: [[[f32; 16]; 2]; TOGETHER],
}

impl<'a> Overlaps<'a> {
    pub(crate) fn new(
        bias: &'a [f32],
        template_root: &'a [f32],
        totals: &'a mut [f32],
        overlaps: &'a mut [f32],
    ) -> Self {
        let (zero, lanes) = ([0.0; TILE], [[[0.0; 16]; 2]; TOGETHER]);
        Self { bias, template_root, totals, overlaps, tile_bias: zero, tile_root: zero, tile_exists: zero, lanes }
    }
}

impl End for Overlaps<'_> {
    fn tile(&mut self, left: usize) {
        self.tile_bias = padded(self.bias, left).map(|b| TO_EXP2 * b);
        self.tile_root = padded(self.template_root, left);
        self.tile_exists = std::array::from_fn(|c| if left + c < self.bias.len() { 1.0 } else { 0.0 });
    }

    #[inline(always)]
    fn take<const V: u8>(&mut self, first: usize, sums: &[[f32; TILE]]) {
        for (sums, lanes) in sums.iter().zip(&mut self.lanes[first..]) {
            // Held in registers: in memory each line would wait for the stores of the one before.
            let [mut total, mut overlap] = *lanes;
            for line in 0..TILE / 16 {
                let part = 16 * line..16 * line + 16;
                let (sums, bias) = (&sums[part.clone()], &self.tile_bias[part.clone()]);
                // The root of h = 1 / (1 + 2^y).
                let below = std::array::from_fn(|i| one_plus_exp2::<V>(sums[i] + bias[i]));
                let root = reciprocal_root::<V>(&below);
                let (exists, template) = (&self.tile_exists[part.clone()], &self.tile_root[part]);
                for i in 0..16 {
                    total[i] = multiply_add::<V>(root[i] * root[i], exists[i], total[i]);
                    overlap[i] = multiply_add::<V>(root[i], template[i], overlap[i]);
                }
            }
            *lanes = [total, overlap];
        }
    }

    #[inline(always)]
    fn finish<const V: u8>(&mut self, rows: usize) {
        for (r, [total, overlap]) in self.lanes[..rows].iter_mut().enumerate() {
            (self.totals[r], self.overlaps[r]) = (fold(*total), fold(*overlap));
            (*total, *overlap) = ([0.0; 16], [0.0; 16]);
        }
        self.totals = &mut std::mem::take(&mut self.totals)[rows..];
        self.overlaps = &mut std::mem::take(&mut self.overlaps)[rows..];
    }
}

/// Adds the excess above a threshold to the cell of each row.
pub(crate) struct Pooled<'a> {
    /// gain × sum − threshold counts; the gains of rows not yet taken, back on the sums' scale.
    gains: &'a [f32],
    thresholds: &'a [f32],
    /// The cells of rows not yet taken.
    cells: &'a [u32],
    pooled: &'a mut [f32],
    left: usize,
    tile_thresholds: [f32; TILE],
}

impl<'a> Pooled<'a> {
    pub(crate) fn new(gains: &'a [f32], thresholds: &'a [f32], cells: &'a [u32], pooled: &'a mut [f32]) -> Self {
        Self { gains, thresholds, cells, pooled, left: 0, tile_thresholds: [0.0; TILE] }
    }
}

impl End for Pooled<'_> {
    fn tile(&mut self, left: usize) {
        self.left = left;
        self.tile_thresholds = padded(self.thresholds, left);
    }

    #[inline(always)]
    fn take<const V: u8>(&mut self, first: usize, sums: &[[f32; TILE]]) {
        let width = self.thresholds.len();
        for (r, sums) in sums.iter().enumerate() {
            let gain = self.gains[first + r] / TO_EXP2;
            let cell = &mut self.pooled[self.cells[first + r] as usize * width..][..width][self.left..];
            if let Some(cell) = cell.first_chunk_mut::<TILE>() {
                for ((h, sum), t) in cell.iter_mut().zip(sums).zip(&self.tile_thresholds) {
                    *h += greater(multiply_add::<V>(gain, *sum, -t), 0.0);
                }
            } else {
                for ((h, sum), t) in cell.iter_mut().zip(sums).zip(&self.tile_thresholds) {
                    *h += greater(multiply_add::<V>(gain, *sum, -t), 0.0);
                }
            }
        }
    }

    #[inline(always)]
    fn finish<const V: u8>(&mut self, rows: usize) {
        (self.gains, self.cells) = (&self.gains[rows..], &self.cells[rows..]);
    }
}
