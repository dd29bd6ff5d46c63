//! Box means of a frame at the footprints of a retina's cells, so that a glimpse costs one bilinear tap a cell.
//!
//! Level l holds, at every pixel of the region where particles are, the mean of the image over a box of
//! bw × bh pixels: the footprint of the retina's cell l at the particles' mean scale, rounded to whole pixels.
//! At scale 1 and angle 0, on whole pixels, a tap therefore *is* the mean over its cell.
//!
//! Where cells are large, what every pixel has is more than looks can tell: then levels are made of a picture of which a pixel
//! is the mean of 2 × 2 of the image's, or more, and cells still have two pixels and a half at least.
//!
//! Deviation from a mip pyramid with levels of 1, 2, 4, 8 px: levels follow the target's size, so nothing
//! jumps when it grows past a power of two, and a ring of 3 or 6 px cells is exact as well.

use foveate_kernels as kernels;

use super::footprint::Footprint;
use crate::geometry::{Extent, Fixation, Gaze, State};
use crate::scene::Image;

/// One plane of box means, in pixels of the picture that it is made of. Sample `(i, j)` is centred at `(x0 + i, y0 + j)`.
#[derive(Clone, Debug, Default)]
struct Level {
    data: Vec<f32>,
    width: usize,
    height: usize,
    x0: f32,
    y0: f32,
    /// Of its boxes, across and down.
    size: (usize, usize),
}

/// Sides of a box, at most: beyond it a cell is larger than any picture.
const WIDEST_BOX: f64 = 2048.0;

/// The levels of one frame (or of the template).
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
    region: Option<Region>,
    /// Pixels of the image along a pixel of the picture that levels are made of.
    step: usize,
    coarse: [Vec<u8>; 3],
    sums: Vec<u16>,
    /// The pixels that the boxes of that region can reach.
    source: Option<Region>,
    channel: Vec<u8>,
    scratch: kernels::BoxScratch,
}

/// A rectangle of pixels: left, top, width, height; never empty, always inside the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Region {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// The pixels that glimpses at these states and gazes can touch, cut to the image.
    pub fn covering(image: &Image, states: &[State], gazes: &[Gaze], extent: Extent, reach: f64) -> Self {
        let size = (image.width(), image.height());
        let window = |state: &State| Self::around(size, state, Self::reach(state, gazes, state.half(extent), reach));
        states.iter().map(window).reduce(|a, b| a.union(&b)).unwrap_or_default()
    }

    /// How far from a state glimpses at these gazes can touch pixels, across and down, where its box has these halves and cells
    /// lie up to `reach` template units from a gaze.
    pub(super) fn reach(s: &State, gazes: &[Gaze], (w, h): (f64, f64), reach: f64) -> (f64, f64) {
        let far = gazes.iter().map(|g| g.u.abs().max(g.v.abs())).fold(0.0, f64::max) + reach;
        let (sin, cos) = s.turn();
        (far * (cos.abs() * w + sin.abs() * h) + 2.0, far * (sin.abs() * w + cos.abs() * h) + 2.0)
    }

    /// The pixels so far from a state, cut to an image of this size.
    pub(super) fn around(size: (usize, usize), s: &State, (dx, dy): (f64, f64)) -> Self {
        let cut = |(low, high): (f64, f64), n: usize| {
            let last = (n - 1) as f64;
            // Down to a whole number, and up to one.
            let (low, high) = (low.clamp(0.0, last), high.clamp(0.0, last));
            let (first, end) = (low as usize, high as usize);
            (first, end + usize::from(high > end as f64) - first + 1)
        };
        let ((x, width), (y, height)) = (cut((s.x - dx, s.x + dx), size.0), cut((s.y - dy, s.y + dy), size.1));
        Self { x, y, width, height }
    }

    /// The least rectangle around both.
    pub(super) fn union(&self, other: &Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y }
    }

    pub(super) fn padded(&self, (dx, dy): (usize, usize), size: (usize, usize)) -> Self {
        let (x, y) = (self.x.saturating_sub(dx), self.y.saturating_sub(dy));
        let (right, bottom) = (
            (self.x + self.width).saturating_add(dx).min(size.0),
            (self.y + self.height).saturating_add(dy).min(size.1),
        );
        Self { x, y, width: right - x, height: bottom - y }
    }

    pub(super) fn contains(&self, other: &Self) -> bool {
        let within = |start, length, from, side| from <= start && start + length <= from + side;
        within(other.x, other.width, self.x, self.width) && within(other.y, other.height, self.y, self.height)
    }
}

/// How far a box may be from the side it is to have, in pixels, where it was made for other states of the frame.
const NEARLY: f64 = 0.75;

/// Pixels of a picture across a cell, at least: of an image of more, every so many pixels become one.
const FINE: f64 = 2.5;

/// A picture in planes, and where its first pixel lies in the image that was cut and made coarser, in its own pixels.
#[derive(Clone, Copy)]
struct Picture<'a> {
    planes: &'a [&'a [u8]],
    size: (usize, usize),
    origin: (usize, usize),
}

impl Pyramid {
    /// Whether what [`Pyramid::build`] with these arguments would make is here already, of the same image, or nearly so.
    pub fn holds(&self, region: Region, footprints: &[Footprint], unit: (f64, f64)) -> bool {
        let step = self.step as f64;
        let near = |side: usize, wanted: f64| (side as f64 - (wanted / step).clamp(1.0, WIDEST_BOX)).abs() <= NEARLY;
        let nearly = |(level, footprint): (&Level, &Footprint)| {
            near(level.size.0, footprint.side * unit.0) && near(level.size.1, footprint.side * unit.1)
        };
        self.region.is_some_and(|all| all.contains(&region))
            && self.levels.len() == footprints.len()
            && self.levels.iter().zip(footprints).all(nearly)
    }

    /// Fills the levels for one region of an image. `unit` is pixels per template unit along u and v. Where cells are large, levels
    /// are made of a coarser picture.
    pub fn build(&mut self, image: &Image, region: Region, footprints: &[Footprint], unit: (f64, f64)) {
        self.region = Some(region);
        let size = (image.width(), image.height());
        let planes: [&[u8]; 3] = std::array::from_fn(|p| image.plane(p.min(image.planes() - 1)));
        let least = footprints.iter().map(|f| f.side * unit.0.min(unit.1)).fold(f64::MAX, f64::min);
        self.step = (least / FINE).clamp(1.0, 16.0) as usize;
        let reached = region.padded(margin(footprints.iter(), unit, self.step), size);
        self.source = Some(reached);
        if self.step == 1 {
            return self.fill(
                Picture { planes: &planes[..image.planes()], size, origin: (0, 0) },
                region,
                footprints,
                unit,
            );
        }
        let step = self.step;
        let coarse = |r: Region| {
            let (x, y) = (r.x / step, r.y / step);
            let end =
                |from: usize, count: usize, side: usize| (from + count).div_ceil(step).max(1).min(side.div_ceil(step));
            Region { x, y, width: end(r.x, r.width, size.0) - x, height: end(r.y, r.height, size.1) - y }
        };
        // Taps lie between two pixels.
        let region = coarse(region.padded((step, step), size));
        let source = coarse(reached);
        let mut made = std::mem::take(&mut self.coarse);
        let count = source.width * source.height;
        let sums = &mut self.sums;
        sums.resize(sums.len().max(source.width * step), 0);
        for (plane, out) in planes[..image.planes()].iter().zip(&mut made) {
            out.resize(out.len().max(count), 0);
            let (from, sums) = ((source.x, source.y), &mut sums[..source.width * step]);
            kernels::shrink(plane, size.0, step, from, sums, &mut out[..count]);
        }
        let planes = made.each_ref().map(|plane| &plane[..count.min(plane.len())]);
        let (origin, size) = ((source.x, source.y), (source.width, source.height));
        let picture = Picture { planes: &planes[..image.planes()], size, origin };
        let region = Region { x: region.x.max(source.x) - source.x, y: region.y.max(source.y) - source.y, ..region };
        let region = Region {
            width: region.width.min(size.0 - region.x),
            height: region.height.min(size.1 - region.y),
            ..region
        };
        self.fill(picture, region, footprints, (unit.0 / step as f64, unit.1 / step as f64));
        self.coarse = made;
    }

    /// Frees what only building needs.
    pub(super) fn trim(&mut self) {
        self.coarse = Default::default();
        (self.sums, self.channel, self.scratch) = Default::default();
        self.levels.iter_mut().for_each(|level| level.data.shrink_to_fit());
    }

    fn fill(&mut self, picture: Picture<'_>, region: Region, footprints: &[Footprint], unit: (f64, f64)) {
        self.levels.resize_with(footprints.len(), Level::default);
        for channel in 0..3 {
            if footprints.iter().all(|f| f.channel != channel) {
                continue;
            }
            let plain = channel == 0 && picture.planes.len() == 1;
            // The channel is made where boxes can reach, not everywhere.
            let margin = margin(footprints.iter().filter(|f| f.channel == channel), unit, 1);
            let (width, height) = picture.size;
            let source = if plain { Region { x: 0, y: 0, width, height } } else { region.padded(margin, picture.size) };
            if !plain {
                self.channel.resize(self.channel.len().max(source.width * source.height), 0);
                make_channel(picture, channel, source, &mut self.channel);
            }
            let bytes = if plain { picture.planes[0] } else { &self.channel };
            for (level, footprint) in self.levels.iter_mut().zip(footprints).filter(|(_, f)| f.channel == channel) {
                let side = |unit: f64| (footprint.side * unit).round().clamp(1.0, WIDEST_BOX) as usize;
                level.size = (side(unit.0), side(unit.1));
                level.fill(bytes, source, region, &mut self.scratch);
                level.x0 += picture.origin.0 as f32;
                level.y0 += picture.origin.1 as f32;
            }
        }
    }

    /// Left column, top row, width and height of the pixels that [`Pyramid::build`] used; nothing before it.
    pub fn used(&self) -> (usize, usize, usize, usize) {
        self.source.map_or((0, 0, 0, 0), |s| (s.x, s.y, s.width, s.height))
    }

    /// Reads one bilinear tap of `level` for each cell offset (`du`, `dv`, template units) around each fixation; those of
    /// fixation i are written from `out[i × stride]` on. Outside the level the nearest sample counts.
    pub fn read(&self, level: usize, at: &[Fixation], du: &[f32], dv: &[f32], out: &mut [f32], stride: usize) {
        const MANY: usize = 64;
        let level = &self.levels[level];
        let Level { data, width, height, x0, y0, .. } = level;
        let plane = kernels::Plane { data, width: *width, height: *height, stride: *width, x0: *x0, y0: *y0 };
        let mut maps = [[0.0; 6]; MANY];
        let fine = 1.0 / self.step as f64;
        for (i, at) in at.chunks(MANY).enumerate() {
            let maps = &mut maps[..at.len()];
            for (map, at) in maps.iter_mut().zip(at) {
                let [x, y] = [at.x, at.y].map(|x| (x + 0.5) * fine - 0.5);
                let [ux, uy, vx, vy] = [at.ux, at.uy, at.vx, at.vy].map(|u| u * fine);
                *map = if self.step == 1 { [at.x, at.y, at.ux, at.uy, at.vx, at.vy] } else { [x, y, ux, uy, vx, vy] }
                    .map(|x| x as f32);
            }
            kernels::taps_rows(plane, maps, du, dv, &mut out[i * MANY * stride..], stride);
        }
    }
}

impl Level {
    fn fill(&mut self, bytes: &[u8], source: Region, region: Region, scratch: &mut kernels::BoxScratch) {
        let size = self.size;
        // The middle of an even box lies half a pixel on: one more sample on the left covers the region.
        let early = |side: usize| usize::from(side.is_multiple_of(2));
        self.width = region.width + early(size.0);
        self.height = region.height + early(size.1);
        // Room only grows: what is cut off and added again would be filled with zeros first.
        let count = self.width * self.height;
        self.data.resize(self.data.len().max(count), 0.0);
        let wanted = kernels::Region {
            x: (region.x - source.x) as i32 - early(size.0) as i32,
            y: (region.y - source.y) as i32 - early(size.1) as i32,
            width: self.width,
            height: self.height,
        };
        let pixels = kernels::Pixels {
            data: &bytes[..source.width * source.height],
            width: source.width,
            height: source.height,
        };
        let plane = kernels::box_means(pixels, size, wanted, scratch, &mut self.data[..count]);
        (self.x0, self.y0) = (plane.x0 + source.x as f32, plane.y0 + source.y as f32);
    }
}

/// How far boxes of these footprints reach, and `more`, across and down.
fn margin<'a>(footprints: impl Iterator<Item = &'a Footprint>, unit: (f64, f64), more: usize) -> (usize, usize) {
    let widest = footprints.map(|f| f.side).fold(0.0, f64::max);
    let side = |u: f64| (widest * u).ceil().min(WIDEST_BOX) as usize + more;
    (side(unit.0), side(unit.1))
}

/// Grey (BT.601 luma), red − green, or blue − yellow, with 128 for "neither".
fn make_channel(picture: Picture<'_>, channel: usize, region: Region, out: &mut [u8]) {
    let &[r, g, b] = picture.planes else {
        return out[..region.width * region.height].fill(128);
    };
    for (row, out) in out.chunks_exact_mut(region.width).take(region.height).enumerate() {
        let start = (region.y + row) * picture.size.0 + region.x;
        let planes = [r, g, b].map(|plane| &plane[start..start + region.width]);
        match channel {
            0 => kernels::luma(planes, out),
            1 => kernels::red_green(planes, out),
            _ => kernels::blue_yellow(planes, out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels made of a coarser picture, against means over boxes of the image: where a box is whole coarse pixels, what is read
    /// in its middle is its mean, up to the rounding of bytes; wherever the region begins, and past the image's border.
    #[test]
    fn coarse_pictures_have_the_means_of_boxes() {
        let bytes: Vec<u8> = (0..150 * 110 * 3).map(|i: usize| (i * 7 + i * i / 1013) as u8).collect();
        let colour = Image::from_rgb8(150, 110, &bytes).expect("enough bytes");
        for image in [colour.to_grey(), colour] {
            let footprints = [Footprint { side: 0.5, channel: 0, reach: 1.0 }];
            for (unit, step) in [(8.0, 1), (12.0, 2), (16.0, 3), (24.0, 4)] {
                for (x, y) in [(0, 0), (33, 20), (101, 62)] {
                    let mut pyramid = Pyramid::default();
                    let region = Region { x, y, width: 49, height: 48 };
                    pyramid.build(&image, region, &footprints, (unit, unit));
                    assert_eq!(pyramid.step, step);
                    assert!(pyramid.holds(region, &footprints, (unit, unit)));
                    let side = pyramid.levels[0].size.0 * step;
                    // The middle of a box that begins with a coarse pixel.
                    let first = |from: usize| (from + 20).next_multiple_of(step);
                    let middle = |from: usize| (first(from) as f64) + 0.5 * (side as f64 - 1.0);
                    let at = Fixation { x: middle(x), y: middle(y), ux: 1.0, uy: 0.0, vx: 0.0, vy: 1.0 };
                    let mut out = [f32::NAN];
                    pyramid.read(0, &[at], &[0.0], &[0.0], &mut out, 1);
                    let grey = image.to_grey();
                    let pixel = |i: usize| {
                        f64::from(grey.at(0, (first(x) + i % side).min(149), (first(y) + i / side).min(109)))
                    };
                    let exact = (0..side * side).map(pixel).sum::<f64>() / (side * side) as f64 / 255.0;
                    assert!((f64::from(out[0]) - exact).abs() < 0.004, "step {step}: {} is not {exact}", out[0]);
                }
            }
        }
    }
}
