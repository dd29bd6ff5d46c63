//! Box means of a frame at the footprints of a retina's cells, so that a glimpse costs one bilinear tap a cell.
//!
//! Level l holds, at every pixel of the region where particles are, the mean of the image over a box of
//! bw × bh pixels: the footprint of the retina's cell l at the particles' mean scale, rounded to whole pixels.
//! At scale 1 and angle 0, on whole pixels, a tap therefore *is* the mean over its cell.
//!
//! Deviation from a mip pyramid with levels of 1, 2, 4, 8 px: levels follow the target's size, so nothing
//! jumps when it grows past a power of two, and a ring of 3 or 6 px cells is exact as well.

use foveate_kernels as kernels;

use super::footprint::Footprint;
use crate::geometry::{Extent, Fixation, Gaze, State};
use crate::scene::Image;

/// One plane of box means. Sample `(i, j)` is centred at image coordinates `(x0 + i, y0 + j)`.
#[derive(Clone, Debug, Default)]
struct Level {
    data: Vec<f32>,
    width: usize,
    height: usize,
    x0: f32,
    y0: f32,
    /// Pixels of its boxes, across and down.
    size: (usize, usize),
}

/// Sides of a box, at most: beyond it a cell is larger than any picture.
const WIDEST_BOX: f64 = 2048.0;

/// The levels of one frame (or of the template).
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
    region: Option<Region>,
    /// The pixels that the boxes of that region can reach.
    source: Option<Region>,
    channel: Vec<u8>,
    scratch: kernels::BoxScratch,
}

/// A rectangle of pixels: left, top, width, height; never empty, always inside the image.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        let far = gazes.iter().map(|g| g.u.abs().max(g.v.abs())).fold(0.0, f64::max) + reach;
        let (mut x, mut y) = ((f64::INFINITY, f64::NEG_INFINITY), (f64::INFINITY, f64::NEG_INFINITY));
        for s in states {
            let ((sin, cos), scale) = (s.turn(), s.log_scale.exp());
            let (w, h) = (scale * extent.half_w, scale * extent.half_h);
            let (dx, dy) = (far * (cos.abs() * w + sin.abs() * h) + 2.0, far * (sin.abs() * w + cos.abs() * h) + 2.0);
            x = (x.0.min(s.x - dx), x.1.max(s.x + dx));
            y = (y.0.min(s.y - dy), y.1.max(s.y + dy));
        }
        let cut = |(low, high): (f64, f64), n: usize| {
            let last = (n - 1) as f64;
            let (low, high) = (low.floor().clamp(0.0, last), high.ceil().clamp(0.0, last));
            (low as usize, (high - low) as usize + 1)
        };
        let ((x, width), (y, height)) = (cut(x, image.width()), cut(y, image.height()));
        Self { x, y, width, height }
    }

    fn contains(&self, other: &Self) -> bool {
        let within = |start, length, from, side| from <= start && start + length <= from + side;
        within(other.x, other.width, self.x, self.width) && within(other.y, other.height, self.y, self.height)
    }
}

/// Pixels per template unit at the states' mean size.
pub(super) fn units(states: &[State], extent: Extent) -> (f64, f64) {
    let mean = states.iter().map(|s| s.log_scale).sum::<f64>() / states.len() as f64;
    (mean.exp() * extent.half_w, mean.exp() * extent.half_h)
}

/// How far a box may be from the side it is to have, in pixels, where it was made for other states of the frame.
const NEARLY: f64 = 0.75;

/// The box of a footprint, in whole pixels.
fn size(footprint: &Footprint, unit: (f64, f64)) -> (usize, usize) {
    let side = |unit: f64| (footprint.side * unit).round().clamp(1.0, WIDEST_BOX) as usize;
    (side(unit.0), side(unit.1))
}

impl Pyramid {
    /// Whether what [`Pyramid::build`] with these arguments would make is here already, of the same image, or nearly so.
    pub fn holds(&self, region: Region, footprints: &[Footprint], unit: (f64, f64)) -> bool {
        let near = |side: usize, wanted: f64| (side as f64 - wanted.clamp(1.0, WIDEST_BOX)).abs() <= NEARLY;
        let nearly = |(level, footprint): (&Level, &Footprint)| {
            near(level.size.0, footprint.side * unit.0) && near(level.size.1, footprint.side * unit.1)
        };
        self.region.is_some_and(|all| all.contains(&region))
            && self.levels.len() == footprints.len()
            && self.levels.iter().zip(footprints).all(nearly)
    }

    /// Fills the levels for one region of an image. `unit` is pixels per template unit along u and v.
    pub fn build(&mut self, image: &Image, region: Region, footprints: &[Footprint], unit: (f64, f64)) {
        (self.region, self.source) = (Some(region), None);
        self.levels.resize_with(footprints.len(), Level::default);
        for channel in 0..3 {
            if footprints.iter().all(|f| f.channel != channel) {
                continue;
            }
            let plain = channel == 0 && image.planes() == 1;
            let widest = footprints.iter().filter(|f| f.channel == channel).map(|f| f.side).fold(0.0, f64::max);
            // The channel is made where boxes can reach, not everywhere.
            let margin = |u: f64| (widest * u).ceil().min(WIDEST_BOX) as usize + 1;
            let reached = grow(region, image, margin(unit.0), margin(unit.1));
            self.source = Some(self.source.filter(|s| s.contains(&reached)).unwrap_or(reached));
            let source = if plain { whole(image) } else { reached };
            if !plain {
                self.channel.resize(self.channel.len().max(source.width * source.height), 0);
                make_channel(image, channel, source, &mut self.channel);
            }
            let bytes = if plain { image.plane(0) } else { &self.channel };
            for (level, footprint) in self.levels.iter_mut().zip(footprints).filter(|(_, f)| f.channel == channel) {
                level.size = size(footprint, unit);
                level.fill(bytes, source, region, &mut self.scratch);
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
        for (i, at) in at.chunks(MANY).enumerate() {
            let maps = &mut maps[..at.len()];
            for (map, at) in maps.iter_mut().zip(at) {
                *map = [at.x, at.y, at.ux, at.uy, at.vx, at.vy].map(|x| x as f32);
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

fn whole(image: &Image) -> Region {
    Region { x: 0, y: 0, width: image.width(), height: image.height() }
}

fn grow(r: Region, image: &Image, dx: usize, dy: usize) -> Region {
    let (x, y) = (r.x.saturating_sub(dx), r.y.saturating_sub(dy));
    let (right, bottom) = ((r.x + r.width + dx).min(image.width()), (r.y + r.height + dy).min(image.height()));
    Region { x, y, width: right - x, height: bottom - y }
}

/// Grey (BT.601 luma), red − green, or blue − yellow, with 128 for "neither".
fn make_channel(image: &Image, channel: usize, region: Region, out: &mut [u8]) {
    if image.planes() == 1 {
        out[..region.width * region.height].fill(128);
        return;
    }
    for (row, out) in out.chunks_exact_mut(region.width).take(region.height).enumerate() {
        let start = (region.y + row) * image.width() + region.x;
        let planes = [0, 1, 2].map(|p| &image.plane(p)[start..start + region.width]);
        match channel {
            0 => kernels::luma(planes, out),
            1 => kernels::red_green(planes, out),
            _ => kernels::blue_yellow(planes, out),
        }
    }
}
