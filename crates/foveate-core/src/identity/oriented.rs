//! Gradients, grey and colour: a first layer that needs no training.
//!
//! The retina's grey cells are one square of (4 n + 2)² cells: n × n blocks of 4 × 4 cells with a border of one. Features are, in
//! this order,
//! ```text
//! gradients    n × n × 8   square roots of each block's sums of gradient in eight directions (Dalal & Triggs, 2005)
//! grey         2n × 2n     sums of 2 × 2 cells
//! colour                   the opponent cells, less the value of grey
//! ```
//! A part with weight 0 is omitted. The mean is subtracted from all parts but colour, and each part is scaled to the
//! root of its weight, so that the cosine of two feature vectors is the weighted mean of the cosines of their parts.
//! The paper's first layer is learned (section 2.1); on real video none of ours matches this one.

use foveate_kernels as kernels;

use super::discriminant::Place;
use super::encoder::Encoder;
use super::retina::Cell;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};

foveate_base::settings! {
    /// The weight of each part of the features: ridge regression found no use in others.
    #[derive(Copy)]
    pub struct Weights in "encoder.weights" {
        /// Weight of the gradients, 0 to 1000.
        pub gradients: f32 = 0.6; 0.0 to 1000.0,
        /// Weight of grey, 0 to 1000.
        pub grey: f32 = 0.2; 0.0 to 1000.0,
        /// Weight of both colour channels together, 0 to 1000.
        pub colour: f32 = 0.2; 0.0 to 1000.0,
    }
}

/// Lengths of a part, in its values' root mean square, that count as flat: less contrast than that is noise.
const FLAT: [f32; 3] = [0.05, 0.1, 0.03];

/// The value of a colour channel without colour.
pub(super) const NEITHER: f32 = 128.0 / 255.0;

/// Gradients, grey and colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oriented {
    blocks: usize,
    cells: usize,
    colour: usize,
    lengths: kernels::Lengths,
}

impl Oriented {
    /// For a retina whose cells have these channels. Fails if grey is not a square of 6, 10, 14 and so on to 34 cells
    /// a side, or a weight is negative.
    pub fn new(channels: &[usize], weights: Weights) -> Result<Self> {
        let cells = channels.iter().filter(|c| **c == 0).count();
        let side = cells.isqrt();
        if side * side != cells || !(6..=34).contains(&side) || !(side - 2).is_multiple_of(kernels::BLOCK) {
            return Err(Error::Config(format!(
                "the oriented encoder needs a retina of one ring, of 6, 10, 14, 18, 22, 26, 30 or 34 cells a side, such as rings = \
                 [[18, 1]]; this one has {cells} grey cells"
            )));
        }
        weights.check()?;
        let [gradients, grey, colour] = [weights.gradients, weights.grey, weights.colour].map(f32::sqrt);
        let length = [gradients, grey, colour * std::f32::consts::FRAC_1_SQRT_2];
        let (blocks, lengths) =
            ((side - 2) / kernels::BLOCK, kernels::Lengths { length, flat: FLAT, neither: NEITHER });
        Ok(Self { blocks, cells, colour: channels.len() - cells, lengths })
    }

    /// What each feature measures and where, of a retina with these cells.
    pub(crate) fn places(&self, cells: &[Cell]) -> Vec<Place> {
        let side = self.cells.isqrt();
        let [gradients, grey, colour] = self.lengths.sizes(self.blocks, self.colour);
        // The middle of a square of cells inside the border.
        let middle = |row: usize, column: usize, n: usize| {
            let cell = |i: usize, j: usize| &cells[(1 + n * row + i) * side + 1 + n * column + j];
            let (first, last) = (cell(0, 0), cell(n - 1, n - 1));
            (0.5 * (first.u + last.u), 0.5 * (first.v + last.v))
        };
        let block = |k: usize| {
            middle(k / kernels::DIRECTIONS / self.blocks, k / kernels::DIRECTIONS % self.blocks, kernels::BLOCK)
        };
        let pair = |k: usize| middle(k / (2 * self.blocks), k % (2 * self.blocks), kernels::BLOCK / 2);
        let opponent = |k: usize| (cells[self.cells + k].u, cells[self.cells + k].v);
        let place = |quantity: usize, (u, v): (f64, f64)| Place { quantity, u, v };
        let gradients = (0..gradients).map(|k| place(k % kernels::DIRECTIONS, block(k)));
        let grey = (0..grey).map(|k| place(0, pair(k)));
        let colour = (0..colour).map(|k| place(cells[self.cells + k].channel, opponent(k)));
        gradients.chain(grey).chain(colour).collect()
    }

    /// Blocks along a side, and the lengths of the parts, for `kernels::oriented_features`.
    pub(super) fn blocks(&self) -> (usize, kernels::Lengths) {
        (self.blocks, self.lengths)
    }
}

impl Encoder for Oriented {
    fn shape(&self) -> (usize, usize) {
        (self.cells + self.colour, self.lengths.sizes(self.blocks, self.colour).iter().sum())
    }

    fn parts(&self) -> Vec<usize> {
        self.lengths.sizes(self.blocks, self.colour).to_vec()
    }

    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        let (n_v, n_h) = self.shape();
        for (v, h) in glimpses.data().chunks_exact(n_v).zip(features.data().chunks_exact_mut(n_h)) {
            kernels::oriented_features(v, self.blocks, &self.lengths, h);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::geometry::{Extent, Gaze, State};
    use crate::identity::Retina;
    use crate::identity::pyramid::{Pyramid, Region};
    use crate::identity::retina::{Foveal, FovealConfig};
    use crate::scene::Image;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    fn channels(grey: usize, colour: usize) -> Vec<usize> {
        [vec![0; grey], vec![1; colour], vec![2; colour]].concat()
    }

    #[test]
    fn it_keeps_the_law() {
        let mut rng = Streams::new(2, 0).rng(0);
        for (side, colour, grey) in [(6, 0, 0.2), (18, 16, 0.2), (26, 36, 0.2), (18, 16, 0.0), (34, 0, 2.0)] {
            let weights = Weights { grey, ..Weights::default() };
            let it = Oriented::new(&channels(side * side, colour), weights).expect("blocks and a border");
            let glimpses: Vec<f32> = (0..7 * it.shape().0).map(|_| rng.random()).collect();
            conformance::encoder(&it, &glimpses);
        }
    }

    /// Light that doubles and shifts changes little; flat glimpses are short; lengths are the weights.
    #[test]
    fn contrast_and_brightness_do_not_matter_much() {
        let mut rng = Streams::new(2, 0).rng(1);
        let it = Oriented::new(&channels(324, 16), Weights::default()).expect("4 blocks and a border");
        let dark: Vec<f32> = (0..324).map(|_| 0.4 * rng.random::<f32>()).chain([128.0 / 255.0; 32]).collect();
        let bright: Vec<f32> = dark[..324].iter().map(|v| 2.0 * v + 0.1).chain([128.0 / 255.0; 32]).collect();
        let encode = |v: &[f32]| {
            let mut h = vec![0.0; it.shape().1];
            it.encode(Rows::new(v, v.len()), RowsMut::new(&mut h, it.shape().1));
            h
        };
        let (a, b, flat) = (encode(&dark), encode(&bright), encode(&[0.5; 356]));
        let norm = |h: &[f32]| kernels::dot(h, h).sqrt();
        assert!(kernels::dot(&a, &b) / norm(&a) / norm(&b) > 0.99);
        // Beside contrast without end nothing is flat: gradients and grey have all of their weights, 0.6 and 0.2.
        let endless = encode(&dark.iter().map(|v| if *v > 0.5 { *v } else { 1e6 * v }).collect::<Vec<f32>>());
        assert!((norm(&endless) - 0.8f32.sqrt()).abs() < 1e-3, "{}", norm(&endless));
        assert!(norm(&flat) < 0.1, "{}", norm(&flat));
    }

    /// A patch of the picture shows in the same feature of the template, whichever gaze reads it.
    #[test]
    fn a_feature_is_at_its_place_under_each_gaze() {
        let config = FovealConfig { side: 16.0, rings: vec![[10, 1]], colour: vec![[8, 4]] };
        let retina = Foveal::new(config).expect("whole cells");
        let it = Oriented::new(&retina.channels(), Weights::default()).expect("2 blocks and a border");
        let places = it.places(retina.cells());
        let (extent, at) = (Extent { half_w: 32.0, half_h: 32.0 }, State { x: 64.0, y: 64.0, ..State::default() });
        // In the middle of a block of the centre and of three gazes about it: bright, then red.
        let patch = [-0.25, 0.25].map(|place| (64.0 + 32.0 * place) as usize);
        for (colour, parts) in [([255; 3], 0..2), ([255, 60, 60], 2..3)] {
            let near = |x: usize, y: usize| x.abs_diff(patch[0]) <= 4 && y.abs_diff(patch[1]) <= 4;
            let pixel = |i: usize| if near(i % 128, i / 128) { colour } else { [128; 3] };
            let bytes: Vec<u8> = (0..128 * 128).flat_map(pixel).collect();
            let image = Image::from_rgb8(128, 128, &bytes).expect("128 x 128");
            let (mut pyramid, mut v, mut h) = (Pyramid::default(), vec![0.0; it.shape().0], vec![0.0; it.shape().1]);
            let gazes = [(0.0, 0.0), (-0.5, 0.0), (0.0, 0.5), (-0.5, 0.5)].map(|(u, v)| Gaze { u, v, arm: None });
            let region = Region::covering(&image, &[at], &gazes, extent, 2.0);
            pyramid.build(&image, region, retina.footprints(), (extent.half_w, extent.half_h));
            for gaze in gazes {
                retina.look(&pyramid, at.fixate(gaze, extent), &mut v);
                it.encode(Rows::new(&v, v.len()), RowsMut::new(&mut h, it.shape().1));
                let mut begun = 0;
                for (part, length) in it.parts().into_iter().enumerate() {
                    let of = begun..begun + length;
                    begun += length;
                    if !parts.contains(&part) {
                        continue;
                    }
                    let largest = of.max_by(|a, b| h[*a].abs().total_cmp(&h[*b].abs())).expect("features");
                    let Place { u, v, .. } = places[largest];
                    let off = (gaze.u + u + 0.25).abs().max((gaze.v + v - 0.25).abs());
                    // Grey has four sums of cells in a block.
                    assert!(off <= if part == 1 { 0.126 } else { 1e-6 }, "part {part} under {gaze:?}: {off}");
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let said = Oriented::new(&channels(16 * 16, 0), Weights::default()).expect_err("no border").to_string();
        assert!(said.contains("[[18, 1]]") && said.contains("256 grey cells"), "{said}");
        let wrong = Weights { grey: -1.0, ..Weights::default() };
        assert!(Oriented::new(&channels(324, 0), wrong).expect_err("negative").to_string().contains("weights"));
    }
}
