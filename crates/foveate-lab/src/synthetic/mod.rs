//! Synthetic digit videos with known truth: [`Clutter`] and [`Multi`] (section 6.1), [`Occlusion`] (section 6.2).
//!
//! A video is settings and a few small pictures. Frame `t` depends on the settings and `t` alone, so any frame can be
//! drawn without the others.

mod clutter;
mod multi;
mod occlusion;
mod path;

use rand::RngExt;
use serde::{Deserialize, Serialize};

pub use self::clutter::{Clutter, ClutterVideo, NOISE};
pub use self::multi::{Mover, Multi, MultiVideo};
pub use self::occlusion::{Corruption, GLIMPSE, Occlusion, OcclusionVideo};
use crate::idx::Digits;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;
use foveate_video::{Frame, FrameSource, SourceInfo};

/// A video whose frames can be drawn in any order.
pub trait Drawn: Send {
    /// Width and height in pixels.
    fn size(&self) -> Size;
    /// The target's box in each frame, 0-based; as many as there are frames, one at least.
    fn truth(&self) -> &[BBox];
    /// The target's class.
    fn label(&self) -> u8;
    /// Draws frame `t`. Panics if the video is shorter.
    fn render(&self, t: usize) -> Image;
    /// The frames in order, at 30 a second.
    fn source(self) -> DrawnFrames<Self>
    where
        Self: Sized,
    {
        let (size, frames) = (self.size(), self.truth().len());
        DrawnFrames::new(self, size, frames, Self::render)
    }
}

impl Drawn for Box<dyn Drawn> {
    fn size(&self) -> Size {
        (**self).size()
    }
    fn truth(&self) -> &[BBox] {
        (**self).truth()
    }
    fn label(&self) -> u8 {
        (**self).label()
    }
    fn render(&self, t: usize) -> Image {
        (**self).render(t)
    }
}

/// Settings of any synthetic video.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "scene", rename_all = "kebab-case")]
pub enum Synthetic {
    /// A digit among static ones.
    Clutter(Clutter),
    /// A digit that passes behind bars.
    Occlusion(Occlusion),
}

impl Synthetic {
    /// Draws the random parts of the frames. Fails as [`Clutter::video`] and [`Occlusion::video`] do.
    pub fn video(&self, digits: &Digits) -> Result<Box<dyn Drawn>> {
        Ok(match self {
            Self::Clutter(settings) => Box::new(settings.video(digits)?),
            Self::Occlusion(settings) => Box::new(settings.video(digits)?),
        })
    }
    /// The same kind of video with another target, seed and length.
    pub fn with(&self, digit: u8, seed: u64, frames: usize) -> Self {
        match self.clone() {
            Self::Clutter(settings) => Self::Clutter(Clutter { digit, seed, frames, ..settings }),
            Self::Occlusion(settings) => Self::Occlusion(Occlusion { digit, seed, frames, ..settings }),
        }
    }
    /// Class of the target, 0 to 9.
    pub fn digit(&self) -> u8 {
        match self {
            Self::Clutter(settings) => settings.digit,
            Self::Occlusion(settings) => settings.digit,
        }
    }
    /// The seed.
    pub fn seed(&self) -> u64 {
        match self {
            Self::Clutter(settings) => settings.seed,
            Self::Occlusion(settings) => settings.seed,
        }
    }
    /// Length of the video.
    pub fn frames(&self) -> usize {
        match self {
            Self::Clutter(settings) => settings.frames,
            Self::Occlusion(settings) => settings.frames,
        }
    }
}

/// The frames of a synthetic video, at 30 a second.
#[derive(Clone, Debug)]
pub struct DrawnFrames<V> {
    video: V,
    render: fn(&V, usize) -> Image,
    left: std::ops::Range<usize>,
    info: SourceInfo,
}

impl<V> DrawnFrames<V> {
    fn new(video: V, Size { width, height }: Size, frames: usize, render: fn(&V, usize) -> Image) -> Self {
        let reader = "synthetic digits".into();
        let info = SourceInfo { width, height, frames: Some(frames), rate: 30.0, reader };
        Self { video, render, left: 0..frames, info }
    }
}

impl<V> Iterator for DrawnFrames<V> {
    type Item = Result<Frame>;
    fn next(&mut self) -> Option<Self::Item> {
        let index = self.left.next()?;
        Some(Ok(Frame { index, time: index as f64 / self.info.rate, image: (self.render)(&self.video, index) }))
    }
    fn size_hint(&self) -> (usize, Option<usize>) {
        self.left.size_hint()
    }
}

impl<V: Send> FrameSource for DrawnFrames<V> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
}

/// How a digit covers the pixels below it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ink {
    /// Pixels with ink replace those below, black ones are transparent, as in the authors' code.
    #[default]
    Replace,
    /// The brighter of the two stays: strokes melt into each other.
    Brighter,
    /// The whole 28 × 28 square replaces the pixels below.
    Opaque,
}

impl Ink {
    /// Draws a square digit with its top-left pixel at (x, y) of a canvas, clipped to it.
    fn draw(self, canvas: &mut [u8], width: usize, digit: &[u8], x: usize, y: usize) {
        let side = digit.len().isqrt();
        for (below, ink) in canvas.chunks_exact_mut(width).skip(y).zip(digit.chunks_exact(side)) {
            for (below, &ink) in below[x..].iter_mut().zip(ink) {
                *below = self.over(*below, ink);
            }
        }
    }
    /// One pixel with ink over the pixel below.
    fn over(self, below: u8, ink: u8) -> u8 {
        match self {
            Self::Replace if ink == 0 => below,
            Self::Replace | Self::Opaque => ink,
            Self::Brighter => ink.max(below),
        }
    }
}

/// One digit of a class.
fn pick<'a>(digits: &'a Digits, class: u8, rng: &mut Rng) -> Result<&'a [u8]> {
    let all = digits.of_class(class);
    if all.is_empty() {
        return Err(Error::Invalid(format!("no digit of class {class} among the {} given", digits.len())));
    }
    Ok(digits.digit(all[rng.random_range(0..all.len())]))
}

/// A square digit moved right and down by less than a pixel, bilinear, a pixel wider.
fn shifted(digit: &[u8], dx: f64, dy: f64) -> Vec<u8> {
    let side = digit.len().isqrt();
    let at = |x: usize, y: usize| if x < side && y < side { f64::from(digit[y * side + x]) } else { 0.0 };
    let row = |x: usize, y: usize| (1.0 - dx) * at(x, y) + dx * at(x.wrapping_sub(1), y);
    let cells = (0..=side).flat_map(|y| (0..=side).map(move |x| (x, y)));
    cells.map(|(x, y)| ((1.0 - dy) * row(x, y) + dy * row(x, y.wrapping_sub(1))).round() as u8).collect()
}

/// A setting of a synthetic video that cannot be.
fn wrong<T>(what: String) -> Result<T> {
    Err(Error::Config(format!("synthetic video: {what}")))
}

/// Checks length, canvas and speed of a scene; `least` is the shortest side of the canvas.
fn check_scene(frames: usize, size: Size, least: f64, [slow, fast]: [f64; 2]) -> Result<()> {
    match () {
        () if frames == 0 => wrong("frames is 0, expected at least 1".into()),
        () if (size.width.min(size.height) as f64) < least || size.width.max(size.height) > 10_000 => {
            wrong(format!("a canvas of {size}, expected sides from the target's {least} to 10000"))
        }
        () if !(0.0 <= slow && slow <= fast && fast.is_finite()) => {
            wrong(format!("speed is from {slow} to {fast}, expected 0 or more, the slower first"))
        }
        () => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::idx::SIDE;

    /// One digit of each class: a filled square with a transparent rim, of grey 100 + class.
    pub(super) fn squares() -> Digits {
        let pixel = |i: usize, c: u8| {
            let inside = |k: usize| (4..24).contains(&k);
            if inside(i / SIDE) && inside(i % SIDE) { 100 + c } else { 0 }
        };
        let images = (0..10).flat_map(|c| (0..SIDE * SIDE).map(move |i| pixel(i, c))).collect();
        Digits { images, labels: (0..10).collect() }
    }
}
