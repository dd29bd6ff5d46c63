//! The integral image of the colour model: sums of p(target | bin) over boxes are four reads.

use foveate_kernels as kernels;
use std::ops::Range;

use crate::scene::Image;
use foveate_base::memory::grow;

/// Bins of a grey and of a colour picture: 32 levels, or 16 × 16 × 16 colours.
pub(super) const GREY: usize = 32;
/// See [`GREY`].
pub(super) const COLOUR: usize = kernels::COLOUR_BINS;

/// Samples across half of the smaller side of a box: large targets are not read pixel by pixel.
const SAMPLES: f64 = 12.0;
/// Probabilities are whole numbers of this part of one: sums over a million samples fit in 32 bits.
const ONE: f32 = 4096.0;

/// Spacing of samples in pixels, by the smaller half side of boxes.
pub(super) fn step(half: f64) -> usize {
    (half / SAMPLES).max(1.0) as usize
}

/// Fills `parts` with p(target | bin) of all bins as [`Integral`] sums it.
pub(super) fn parts(probability: &[f32], parts: &mut Vec<u16>) {
    parts.clear();
    parts.extend(probability.iter().map(|p| (p * ONE + 0.5) as u16));
}

/// Room for the bins of a row.
#[derive(Clone, Debug, Default)]
pub(super) struct Bins(Vec<u16>);

impl Bins {
    /// The bins of some of a row's pixels.
    pub(super) fn of(&mut self, image: &Image, y: usize, columns: Range<usize>) -> &[u16] {
        let row = |p: usize| &image.plane(p)[y * image.width()..][columns.clone()];
        let bins = &mut self.0;
        bins.resize(columns.len(), 0);
        match image.planes() {
            1 => bins.iter_mut().zip(row(0)).for_each(|(bin, grey)| *bin = u16::from(grey >> 3)),
            _ => kernels::colour_bins([0, 1, 2].map(row), bins),
        }
        bins
    }
}

/// Sums of probabilities over all boxes of a region, a sample every `step` pixels.
#[derive(Clone, Debug, Default)]
pub(super) struct Integral {
    table: Vec<u32>,
    width: usize,
    height: usize,
    left: f64,
    top: f64,
    step: f64,
    /// The request.
    region: [f64; 4],
}

impl Integral {
    /// Sums of the [`parts`] of bins over a region of a picture: left, top, right, bottom.
    pub(super) fn fill(&mut self, image: &Image, region: [f64; 4], step: usize, parts: &[u16], bins: &mut Bins) {
        (self.region, self.step) = (region, step as f64);
        let [left, top, right, bottom] = region;
        self.left = (left.max(0.0) / self.step).floor() * self.step;
        self.top = (top.max(0.0) / self.step).floor() * self.step;
        let count = |from: f64, to: f64, side: usize| {
            let to = to.min(side as f64 - 1.0);
            if to >= from { ((to - from) / self.step) as usize + 1 } else { 0 }
        };
        (self.width, self.height) = (count(self.left, right, image.width()), count(self.top, bottom, image.height()));
        if self.width == 0 || self.height == 0 {
            (self.width, self.height) = (0, 0);
        }
        let row = self.width + 1;
        let count = row * (self.height + 1);
        grow(&mut self.table, count);
        self.table[..row].fill(0);
        let (x, y) = (self.left as usize, self.top as usize);
        let columns = x..x + self.width.saturating_sub(1) * step + 1;
        for j in 0..self.height {
            let (above, here) = self.table[j * row..].split_at_mut(row);
            let bins = bins.of(image, y + j * step, columns.clone());
            kernels::integral_row(bins, step, parts, above, &mut here[..row]);
        }
    }

    /// Whether sums over this region are here.
    pub(super) fn covers(&self, region: [f64; 4]) -> bool {
        let [left, top, right, bottom] = self.region;
        left <= region[0] && top <= region[1] && region[2] <= right && region[3] <= bottom
    }

    /// Whether these sums, or nearly these, are here, of the same image.
    pub(super) fn holds(&self, region: [f64; 4], step: usize) -> bool {
        self.covers(region) && self.step <= step as f64 + 1.0
    }

    /// Left column, top row, width and height of the read region, pixels.
    pub(super) fn read(&self) -> (usize, usize, usize, usize) {
        let side = |n: usize| (n.max(1) - 1) * self.step as usize + n.min(1);
        (self.left as usize, self.top as usize, side(self.width), side(self.height))
    }

    /// Whether there is nothing to sum up.
    pub(super) fn is_empty(&self) -> bool {
        self.width == 0
    }

    /// How many samples lie in a box of `width` × `height` pixels.
    pub(super) fn samples(&self, width: f64, height: f64) -> f64 {
        width * height / (self.step * self.step)
    }

    /// The sum over a box, cut to the region, and the number of its samples.
    pub(super) fn over(&self, left: f64, top: f64, right: f64, bottom: f64) -> (f64, f64) {
        let each = 1.0 / self.step;
        let along = |at: f64, from: f64, n: usize| (((at - from) * each).clamp(0.0, n as f64) + 0.5) as u32 as usize;
        let (column, line) = (|x| along(x, self.left, self.width), |y| along(y, self.top, self.height));
        let (a, b, c, d) = (column(left), line(top), column(right), line(bottom));
        let at = |x: usize, y: usize| self.table[y * (self.width + 1) + x];
        let sum = at(c, d).wrapping_sub(at(a, d)).wrapping_sub(at(c, b)).wrapping_add(at(a, b));
        (f64::from(sum) / f64::from(ONE), ((c - a) * (d - b)) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums one by one, at every step, in colour and grey.
    #[test]
    fn sums_are_those_of_loops() {
        let bytes: Vec<u8> = (0..96 * 64 * 3).map(|i| (i * 7 + i * i / 11) as u8).collect();
        let colour = Image::from_rgb8(96, 64, &bytes).expect("enough bytes");
        let (mut it, mut bins) = (Integral::default(), Bins::default());
        for (image, n) in [(colour.to_grey(), GREY), (colour, COLOUR)] {
            let probability: Vec<f32> = (0..n).map(|i| (i * i % 101) as f32 / 100.0).collect();
            let mut whole = vec![];
            parts(&probability, &mut whole);
            for (half, steps) in [(9.0, 1), (30.0, 2), (61.0, 5)] {
                assert_eq!(step(half), steps);
                it.fill(&image, [10.3, -4.0, 80.0, 300.0], steps, &whole, &mut bins);
                let (x0, y0) = (it.left as usize, it.top as usize);
                let (a, b, c, d) = (1, 2, it.width.min(7), it.height.min(9));
                let place = |i: usize, from: usize| (from + i * steps) as f64 - 0.2;
                let (found, count) = it.over(place(a, x0), place(b, y0), place(c, x0), place(d, y0));
                let mut exact = 0.0;
                for (i, j) in (b..d).flat_map(|j| (a..c).map(move |i| (i, j))) {
                    let (x, y) = (x0 + i * steps, y0 + j * steps);
                    exact += f64::from(probability[usize::from(bins.of(&image, y, x..x + 1)[0])]);
                }
                assert!((found - exact).abs() < 0.5 / 4096.0 * count, "{found} is not {exact}");
                assert_eq!(count, ((c - a) * (d - b)) as f64);
            }
        }
        it.fill(&Image::grey(8, 8, 0), [20.0, 0.0, 30.0, 9.0], 1, &[], &mut bins);
        assert!(it.is_empty(), "outside of the picture there is nothing");
    }
}
