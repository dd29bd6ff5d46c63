//! A convolutional first layer: filters on the patches of every ring, and pooling (Coates, Ng & Lee 2011).
//!
//! Each ring of the retina is a small image, its hole filled with the means of the finer cells there. A patch at every place
//! of each image is normalised, and is filtered; responses are averaged over the cells of a grid, `pool` × `pool` to
//! an image. A row has images × pool² × n features, at least 0, in this order. A filter means the same at every place and
//! in every ring, so that a model serves any retina. A filter d (k-means) of a whitened patch x gives max(0, d·x − threshold).

use foveate_kernels as kernels;

use super::encoder::{Channels, Encoder};
use super::retina::Cell;
use foveate_base::rng::Streams;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use foveate_learn::filters::PatchFilters;
use foveate_learn::rbm::product::rows_times;
use rand::RngExt;

/// The most pixels that all images have together.
const PIXELS: usize = 8100;
/// The most values of a patch, and the most filters.
const MOST: (usize, usize) = (64, 400);
/// Patches that meet the filters at a time.
const TOGETHER: usize = 48;
/// Pixels along a side of the widest image.
const WIDEST: usize = 90;

/// From the values of a glimpse to patches of images.
#[derive(Clone, Debug)]
pub struct Patches {
    n_v: usize,
    /// Values of the glimpse and their shares, pixel after pixel; `ends` has where each pixel's end.
    taps: Vec<(u32, f32)>,
    ends: Vec<u32>,
    /// Pixels along a side of a patch.
    side: usize,
    places: Vec<Place>,
    /// Of each image: its first pixel, and pixels along a side.
    images: Vec<(usize, usize)>,
    cells: usize,
}

/// One patch: its first pixel, pixels from row to row, and the pooling cell it counts for.
#[derive(Clone, Copy, Debug)]
struct Place {
    first: usize,
    stride: usize,
    cell: usize,
}

impl Patches {
    /// Of `side` × `side` pixels, on the images of a retina with these cells, pooled over `pool` × `pool` cells an image.
    ///
    /// Fails if an image is too small for that, or the retina leaves a part of an image unseen.
    pub fn new(cells: &[Cell], side: usize, pool: usize) -> Result<Self> {
        let mut it =
            Self { n_v: cells.len(), taps: vec![], ends: vec![], side, places: vec![], images: vec![], cells: 0 };
        let mut from = 0;
        while from < cells.len() {
            let Cell { half, channel, .. } = cells[from];
            let run = cells[from..].iter().take_while(|c| (c.half, c.channel) == (half, channel)).count();
            let to = from + run;
            let reach = cells[from..to].iter().map(|c| c.u.abs() + half).fold(0.0, f64::max);
            let n = (reach / half).round() as usize;
            if side == 0 || pool == 0 || n < side + pool - 1 || it.ends.len() + n * n > PIXELS {
                return Err(Error::Config(format!(
                    "a ring of {n} x {n} cells has no {pool} x {pool} patches of {side} x {side}, or all rings together have over {PIXELS} \
                     cells; use a wider window or smaller cells in the retina, a smaller patch, or a smaller pool"
                )));
            }
            let seen: Vec<(usize, &Cell)> =
                cells[..to].iter().enumerate().filter(|(_, c)| c.channel == channel).collect();
            let first = it.ends.len();
            for pixel in 0..n * n {
                let at = |i: usize| (i as f64 - (n - 1) as f64 / 2.0) * 2.0 * half;
                it.pixel(at(pixel % n), at(pixel / n), half, &seen)?;
            }
            it.images.push((first, n));
            let across = n - side + 1;
            for place in 0..across * across {
                let (row, column) = (place / across, place % across);
                let cell = it.cells + row * pool / across * pool + column * pool / across;
                it.places.push(Place { first: first + row * n + column, stride: n, cell });
            }
            it.cells += pool * pool;
            from = to;
        }
        Ok(it)
    }
    /// The pixel of this centre and half side: the cells it overlaps, by the share of it that each covers.
    fn pixel(&mut self, u: f64, v: f64, half: f64, cells: &[(usize, &Cell)]) -> Result<()> {
        let along = |a: f64, b: f64, other: f64| ((a + half).min(b + other) - (a - half).max(b - other)).max(0.0);
        let mut whole = 0.0;
        for (i, c) in cells {
            let share = along(u, c.u, c.half) * along(v, c.v, c.half) / (4.0 * half * half);
            if share > 1e-6 {
                self.taps.push((*i as u32, share as f32));
                whole += share;
            }
        }
        self.ends.push(self.taps.len() as u32);
        if (whole - 1.0).abs() > 1e-3 {
            return Err(Error::Config(format!(
                "the retina's cells cover {:.0} % of the square around ({u:.2}, {v:.2}); convolution needs rings without gaps",
                100.0 * whole
            )));
        }
        Ok(())
    }
    /// Values of one.
    pub fn width(&self) -> usize {
        self.side * self.side
    }
    /// The images of a glimpse, one after the other.
    fn draw(&self, glimpse: &[f32], pixels: &mut [f32]) {
        let mut from = 0;
        for (pixel, &end) in pixels.iter_mut().zip(&self.ends) {
            let taps = &self.taps[from..end as usize];
            *pixel = taps.iter().map(|&(i, share)| share * glimpse[i as usize]).sum();
            from = end as usize;
        }
    }
    fn cut(&self, place: Place, pixels: &[f32], patch: &mut [f32]) {
        for (row, to) in patch.chunks_exact_mut(self.side).enumerate() {
            to.copy_from_slice(&pixels[place.first + row * place.stride..][..self.side]);
        }
    }
    /// 1 / √(variance + softening) of every patch.
    fn gains(&self, pixels: &[f32], softening: f32, gains: &mut [f32]) {
        let (side, n_p) = (self.side, self.width() as f32);
        let (mut from, mut sums) = (0, [[0.0f32; WIDEST]; 2]);
        for &(first, n) in &self.images {
            let across = n - side + 1;
            for top in 0..across {
                // Columns of as many pixels as a patch has rows, then patches of as many columns.
                sums.iter_mut().for_each(|s| s[..n].fill(0.0));
                let [plain, squares] = &mut sums;
                for row in pixels[first + top * n..][..side * n].chunks_exact(n) {
                    for ((plain, square), x) in plain.iter_mut().zip(&mut *squares).zip(row) {
                        *plain += x;
                        *square += x * x;
                    }
                }
                for (left, gain) in gains[from..from + across].iter_mut().enumerate() {
                    let mean = plain[left..left + side].iter().sum::<f32>() / n_p;
                    let square = squares[left..left + side].iter().sum::<f32>() / n_p;
                    *gain = 1.0 / ((square - mean * mean).max(0.0) + softening).sqrt();
                }
                from += across;
            }
        }
    }
    /// `n` patches as they are, a row each, of glimpses in turn, at random places.
    pub fn some(&self, glimpses: Rows<'_>, n: usize, streams: Streams) -> Vec<f32> {
        let (mut rng, mut pixels) = (streams.rng(0), [0.0; PIXELS]);
        let mut patches = vec![0.0; n * self.width()];
        for (i, patch) in patches.chunks_exact_mut(self.width()).enumerate() {
            self.draw(glimpses.row(i % glimpses.len()), &mut pixels);
            self.cut(self.places[rng.random_range(0..self.places.len())], &pixels, patch);
        }
        patches
    }
}

/// Filters convolved with the rings, pooled.
#[derive(Debug)]
pub struct ConvolutionEncoder {
    patches: Patches,
    /// From a patch less its mean to the responses of the filters.
    packed: kernels::PackedWeights,
    /// The response of a filter counts above this.
    thresholds: Vec<f32>,
    softening: f32,
    /// Of each pooling cell: 1 / (√n_x × its patches).
    shares: Vec<f32>,
    /// Of each place.
    cells: Vec<u32>,
    channels: Channels,
}

impl ConvolutionEncoder {
    /// Encodes with these filters the glimpses of a retina with these cells; each channel of a glimpse is standardised first,
    /// as in their training. A filter counts for what its product with a patch is above `threshold`.
    ///
    /// Fails if a ring is too small for the patches, or the threshold is not a number.
    pub fn new(model: &PatchFilters, cells: &[Cell], pool: usize, threshold: f32) -> Result<Self> {
        let (n_p, n_x, k) = model.shape();
        let side = n_p.isqrt();
        let softening = model.softening().filter(|_| side * side == n_p && n_p <= MOST.0 && k <= MOST.1);
        let Some(softening) = softening.filter(|_| threshold.is_finite()) else {
            return Err(Error::Config(format!(
                "convolution needs square patches of at most {} values, a softening, at most {} filters and a finite threshold, got patches of \
                 {n_p} values, softening {:?}, {k} filters and {threshold}",
                MOST.0,
                MOST.1,
                model.softening()
            )));
        };
        let (patches, whitening) = (Patches::new(cells, side, pool)?, model.whitening());
        // A patch p with gain g is whitened to (g (p − its mean) − m) A, and the responses of the filters D are that times D: one product with
        // A D without the mean of each column.
        let filters = model.filters().data();
        let mut responses = vec![0.0; n_p * k];
        rows_times(whitening.matrix(), filters, &mut responses);
        let mut thresholds = vec![threshold; k];
        for (m, row) in whitening.mean().iter().zip(responses.chunks_exact(k)) {
            thresholds.iter_mut().zip(row).for_each(|(t, x)| *t += m * x);
        }
        for j in 0..k {
            let mean = (0..n_p).map(|i| responses[i * k + j]).sum::<f32>() / n_p as f32;
            (0..n_p).for_each(|i| responses[i * k + j] -= mean);
        }
        let mut counts = vec![0.0f32; patches.cells];
        patches.places.iter().for_each(|p| counts[p.cell] += 1.0);
        let channels: Vec<usize> = cells.iter().map(|c| c.channel).collect();
        Ok(Self {
            packed: kernels::PackedWeights::f32(n_p, k, &responses),
            thresholds,
            softening,
            shares: counts.iter().map(|n| 1.0 / (n * (n_x as f32).sqrt())).collect(),
            cells: patches.places.iter().map(|p| p.cell as u32).collect(),
            channels: Channels::of(&channels),
            patches,
        })
    }
    /// Features of a pooling cell.
    fn width(&self) -> usize {
        self.thresholds.len()
    }
}

impl Encoder for ConvolutionEncoder {
    fn shape(&self) -> (usize, usize) {
        (self.patches.n_v, self.shares.len() * self.width())
    }
    fn condition(&self, glimpse: &mut [f32]) {
        self.channels.standardise(glimpse);
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        let ((_, n_h), n_p, k) = (self.shape(), self.patches.width(), self.width());
        let (mut pixels, mut gains, mut patches) = ([0.0; PIXELS], [0.0; PIXELS], [0.0; TOGETHER * MOST.0]);
        for (glimpse, h) in glimpses.iter().zip(features.data().chunks_exact_mut(n_h)) {
            self.patches.draw(glimpse, &mut pixels);
            self.patches.gains(&pixels, self.softening, &mut gains);
            h.fill(0.0);
            let places = self.patches.places.chunks(TOGETHER).zip(self.cells.chunks(TOGETHER));
            for ((places, cells), gains) in places.zip(gains.chunks(TOGETHER)) {
                let patches = &mut patches[..places.len() * n_p];
                for (&place, patch) in places.iter().zip(patches.chunks_exact_mut(n_p)) {
                    self.patches.cut(place, &pixels, patch);
                }
                let gains = &gains[..places.len()];
                self.packed.pool(patches, gains, cells, &self.thresholds, h);
            }
            for (h, share) in h.chunks_exact_mut(k).zip(&self.shares) {
                h.iter_mut().for_each(|h| *h *= share);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::identity::retina::{Foveal, FovealConfig, Retina};
    use foveate_learn::filters::{Recipe, Trainer};
    use foveate_learn::training::Training;

    fn cells(rings: &[[usize; 2]], colour: &[[usize; 2]]) -> Vec<Cell> {
        let config = FovealConfig { side: 28.0, rings: rings.to_vec(), colour: colour.to_vec() };
        Foveal::new(config).expect("whole cells").cells().to_vec()
    }

    fn random(n: usize) -> Vec<f32> {
        let mut rng = Streams::new(8, 0).rng(0);
        (0..n).map(|_| rng.random()).collect()
    }

    fn model(side: usize, filters: usize) -> PatchFilters {
        let data = random(side * side * 600);
        let recipe = Recipe { keep: 0.95, ..Recipe::new(filters) };
        let mut trainer = Trainer::new(recipe, Rows::new(&data, side * side)).expect("patches");
        (0..3).for_each(|_| trainer.step(Rows::new(&data, side * side)));
        trainer.learned().clone()
    }

    #[test]
    fn it_keeps_the_law() {
        for (rings, colour, filters, threshold) in [
            (&[[8, 1], [16, 2], [32, 4]][..], &[][..], 100, 1.0),
            (&[[8, 1], [16, 2]], &[[16, 2]], 30, 0.0),
            (&[[28, 1]], &[], 50, 0.5),
        ] {
            let cells = cells(rings, colour);
            let encoder = ConvolutionEncoder::new(&model(5, filters), &cells, 2, threshold).expect("they fit");
            let mut glimpses = random(7 * cells.len());
            glimpses.chunks_exact_mut(cells.len()).for_each(|glimpse| encoder.condition(glimpse));
            glimpses[..cells.len()].fill(0.0);
            conformance::encoder(&encoder, &glimpses);
            assert_eq!(encoder.shape(), (cells.len(), (rings.len() + 2 * colour.len()) * 4 * filters));
        }
    }

    /// The definition, by plain loops in f64 over images drawn cell by cell.
    #[test]
    fn it_is_a_convolution() {
        let cells = cells(&[[8, 1], [16, 2], [32, 4]], &[]);
        let glimpse = random(cells.len());
        for threshold in [0.3, 0.0, 1.0] {
            let model = model(5, 20);
            let (_, n_x, k) = model.shape();
            let (mean, matrix, filters) = (model.whitening().mean(), model.whitening().matrix(), model.filters());
            let n = k;
            let mut expected = vec![0.0f64; 3 * 4 * n];
            for (ring, &size) in [1.0f64, 2.0, 4.0].iter().enumerate() {
                let image = |row: usize, column: usize| -> f64 {
                    // Mean over the 1-pixel squares of this pixel, each the value of the finest cell that has its middle.
                    let steps = size as usize;
                    let at = |i: usize, s: usize| ((i as f64 - 4.0) * size + s as f64 + 0.5) / 14.0;
                    let mut sum = 0.0;
                    for s in 0..steps * steps {
                        let (u, v) = (at(column, s % steps), at(row, s / steps));
                        let found = cells.iter().position(|c| (u - c.u).abs() < c.half && (v - c.v).abs() < c.half);
                        sum += f64::from(glimpse[found.expect("a cell everywhere")]);
                    }
                    sum / (steps * steps) as f64
                };
                for place in 0..16 {
                    let (top, left) = (place / 4, place % 4);
                    let mut p: Vec<f64> = (0..25).map(|i| image(top + i / 5, left + i % 5)).collect();
                    let m = p.iter().sum::<f64>() / 25.0;
                    p.iter_mut().for_each(|x| *x -= m);
                    let gain = (p.iter().map(|x| x * x).sum::<f64>() / 25.0
                        + f64::from(model.softening().expect("patches lose their mean")))
                    .sqrt();
                    p.iter_mut().for_each(|x| *x /= gain);
                    let x: Vec<f64> = (0..n_x)
                        .map(|j| (0..25).map(|i| (p[i] - f64::from(mean[i])) * f64::from(matrix.row(i)[j])).sum())
                        .collect();
                    let s: Vec<f64> =
                        (0..k).map(|f| (0..n_x).map(|j| x[j] * f64::from(filters.row(j)[f])).sum()).collect();
                    let cell = ring * 4 + top / 2 * 2 + left / 2;
                    let above = |s: f64| (s - f64::from(threshold)).max(0.0);
                    for (f, s) in s.iter().enumerate() {
                        expected[cell * n + f] += above(*s) / 4.0 / (n_x as f64).sqrt();
                    }
                }
            }
            let encoder = ConvolutionEncoder::new(&model, &cells, 2, threshold).expect("they fit");
            let mut h = vec![f32::NAN; 12 * n];
            encoder.encode(Rows::new(&glimpse, cells.len()), RowsMut::new(&mut h, 12 * n));
            for (i, (h, e)) in h.iter().zip(&expected).enumerate() {
                assert!((f64::from(*h) - e).abs() < 1e-4, "{threshold}, {i}: {h}, not {e}");
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let why = |rings: &[[usize; 2]], side: usize, pool: usize| {
            Patches::new(&cells(rings, &[]), side, pool).expect_err("refused").to_string()
        };
        assert!(why(&[[8, 1], [16, 4]], 5, 2).contains("4 x 4 cells"));
        assert!(why(&[[8, 1]], 5, 5).contains("no 5 x 5 patches"));
        assert!(why(&[[8, 1]], 0, 2).contains("smaller"));
        assert!(why(&[[128, 1]], 5, 2).contains("over 8100"));
        let gap = [Cell { u: 0.0, v: 0.0, half: 0.1, channel: 0 }, Cell { u: 1.0, v: 0.0, half: 0.25, channel: 0 }];
        assert!(Patches::new(&gap, 1, 1).expect_err("a gap").to_string().contains("without gaps"));
        assert!(ConvolutionEncoder::new(&model(5, 9), &cells(&[[8, 1]], &[]), 2, f32::NAN).is_err());
    }
}
