//! The paper's second experiment: several digits move, grow, turn and pass over each other (section 6.1).
//!
//! "A similar video sequence, but tracking multiple targets. The image scale of each target changes significantly over
//! time": no more is printed; the authors' figure shows five digits. Ours: each target has a class of its own and a path
//! as in [`super::Clutter`]; its size swings between 28 and 84 px, its angle about upright, both as cosines of time.
//! Boxes do not meet in frame 1; later targets are drawn over earlier ones. A frame depends on the settings and `t` alone.

use std::fmt::Write as _;

use rand::RngExt;
use rand::seq::SliceRandom;

use crate::crossings::crossings;
use crate::idx::{Digits, SIDE};
use crate::synthetic::path::Path;
use crate::synthetic::{DrawnFrames, Ink, check_scene, pick, wrong};
use foveate_base::Result;
use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::text::counted;
use foveate_core::geometry::{BBox, Extent, Size, State};
use foveate_core::scene::Image;
use foveate_video::mot::{TrackBox, Tracks};

/// Half a digit of 28 px: one template unit at size 1.
const HALF: f64 = SIDE as f64 / 2.0;
/// Ink from this on hides and counts as hidden; below are the soft edges of strokes.
const SOLID: u8 = 64;

foveate_base::settings! {
    /// Settings of a video; [`Default`] is the experiment.
    pub struct Multi in "multi" and rules {
        /// Everything random follows from this.
        pub seed: u64 = 7,
        /// Number of moving digits, 1 to 10,000: up to ten their classes differ.
        pub targets: usize = 5; 1.0 to 10_000.0,
        /// Length of the video.
        pub frames: usize = 300,
        /// Width of the canvas in pixels.
        pub width: usize = 400,
        /// Height of the canvas in pixels.
        pub height: usize = 300,
        /// Least and largest size, in units of 28 px, from 1 to 10; a target starts at one of them, by a coin.
        pub scale: [f64; 2] = [1.0, 3.0],
        /// Largest angle away from upright, degrees; each target has half of it at least.
        pub turn: f64 = 90.0; 0.0 to 3600.0,
        /// Slowest and fastest mean speed, pixels a frame.
        pub speed: [f64; 2] = [1.35, 2.15],
        /// At least so many times one target passes over another: half of the smaller box is covered.
        pub crossings: usize = 4,
        /// Number of static digits behind, of 28 px.
        pub clutter: usize = 0,
        /// Share of the pixels replaced by black or white, anew in each frame, 0 to 1.
        pub noise: f64 = 0.0; 0.0 to 1.0,
        /// How digits cover each other.
        pub ink: Ink = Ink::Replace,
    }
}

/// One moving digit: its picture and true states.
#[derive(Clone, Debug)]
pub struct Mover {
    /// Its class.
    pub class: u8,
    /// Its size in frame 1: states are relative to it.
    pub extent: Extent,
    /// Its state in each frame.
    pub states: Vec<State>,
    ink: Vec<u8>,
}

impl Mover {
    /// Its upright box in frame `t`: its size, not the bounding box of the turned one.
    pub fn bbox(&self, t: usize) -> BBox {
        self.states[t].bbox(self.extent)
    }

    /// Calls `each` with the pixels (column, row) of a canvas that its square covers in frame `t`, and the ink there.
    fn pixels(&self, t: usize, canvas: Size, mut each: impl FnMut(usize, usize, u8)) {
        let state = self.states[t];
        let size = self.extent.half_w / HALF * state.log_scale.exp();
        let (sin, cos) = state.angle.sin_cos();
        let reach = size * HALF * (sin.abs() + cos.abs()) + 1.0;
        let range = |at: f64, side: usize| {
            let end = |v: f64| v.clamp(0.0, side as f64) as usize;
            end((at - reach).floor())..end((at + reach).ceil() + 1.0)
        };
        let ink = |x: i64, y: i64| {
            let inside = |k: i64| (0..SIDE as i64).contains(&k);
            if inside(x) && inside(y) { f64::from(self.ink[y as usize * SIDE + x as usize]) } else { 0.0 }
        };
        for y in range(state.y, canvas.height) {
            for x in range(state.x, canvas.width) {
                let (dx, dy) = ((x as f64 - state.x) / size, (y as f64 - state.y) / size);
                // The digit's pixel, the middle of the square being between pixels 13 and 14.
                let (u, v) = (cos * dx + sin * dy + HALF - 0.5, cos * dy - sin * dx + HALF - 0.5);
                if (-0.5..SIDE as f64 - 0.5).contains(&u) && (-0.5..SIDE as f64 - 0.5).contains(&v) {
                    let (i, j) = (u.floor(), v.floor());
                    let row = |j: i64| (1.0 - (u - i)) * ink(i as i64, j) + (u - i) * ink(i as i64 + 1, j);
                    let value = (1.0 - (v - j)) * row(j as i64) + (v - j) * row(j as i64 + 1);
                    each(x, y, value.round() as u8);
                }
            }
        }
    }
}

/// A video made of [`Multi`] and digits.
#[derive(Clone, Debug)]
pub struct MultiVideo {
    settings: Multi,
    background: Vec<u8>,
    movers: Vec<Mover>,
}

impl Multi {
    /// Draws paths, sizes and angles until there are enough crossings.
    ///
    /// # Errors
    /// A setting is out of range, the digits lack a class, or no paths are found in 2000 tries.
    pub fn video(&self, digits: &Digits) -> Result<MultiVideo> {
        const TRIES: u64 = 2000;
        self.check()?;
        let streams = self.streams(0);
        let mut rng = streams.rng(0);
        let mut classes: Vec<u8> = (0..10).collect();
        classes.shuffle(&mut rng);
        let pictures = classes.iter().cycle().take(self.targets).map(|&c| Ok(pick(digits, c, &mut rng)?.to_vec()));
        let pictures = pictures.collect::<Result<Vec<_>>>()?;
        let mut background = vec![0; self.width * self.height];
        for i in 0..self.clutter {
            let digit = pick(digits, classes[9 - i % 10usize.saturating_sub(self.targets).max(1)], &mut rng)?;
            let (x, y) = (rng.random_range(0..=self.width - SIDE), rng.random_range(0..=self.height - SIDE));
            self.ink.draw(&mut background, self.width, digit, x, y);
        }
        for attempt in 0..TRIES {
            let mut rng = streams.rng(1 + attempt);
            let movers = self.movers(&pictures, &classes, &mut rng)?;
            let video = MultiVideo { settings: self.clone(), background: background.clone(), movers };
            if video.apart(0) && crossings(&video.truth()).len() >= self.crossings {
                return Ok(video);
            }
        }
        wrong(format!(
            "no paths of {} that start apart and cross {} in {TRIES} tries; give more frames, or fewer targets or crossings",
            counted(self.targets, "target"),
            counted(self.crossings, "time")
        ))
    }

    /// Of a crowd, each digit starts apart from those before, if it finds room; of a few, all or none do.
    fn movers(&self, pictures: &[Vec<u8>], classes: &[u8], rng: &mut Rng) -> Result<Vec<Mover>> {
        const FEW: usize = 10;
        const TRIES: usize = 200;
        let mut movers: Vec<Mover> = Vec::with_capacity(pictures.len());
        for (ink, class) in pictures.iter().zip(classes.iter().cycle()) {
            let mut mover = self.mover(ink, *class, rng)?;
            let apart = |mover: &Mover| {
                movers.iter().all(|m| grown(&m.bbox(0), 1.2).intersection(&grown(&mover.bbox(0), 1.2)) == 0.0)
            };
            for _ in 0..if pictures.len() > FEW { TRIES } else { 0 } {
                if apart(&mover) {
                    break;
                }
                mover = self.mover(ink, *class, rng)?;
            }
            movers.push(mover);
        }
        Ok(movers)
    }

    fn mover(&self, ink: &[u8], class: u8, rng: &mut Rng) -> Result<Mover> {
        let margin = HALF * self.scale[1];
        let room = [self.width as f64 - 2.0 * margin, self.height as f64 - 2.0 * margin];
        let path = Path { room, frames: self.frames, speed: self.speed }.draw(rng)?;
        let [low, high] = self.scale.map(f64::ln);
        // Half swings in the video: of size one to two, of angle one to three.
        let (swing, sway) = (rng.random_range(1.0..=2.0), rng.random_range(1.0..=3.0));
        let mut coin = || if rng.random::<bool>() { 1.0 } else { 0.0 };
        let (begin, side) = (coin(), 2.0 * coin() - 1.0);
        let most = side * self.turn.to_radians() * rng.random_range(0.5..=1.0);
        let first = low + (high - low) * begin;
        let states = path.iter().enumerate().map(|(t, [x, y])| {
            let half = std::f64::consts::PI * t as f64 / (self.frames - 1).max(1) as f64;
            let level = 0.5 - 0.5 * (half * swing + std::f64::consts::PI * begin).cos();
            let before = path[t.saturating_sub(1)];
            State {
                x: x + margin - 0.5,
                y: y + margin - 0.5,
                vx: x - before[0],
                vy: y - before[1],
                log_scale: low + (high - low) * level - first,
                angle: most * (half * sway).sin(),
                log_aspect: 0.0,
            }
        });
        let half = HALF * first.exp();
        Ok(Mover { class, extent: Extent { half_w: half, half_h: half }, states: states.collect(), ink: ink.to_vec() })
    }

    fn rules(&self) -> Result<()> {
        let [low, high] = self.scale;
        let least = (2.0 * HALF * high).ceil();
        check_scene(self.frames, Size::new(self.width, self.height), least, self.speed)?;
        if 1.0 <= low && low <= high && high <= 10.0 {
            return Ok(());
        }
        wrong(format!("scale is from {low} to {high}, expected 1 to 10, the smaller first"))
    }

    fn streams(&self, frame: u64) -> Streams {
        // Apart from the streams of the other scenes with the same seed.
        Streams::new(self.seed, 2000 + self.targets as u64).at(frame, Purpose::Scene)
    }
}

impl MultiVideo {
    /// Width and height in pixels.
    pub fn size(&self) -> Size {
        Size::new(self.settings.width, self.settings.height)
    }
    /// What moves; later ones are drawn over earlier ones.
    pub fn movers(&self) -> &[Mover] {
        &self.movers
    }
    /// Length of the video.
    pub fn frames(&self) -> usize {
        self.settings.frames
    }
    /// The true boxes; ids are places in [`MultiVideo::movers`], counted from 1.
    pub fn truth(&self) -> Tracks {
        let at = |frame: usize| {
            let one = move |(i, mover): (usize, &Mover)| TrackBox {
                frame,
                id: i as i64 + 1,
                bbox: mover.bbox(frame),
                confidence: 1.0,
            };
            self.movers.iter().enumerate().map(one)
        };
        Tracks { sightings: (0..self.frames()).flat_map(at).collect() }
    }

    /// Share of each target's solid ink in frame `t` that no later target's ink covers, 0 to 1.
    pub fn visible(&self, t: usize) -> Vec<f64> {
        let size @ Size { width, height } = self.size();
        let mut top = vec![usize::MAX; width * height];
        let mut all = vec![0u32; self.movers.len()];
        for (i, mover) in self.movers.iter().enumerate() {
            mover.pixels(t, size, |x, y, ink| {
                if ink >= SOLID || self.settings.ink == Ink::Opaque {
                    top[y * width + x] = i;
                    all[i] += u32::from(ink >= SOLID);
                }
            });
        }
        let mut seen = vec![0u32; self.movers.len()];
        for (i, mover) in self.movers.iter().enumerate() {
            mover.pixels(t, size, |x, y, ink| {
                seen[i] += u32::from(ink >= SOLID && top[y * width + x] == i);
            });
        }
        seen.iter().zip(&all).map(|(seen, all)| f64::from(*seen) / f64::from(*all).max(1.0)).collect()
    }

    /// Draws frame `t`. Panics if the video is shorter.
    pub fn render(&self, t: usize) -> Image {
        let size @ Size { width, height } = self.size();
        let mut canvas = self.background.clone();
        for mover in &self.movers {
            mover.pixels(t, size, |x, y, ink| {
                let below = &mut canvas[y * width + x];
                *below = self.settings.ink.over(*below, ink);
            });
        }
        if self.settings.noise > 0.0 {
            let mut rng = self.settings.streams(1 + t as u64).rng(0);
            for pixel in canvas.iter_mut() {
                let roll = rng.random::<f64>();
                if roll < self.settings.noise {
                    *pixel = 255 * u8::from(roll < self.settings.noise / 2.0);
                }
            }
        }
        Image::new(width, height, 1, canvas).expect("the canvas was made to these sides")
    }

    /// The frames in order, at 30 a second.
    pub fn source(self) -> DrawnFrames<Self> {
        let (size, frames) = (self.size(), self.frames());
        DrawnFrames::new(self, size, frames, Self::render)
    }

    /// `frame,target,digit,x,y,w,h,scale,angle_degrees,visible`, one line a target and frame: frames and pixels from 1, boxes upright,
    /// scale relative to frame 1, angles clockwise.
    pub fn truth_csv(&self) -> String {
        let mut text = String::from("frame,target,digit,x,y,w,h,scale,angle_degrees,visible\n");
        for t in 0..self.frames() {
            for (i, (mover, visible)) in self.movers.iter().zip(self.visible(t)).enumerate() {
                let (BBox { x, y, w, h }, state) = (mover.bbox(t), mover.states[t]);
                let (scale, angle) = (state.log_scale.exp(), state.angle.to_degrees());
                let place = format!("{:.3},{:.3},{w:.3},{h:.3}", x + 1.0, y + 1.0);
                let _ =
                    writeln!(text, "{},{},{},{place},{scale:.5},{angle:.3},{visible:.3}", t + 1, i + 1, mover.class);
            }
        }
        text
    }

    /// MOTChallenge's `gt/gt.txt`: `frame,id,x,y,w,h,1,1,visible`.
    pub fn gt_txt(&self) -> String {
        let mut text = String::new();
        for t in 0..self.frames() {
            for (i, (mover, visible)) in self.movers.iter().zip(self.visible(t)).enumerate() {
                let BBox { x, y, w, h } = mover.bbox(t);
                let place = format!("{:.3},{:.3},{w:.3},{h:.3}", x + 1.0, y + 1.0);
                let _ = writeln!(text, "{},{},{place},1,1,{visible:.3}", t + 1, i + 1);
            }
        }
        text
    }

    fn apart(&self, t: usize) -> bool {
        // A tenth of a box beside each: a retina then reads nothing of another target.
        let boxes: Vec<BBox> = self.movers.iter().map(|m| grown(&m.bbox(t), 1.2)).collect();
        (0..boxes.len()).all(|i| (0..i).all(|j| boxes[i].intersection(&boxes[j]) == 0.0))
    }
}

fn grown(b: &BBox, factor: f64) -> BBox {
    let (x, y) = b.centre();
    BBox::around(x, y, factor * b.w, factor * b.h)
}

#[cfg(test)]
mod tests;
