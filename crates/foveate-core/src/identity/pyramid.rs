//! Box means of a frame at the footprints of a retina's cells, so that a glimpse costs one bilinear tap a cell.
//!
//! Level l holds, at every pixel of the region where particles are, the mean of the image over a box of
//! bw × bh pixels: the footprint of the retina's cell l at the particles' mean scale, rounded to whole pixels.
//! At scale 1 and angle 0, on whole pixels, a tap therefore *is* the mean over its cell.
//!
//! With large cells, single pixels do not matter: levels are then made from a picture of means over 2 × 2 pixels or
//! more, with cells of at least two and a half pixels. Levels of colour, which videos and photographs have at half
//! the resolution anyway, are made from coarser pictures if their cells are larger. Of squares of 4 × 4 pixels and
//! more (16 cells on a target of 160 pixels and more) two or three rows are read.
//!
//! Deviation from a mip pyramid with levels of 1, 2, 4, 8 px: levels follow the target's size, so nothing
//! jumps when it grows past a power of two, and a ring of 3 or 6 px cells is exact as well.

use foveate_kernels as kernels;

use super::footprint::Footprint;
use crate::geometry::{Extent, Fixation, Gaze, Size, State};
use crate::scene::Image;
use foveate_base::memory::grow;

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
    /// Pixels of the image along a pixel of the picture that it is made of.
    step: usize,
}

/// Sides of a box, at most: beyond it a cell is larger than any picture.
const WIDEST_BOX: f64 = 2048.0;

/// The levels of one frame (or of the template).
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
    region: Option<Region>,
    coarse: [[Vec<u8>; 3]; 2],
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
        let size = image.size();
        let window = |state: &State| Self::around(size, state, Self::reach(state, gazes, state.half(extent), reach));
        states.iter().map(window).reduce(|a, b| a.union(&b)).unwrap_or_default()
    }

    /// How far from a state glimpses at these gazes reach, horizontally and vertically, for a box with these half
    /// sides and cells up to `reach` template units from a gaze.
    pub(super) fn reach(s: &State, gazes: &[Gaze], (w, h): (f64, f64), reach: f64) -> (f64, f64) {
        let far = gazes.iter().map(|g| g.u.abs().max(g.v.abs())).fold(0.0, f64::max) + reach;
        let (sin, cos) = s.turn();
        (far * (cos.abs() * w + sin.abs() * h) + 2.0, far * (sin.abs() * w + cos.abs() * h) + 2.0)
    }

    /// The pixels so far from a state, cut to an image of this size.
    pub(super) fn around(size: Size, s: &State, (dx, dy): (f64, f64)) -> Self {
        let cut = |(low, high): (f64, f64), n: usize| {
            let last = (n - 1) as f64;
            // Down to a whole number, and up to one.
            let (low, high) = (low.clamp(0.0, last), high.clamp(0.0, last));
            let (first, end) = (low as usize, high as usize);
            (first, end + usize::from(high > end as f64) - first + 1)
        };
        let ((x, width), (y, height)) = (cut((s.x - dx, s.x + dx), size.width), cut((s.y - dy, s.y + dy), size.height));
        Self { x, y, width, height }
    }

    /// The least rectangle around both.
    pub(super) fn union(&self, other: &Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y }
    }

    pub(super) fn padded(&self, (dx, dy): (usize, usize), size: Size) -> Self {
        let (x, y) = (self.x.saturating_sub(dx), self.y.saturating_sub(dy));
        let (right, bottom) = (
            (self.x + self.width).saturating_add(dx).min(size.width),
            (self.y + self.height).saturating_add(dy).min(size.height),
        );
        Self { x, y, width: right - x, height: bottom - y }
    }

    /// The squares of `step` pixels that it touches, in a picture of this size.
    fn coarse(&self, step: usize, size: Size) -> Self {
        let (x, y) = (self.x / step, self.y / step);
        let end =
            |from: usize, count: usize, side: usize| (from + count).div_ceil(step).max(1).min(side.div_ceil(step));
        Self { x, y, width: end(self.x, self.width, size.width) - x, height: end(self.y, self.height, size.height) - y }
    }

    pub(super) fn contains(&self, other: &Self) -> bool {
        let within = |start, length, from, side| from <= start && start + length <= from + side;
        within(other.x, other.width, self.x, self.width) && within(other.y, other.height, self.y, self.height)
    }
}

/// Tolerance of the side of a box, in pixels, if it was made for other states of the frame.
const NEARLY: f64 = 0.75;

/// Pixels of a picture across a cell, at least: of an image of more, every so many pixels become one.
const FINE: f64 = 2.5;

/// A picture in planes, and the position of its first pixel in the whole picture of its level, in its own pixels.
#[derive(Clone, Copy)]
struct Picture<'a> {
    planes: [&'a [u8]; 3],
    size: Size,
    origin: (usize, usize),
    /// Pixels of the image along one of its own.
    step: usize,
    grey: bool,
}

impl<'a> Picture<'a> {
    fn of(image: &'a Image) -> Self {
        let planes = std::array::from_fn(|p| image.plane(p.min(image.planes() - 1)));
        let size = image.size();
        Self { planes, size, origin: (0, 0), step: 1, grey: image.planes() == 1 }
    }

    /// A part of the picture that is so many times as coarse as this one, made of at most `most` rows for one of it; `part` is in that
    /// one's pixels.
    fn shrunk<'b>(
        &self,
        (times, most): (usize, usize),
        part: Region,
        room: &'b mut [Vec<u8>; 3],
        sums: &mut Vec<u16>,
    ) -> Picture<'b> {
        let (count, wide) = (part.width * part.height, part.width * times);
        let from = (part.x - self.origin.0 / times, part.y - self.origin.1 / times);
        grow(sums, wide);
        for (plane, out) in self.planes.iter().zip(&mut *room).take(if self.grey { 1 } else { 3 }) {
            grow(out, count);
            kernels::shrink(plane, self.size.width, (times, most), from, &mut sums[..wide], &mut out[..count]);
        }
        let planes = std::array::from_fn(|p| &room[if self.grey { 0 } else { p }][..count]);
        Picture {
            planes,
            size: Size::new(part.width, part.height),
            origin: (part.x, part.y),
            step: self.step * times,
            grey: self.grey,
        }
    }

    /// A region of the image in pixels of this picture, with one more on each side if it is coarser, because taps
    /// interpolate.
    fn region(&self, region: Region, image: Size) -> Region {
        if self.step == 1 {
            return region;
        }
        let it = region.padded((self.step, self.step), image).coarse(self.step, image);
        let (x, y) = (it.x.max(self.origin.0) - self.origin.0, it.y.max(self.origin.1) - self.origin.1);
        Region { x, y, width: it.width.min(self.size.width - x), height: it.height.min(self.size.height - y) }
    }
}

impl Pyramid {
    /// Whether the pyramid already equals, or nearly equals, the result of [`Pyramid::build`] with these arguments on
    /// the same image.
    pub fn holds(&self, region: Region, footprints: &[Footprint], unit: (f64, f64)) -> bool {
        let nearly = |(level, footprint): (&Level, &Footprint)| {
            let side = |unit: f64| (footprint.side * unit / level.step as f64).clamp(1.0, WIDEST_BOX);
            let near = |side: usize, wanted: f64| (side as f64 - wanted).abs() <= NEARLY;
            near(level.size.0, side(unit.0)) && near(level.size.1, side(unit.1))
        };
        self.region.is_some_and(|all| all.contains(&region))
            && self.levels.len() == footprints.len()
            && self.levels.iter().zip(footprints).all(nearly)
    }

    /// Fills the levels for one region of an image. `unit` is pixels per template unit along u and v. Levels of large cells are made
    /// of a coarser picture.
    pub fn build(&mut self, image: &Image, region: Region, footprints: &[Footprint], unit: (f64, f64)) {
        self.region = Some(region);
        self.levels.resize_with(footprints.len(), Level::default);
        let pixels = |footprint: &Footprint| footprint.side * unit.0.min(unit.1) / FINE;
        let finest = footprints.iter().map(pixels).fold(16.0, f64::min).max(1.0) as usize;
        let mut coarsest = finest;
        for (level, footprint) in self.levels.iter_mut().zip(footprints) {
            let times = if footprint.channel == 0 { 1.0 } else { pixels(footprint) / finest as f64 };
            level.step = finest << (times.clamp(1.0, 16.0) as usize).ilog2();
            coarsest = coarsest.max(level.step);
        }
        let size = image.size();
        let reached = region.padded(margin(footprints.iter(), unit, coarsest), size);
        self.source = Some(reached);
        let [mut room, mut coarser_room] = std::mem::take(&mut self.coarse);
        let mut picture = Picture::of(image);
        if finest > 1 {
            // Coarser pictures are made of whole squares of this one.
            let (x, y) = (reached.x / coarsest * coarsest, reached.y / coarsest * coarsest);
            let whole = Region { x, y, width: reached.width + reached.x - x, height: reached.height + reached.y - y };
            // Fetching the image's rows is what costs time.
            picture = picture.shrunk((finest, 3), whole.coarse(finest, size), &mut room, &mut self.sums);
        }
        self.fill(picture, picture.region(region, size), footprints, unit);
        let mut step = 2 * finest;
        while step <= coarsest {
            if self.levels.iter().any(|level| level.step == step) {
                let (times, part) = (step / finest, reached.coarse(step, size));
                let coarser = picture.shrunk((times, times), part, &mut coarser_room, &mut self.sums);
                self.fill(coarser, coarser.region(region, size), footprints, unit);
            }
            step *= 2;
        }
        self.coarse = [room, coarser_room];
    }

    /// Frees buffers that only building needs.
    pub(super) fn trim(&mut self) {
        self.coarse = Default::default();
        (self.sums, self.channel, self.scratch) = Default::default();
        for level in &mut self.levels {
            level.data.truncate(level.width * level.height);
            level.data.shrink_to_fit();
        }
    }

    /// Fills the levels that are made of this picture, in a region of it.
    fn fill(&mut self, picture: Picture<'_>, region: Region, footprints: &[Footprint], unit: (f64, f64)) {
        let unit = (unit.0 / picture.step as f64, unit.1 / picture.step as f64);
        for channel in 0..3 {
            let mut of = self
                .levels
                .iter_mut()
                .zip(footprints)
                .filter(|(level, f)| level.step == picture.step && f.channel == channel)
                .peekable();
            if of.peek().is_none() {
                continue;
            }
            let plain = channel == 0 && picture.grey;
            // The channel is made where boxes can reach, not everywhere.
            let margin = margin(footprints.iter().filter(|f| f.channel == channel), unit, 1);
            let Size { width, height } = picture.size;
            let source = if plain { Region { x: 0, y: 0, width, height } } else { region.padded(margin, picture.size) };
            if !plain {
                grow(&mut self.channel, source.width * source.height);
                make_channel(picture, channel, source, &mut self.channel);
            }
            let bytes = if plain { picture.planes[0] } else { &self.channel };
            for (level, footprint) in of {
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
        let Level { data, width, height, x0, y0, step, .. } = level;
        let plane = kernels::Plane { data, width: *width, height: *height, stride: *width, x0: *x0, y0: *y0 };
        let mut maps = [[0.0; 6]; MANY];
        let fine = 1.0 / *step as f64;
        for (i, at) in at.chunks(MANY).enumerate() {
            let maps = &mut maps[..at.len()];
            for (map, at) in maps.iter_mut().zip(at) {
                let [x, y] = [at.x, at.y].map(|x| (x + 0.5) * fine - 0.5);
                let [ux, uy, vx, vy] = [at.ux, at.uy, at.vx, at.vy].map(|u| u * fine);
                *map = if *step == 1 { [at.x, at.y, at.ux, at.uy, at.vx, at.vy] } else { [x, y, ux, uy, vx, vy] }
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
        let count = self.width * self.height;
        grow(&mut self.data, count);
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
    if picture.grey {
        return out[..region.width * region.height].fill(128);
    }
    for (row, out) in out.chunks_exact_mut(region.width).take(region.height).enumerate() {
        let start = (region.y + row) * picture.size.width + region.x;
        let planes = picture.planes.map(|plane| &plane[start..start + region.width]);
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

    /// Levels made of a coarser picture, against means over boxes of the image: where a box is whole coarse pixels, the value
    /// in its middle is its mean, up to the rounding of bytes; wherever the region begins, and past the image's border. Of squares
    /// of 4 × 4 pixels the first and the third row count.
    #[test]
    fn coarse_pictures_have_the_means_of_boxes() {
        let bytes: Vec<u8> = (0..150 * 110 * 3).map(|i: usize| (i * 7 + i * i / 1013) as u8).collect();
        let colour = Image::from_rgb8(150, 110, &bytes).expect("enough bytes");
        let images = [colour.to_grey(), colour];
        let footprints = [(0.5, 0), (1.5, 1)].map(|(side, channel)| Footprint { side, channel, reach: 1.0 });
        for (unit, steps) in [(8.0, [1, 4]), (12.0, [2, 4]), (16.0, [3, 6]), (24.0, [4, 8])] {
            let places = [(0, 0), (33, 20), (101, 62)];
            for (image, (x, y)) in images.iter().flat_map(|image| places.map(|place| (image, place))) {
                let region = Region { x, y, width: 49, height: 48 };
                let mut pyramid = Pyramid::default();
                pyramid.build(image, region, &footprints, (unit, unit));
                assert!(pyramid.holds(region, &footprints, (unit, unit)));
                for (level, step) in steps.into_iter().enumerate() {
                    assert_eq!(pyramid.levels[level].step, step);
                    let side = pyramid.levels[level].size.0 * step;
                    // The middle of a box that begins with a coarse pixel.
                    let first = |from: usize| (from + 20).saturating_sub(side / 2).next_multiple_of(step);
                    let middle = |from: usize| (first(from) as f64) + 0.5 * (side as f64 - 1.0);
                    let at = Fixation { x: middle(x), y: middle(y), ux: 1.0, uy: 0.0, vx: 0.0, vy: 1.0 };
                    let mut out = [f32::NAN];
                    pyramid.read(level, &[at], &[0.0], &[0.0], &mut out, 1);
                    let pixel = |i: usize| {
                        let (x, y) = ((first(x) + i % side).min(149), (first(y) + i / side).min(109));
                        let [r, g, b] = [0, 1, 2].map(|p| f64::from(image.at(p.min(image.planes() - 1), x, y)));
                        if level == 0 { 0.299 * r + 0.587 * g + 0.114 * b } else { 0.5 * (r - g) + 128.0 }
                    };
                    let read = |i: &usize| steps[0] < 4 || (first(y) + i / side).is_multiple_of(2);
                    let count = (0..side * side).filter(read).count() as f64;
                    let exact = (0..side * side).filter(read).map(pixel).sum::<f64>() / count / 255.0;
                    assert!((f64::from(out[0]) - exact).abs() < 0.004, "step {step}: {} is not {exact}", out[0]);
                }
            }
        }
    }
}
