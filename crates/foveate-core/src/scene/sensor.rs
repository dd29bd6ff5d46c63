//! A sensor that reads a limited number of values a frame: a coarse overview, windows about the predicted position,
//! and a fovea at the gaze.
//!
//! A *value* is one pixel of one plane, or the mean of a bin of pixels (a camera with binning and region read-out, a
//! tile of a coarser picture, a zoom lens). The sensor paints its values into a picture, smoothly from bin to bin,
//! coarse first and sharp last. The tracker receives only that picture, so unread pixels are invisible.
//!
//! Deviation: the paper's retina reads the whole picture once a particle; here all particles share the values of one
//! sensor.

use serde::{Deserialize, Serialize};

use super::Image;
use crate::geometry::{Extent, Gaze, Size, State};
use foveate_base::Result;
use foveate_base::error::within;
use foveate_base::memory::{self, grow};
use foveate_kernels::blend;

/// What unread places look like: neither bright nor dark.
const UNREAD: u8 = 128;

/// A request to a source: `columns` × `rows` bins of `bin.0` × `bin.1` pixels, with the upper left pixel of the first
/// at (x, y).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// Left column, pixels.
    pub x: usize,
    /// Top row, pixels.
    pub y: usize,
    /// Bins across, 1 or more.
    pub columns: usize,
    /// Bins down, 1 or more.
    pub rows: usize,
    /// Width and height of a bin, pixels.
    pub bin: (usize, usize),
}

impl Window {
    /// Right and bottom, exclusive, of a picture of this size; bins at its border may be cut.
    pub fn end(&self, Size { width, height }: Size) -> (usize, usize) {
        ((self.x + self.columns * self.bin.0).min(width), (self.y + self.rows * self.bin.1).min(height))
    }
}

/// A source of regions of one picture, each at a resolution of its own.
pub trait Regions: Sync {
    /// Width, height and planes (1 or 3) of the whole picture, which no call changes.
    fn shape(&self) -> [usize; 3];
    /// Means of the bins of a window, rounded, plane after plane, row by row: `planes × columns × rows` bytes. A bin
    /// that extends beyond the picture uses its pixels inside, at least one. Returns the number of values read: bins
    /// times planes, or more if the source cannot do better.
    ///
    /// # Errors
    /// Fails if the source cannot be read.
    fn read(&self, window: Window, out: &mut [u8]) -> Result<usize>;
    /// The whole picture, if it is in memory: a configuration without `[sensor]` needs it.
    fn whole(&self) -> Option<&Image> {
        None
    }
}

/// Any picture plays a sensor.
impl Regions for Image {
    fn whole(&self) -> Option<&Image> {
        Some(self)
    }
    fn shape(&self) -> [usize; 3] {
        [self.width(), self.height(), self.planes()]
    }
    fn read(&self, window: Window, out: &mut [u8]) -> Result<usize> {
        let (right, bottom) = window.end(self.size());
        let Window { x, y, columns, rows, bin } = window;
        for (p, out) in out.chunks_exact_mut(columns * rows).enumerate() {
            let plane = self.plane(p);
            for (j, out) in out.chunks_exact_mut(columns).enumerate() {
                let lines = y + j * bin.1..(y + (j + 1) * bin.1).min(bottom);
                for (i, out) in out.iter_mut().enumerate() {
                    let across = x + i * bin.0..(x + (i + 1) * bin.0).min(right);
                    let n = (lines.len() * across.len()) as u64;
                    let rows = lines.clone().map(|y| &plane[y * self.width()..][across.clone()]);
                    let sum: u64 = rows.map(|row| row.iter().map(|b| u64::from(*b)).sum::<u64>()).sum();
                    *out = ((sum + n / 2) / n) as u8;
                }
            }
        }
        Ok(self.planes() * columns * rows)
    }
}

/// A square of the template that is read, whatever the target's size: `[reach, values]`, half its side in template units (1 is
/// half the target's box) and the most values along a side of it, of each plane.
pub type Patch = [f64; 2];

/// The values to read of each frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSettings {
    /// Values along the shorter side of an overview of the picture; 0 reads none, 0 to 4096.
    #[serde(default)]
    pub overview: usize,
    /// Windows about the predicted position, the widest first.
    #[serde(default)]
    pub windows: Vec<Patch>,
    /// Window at the gaze. If a policy scores several gazes, all of their area is read at this resolution.
    #[serde(default = "two_boxes")]
    pub fovea: Patch,
}

fn two_boxes() -> Patch {
    [2.0, 16.0]
}

impl SensorSettings {
    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        within("sensor.overview", self.overview as f64, 0.0, 4096.0)?;
        for [reach, side] in self.patches() {
            within("sensor: how far a window reaches", reach, 0.01, 50.0)?;
            within("sensor: values along the side of a window", side, 1.0, 4096.0)?;
        }
        Ok(())
    }
    fn patches(&self) -> impl Iterator<Item = Patch> + '_ {
        self.windows.iter().chain([&self.fovea]).copied()
    }
}

/// Reads values according to its settings, and holds their picture.
#[derive(Clone, Debug)]
pub struct Sensor {
    settings: SensorSettings,
    /// The farthest gaze that the first look serves, template units.
    far: f64,
    seen: Image,
    /// The areas painted since the last reset.
    painted: Vec<Window>,
    bytes: Vec<u8>,
    /// Two rows of bins, drawn out to pixels.
    lines: [Vec<f32>; 2],
    taps: Vec<(usize, f32)>,
    values: usize,
}

impl Sensor {
    /// With checked settings; it has read nothing.
    pub fn new(settings: SensorSettings) -> Self {
        let seen = Image::grey(1, 1, UNREAD);
        Self {
            settings,
            far: 0.0,
            seen,
            painted: vec![],
            bytes: vec![],
            lines: Default::default(),
            taps: vec![],
            values: 0,
        }
    }
    /// The first look at a target serves these gazes, too.
    pub(crate) fn with_gazes(self, gazes: &[Gaze]) -> Self {
        Self { far: gazes.iter().map(|gaze| gaze.u.abs().max(gaze.v.abs())).fold(0.0, f64::max), ..self }
    }
    /// The values of the frame at their positions in the picture; grey elsewhere.
    pub fn seen(&self) -> &Image {
        &self.seen
    }
    /// Values read of the frame, of all planes.
    pub fn values(&self) -> usize {
        self.values
    }

    /// Begins a frame: clears the last one and reads the overview.
    ///
    /// # Errors
    /// Fails if the source cannot be read.
    pub fn begin(&mut self, source: &dyn Regions) -> Result<()> {
        let [width, height, planes] = source.shape();
        self.values = 0;
        if Regions::shape(&self.seen) != [width, height, planes] {
            let what = format_args!("a picture of {width} x {height} pixels in {planes} planes");
            memory::check(what, (width as u64).saturating_mul(height as u64).saturating_mul(planes as u64))?;
            self.seen = Image::new(width, height, planes, vec![UNREAD; width * height * planes])?;
            self.painted.clear();
        }
        let mut painted = std::mem::take(&mut self.painted);
        painted.drain(..).for_each(|window| self.wipe(window));
        self.painted = painted;
        if self.settings.overview > 0 {
            let bin = width.min(height).div_ceil(self.settings.overview);
            self.read(
                source,
                Window { x: 0, y: 0, columns: width.div_ceil(bin), rows: height.div_ceil(bin), bin: (bin, bin) },
            )?;
        }
        Ok(())
    }

    /// Reads the windows about the predicted position, then the fovea at the gaze. With several gazes it reads all of
    /// their area at that resolution.
    ///
    /// # Errors
    /// Fails if the source cannot be read.
    pub fn look(&mut self, source: &dyn Regions, at: &State, extent: Extent, gazes: &[Gaze]) -> Result<()> {
        for k in 0..self.settings.windows.len() {
            self.patch(source, at, extent, Gaze::CENTRE, self.settings.windows[k])?;
        }
        let [reach, side] = self.settings.fovea;
        let ends = |of: fn(&Gaze) -> f64| {
            let ends = |(low, high): (f64, f64), place: f64| (low.min(place), high.max(place));
            gazes.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), ends)
        };
        let ((left, right), (top, bottom)) = (ends(|gaze| gaze.u), ends(|gaze| gaze.v));
        let (middle, far) = (
            Gaze { u: 0.5 * (left + right), v: 0.5 * (top + bottom), arm: None },
            0.5 * (right - left).max(bottom - top),
        );
        self.patch(source, at, extent, middle, [reach + far, side * (1.0 + far / reach)])
    }

    /// The first look at a target, in the frame it was given in: the widest window, about all gazes, and as sharp as the sharpest.
    ///
    /// # Errors
    /// Fails if the source cannot be read.
    pub fn init_template(&mut self, source: &dyn Regions, at: &State, extent: Extent) -> Result<()> {
        let (reach, finest) = self
            .settings
            .patches()
            .fold((0.0f64, f64::INFINITY), |(reach, finest), [r, side]| (reach.max(r), finest.min(2.0 * r / side)));
        let reach = reach + self.far;
        self.patch(source, at, extent, Gaze::CENTRE, [reach, 2.0 * reach / finest])
    }

    /// Reads a square of the template about a gaze, cut to the picture.
    fn patch(
        &mut self,
        source: &dyn Regions,
        at: &State,
        extent: Extent,
        gaze: Gaze,
        [reach, side]: Patch,
    ) -> Result<()> {
        let [width, height, _] = source.shape();
        let (middle, scale, shape) = (at.fixate(gaze, extent), at.log_scale.exp(), at.shaped(extent));
        let along = |centre: f64, half: f64, length: usize| {
            let bin = (2.0 * half / side).ceil().max(1.0);
            let n = (2.0 * half / bin).ceil().max(1.0);
            let (first, last) = ((centre - 0.5 * n * bin).round(), length as f64 - 1.0);
            // Whole bins outside of the picture are not read.
            let (skipped, first) = if first < 0.0 { ((-first / bin).floor(), first) } else { (0.0, first) };
            let start = (first + skipped * bin).clamp(0.0, last);
            let end = (first + n * bin).clamp(start + 1.0, last + 1.0);
            (start as usize, ((end - start) / bin).ceil() as usize, bin as usize)
        };
        let half = |extent: f64| (reach * scale * extent).clamp(0.5, 1e6);
        let (x, columns, bin_x) = along(middle.x, half(shape.half_w), width);
        let (y, rows, bin_y) = along(middle.y, half(shape.half_h), height);
        self.read(source, Window { x, y, columns, rows, bin: (bin_x, bin_y) })
    }

    /// Reads a window and paints it.
    fn read(&mut self, source: &dyn Regions, window: Window) -> Result<()> {
        let planes = self.seen.planes();
        let n = window.columns * window.rows;
        grow(&mut self.bytes, n * planes);
        self.values += source.read(window, &mut self.bytes[..n * planes])?;
        self.painted.push(window);
        let width = self.seen.width();
        let (right, bottom) = window.end(self.seen.size());
        self.taps.clear();
        self.taps.extend((window.x..right).map(|x| tap(x - window.x, window.bin.0, window.columns)));
        for line in &mut self.lines {
            grow(line, self.taps.len());
        }
        let [above, below] = &mut self.lines;
        for p in 0..planes {
            let bins = &self.bytes[p * n..][..n];
            let draw = |j: usize, line: &mut [f32]| {
                let bins = &bins[j.min(window.rows - 1) * window.columns..][..window.columns];
                for (out, (i, f)) in line.iter_mut().zip(&self.taps) {
                    let (a, b) = (f32::from(bins[*i]), f32::from(bins[(*i + 1).min(window.columns - 1)]));
                    *out = a + f * (b - a);
                }
            };
            let plane = self.seen.plane_mut(p);
            draw(0, above);
            draw(1, below);
            let mut drawn = 0;
            for y in window.y..bottom {
                let (j, f) = tap(y - window.y, window.bin.1, window.rows);
                if j > drawn {
                    std::mem::swap(above, below);
                    draw(j + 1, below);
                    drawn = j;
                }
                blend(above, below, f, &mut plane[y * width..][window.x..right]);
            }
        }
        Ok(())
    }

    fn wipe(&mut self, window: Window) {
        let width = self.seen.width();
        let (right, bottom) = window.end(self.seen.size());
        for p in 0..self.seen.planes() {
            let plane = self.seen.plane_mut(p);
            (window.y..bottom).for_each(|y| plane[y * width..][window.x..right].fill(UNREAD));
        }
    }
}

/// The bin before a pixel's centre, and how far towards the next one it is.
fn tap(pixel: usize, bin: usize, n: usize) -> (usize, f32) {
    let at = ((pixel as f32 + 0.5) / bin as f32 - 0.5).clamp(0.0, (n - 1) as f32);
    (at as usize, at.fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    const EXTENT: Extent = Extent { half_w: 20.0, half_h: 12.0 };
    const AT: State = State { x: 60.0, y: 40.0, vx: 0.0, vy: 0.0, log_scale: 0.0, angle: 0.0, log_aspect: 0.0 };

    fn picture(planes: usize) -> Image {
        let value = |i: usize| (i * 7 + i * i / 911) as u8;
        Image::new(130, 90, planes, (0..130 * 90 * planes).map(value).collect()).expect("a picture")
    }

    fn sensor(overview: usize, windows: Vec<Patch>, fovea: Patch) -> Sensor {
        let settings = SensorSettings { overview, windows, fovea };
        settings.check().expect("in range");
        Sensor::new(settings)
    }

    #[test]
    fn pictures_keep_the_law_of_regions() {
        conformance::regions(&picture(1));
        conformance::regions(&picture(3));
    }

    /// A window that is fine enough equals the picture, and holds nothing of the last frame.
    #[test]
    fn the_picture_has_only_values_that_were_read() {
        let (image, mut sensor) = (picture(3), sensor(0, vec![], [1.0, 64.0]));
        for (x, y) in [(60.0, 40.0), (5.0, 80.0), (129.0, 0.0)] {
            sensor.begin(&image).expect("memory");
            sensor.look(&image, &State { x, y, ..AT }, EXTENT, &[Gaze::CENTRE]).expect("memory");
            let mut read = 0;
            for (px, py) in (0..90).flat_map(|py| (0..130).map(move |px| (px, py))) {
                let off = ((px as f64 - x).abs() / EXTENT.half_w).max((py as f64 - y).abs() / EXTENT.half_h);
                let seen = sensor.seen().at(1, px, py);
                read += usize::from(off < 0.9);
                assert!(off > 0.9 || seen == image.at(1, px, py), "({px}, {py}) was read");
                assert!(off < 1.15 || seen == UNREAD, "({px}, {py}) was not read");
            }
            assert!(sensor.values() >= 3 * read && sensor.values() <= 3 * 64 * 64);
        }
    }

    /// Whatever the size of the target, the sensor reads at most as many values as its settings allow, and for several gazes all that they
    /// cover.
    #[test]
    fn it_reads_no_more_than_it_may() {
        let image = picture(1);
        let mut sensor = sensor(6, vec![[3.0, 8.0]], [0.5, 12.0]);
        let nine: [Gaze; 9] = std::array::from_fn(|k| Gaze { u: 0.25 * ((k / 3) as f64 - 1.0), v: 0.0, arm: None });
        for scale in [-2.0, 0.0, 1.5, 6.0] {
            for (gazes, fovea) in [(&nine[..1], 144), (&nine, 18 * 18)] {
                sensor.begin(&image).expect("memory");
                sensor.look(&image, &State { log_scale: scale, ..AT }, EXTENT, gazes).expect("memory");
                assert!(sensor.values() <= 6 * 9 + 64 + fovea, "{} values at scale {scale}", sensor.values());
            }
        }
    }

    #[test]
    fn settings_are_checked() {
        let wrong = |settings: SensorSettings, word: &str| {
            assert!(settings.check().expect_err(word).to_string().contains(word));
        };
        let usual = || SensorSettings { overview: 8, windows: vec![], fovea: two_boxes() };
        assert!(usual().check().is_ok());
        wrong(SensorSettings { overview: 8000, ..usual() }, "overview");
        wrong(SensorSettings { windows: vec![[0.0, 3.0]], ..usual() }, "reaches");
        wrong(SensorSettings { fovea: [1.0, f64::NAN], ..usual() }, "side");
    }
}
