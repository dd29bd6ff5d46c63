//! The paper's first experiment: one digit moves among static ones (section 6.1).
//!
//! The paper gives no numbers; these are those of the authors' published video maker
//! (`lorisbaz/AttentionalRBM`): a black canvas of 250 × 200, two static digits of each other class at
//! uniform places, a 28 × 28 target on a cubic spline over everything, 300 frames. Drawing replaces
//! the pixels where the digit has ink (grey above 0), so what lies below shows around the strokes.
//! With noise, each frame starts as fresh salt and pepper of density 0.3: half of it stays black, half
//! is a grey of 1 to 255; digits are drawn over it, so every black pixel is exposed, also inside the box.
//! Frame `t` depends on the settings and `t` alone: any frame can be drawn without the others.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::idx::{Digits, SIDE};
use super::spline::Spline;
use super::{Frame, FrameSource, Image, SourceInfo};
use crate::geometry::BBox;
use crate::rng::{Purpose, Rng, Streams};
use crate::{Error, Result};

/// The salt and pepper density of the authors' noisy videos.
pub const NOISE: f64 = 0.3;

/// How a digit covers what lies below it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ink {
    /// Pixels with ink replace what lies below, black ones are transparent: the authors' way.
    #[default]
    Replace,
    /// The brighter of the two stays: strokes melt into each other.
    Brighter,
    /// The whole 28 × 28 square replaces what lies below.
    Opaque,
}

/// Settings of a video; [`Default`] is the experiment without noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clutter {
    /// Class of the moving digit, 0 to 9.
    pub digit: u8,
    /// Everything random follows from this and `digit`.
    pub seed: u64,
    /// Length of the video.
    pub frames: usize,
    /// Width of the canvas in pixels, at least 28.
    pub width: usize,
    /// Height of the canvas in pixels, at least 28.
    pub height: usize,
    /// Share of the black pixels hit by salt and pepper, 0 to 1; half of it is visible.
    pub noise: f64,
    /// Number of static digits, the nine other classes in turn.
    pub distractors: usize,
    /// Slowest and fastest mean speed of a video, pixels a frame (the authors' ten: 1.35 to 2.15).
    pub speed: [f64; 2],
    /// How digits cover each other.
    pub ink: Ink,
    /// Whether the target is drawn between pixels (bilinear); the authors round to whole ones.
    pub subpixel: bool,
}

impl Default for Clutter {
    fn default() -> Self {
        Self {
            digit: 3,
            seed: 7,
            frames: 300,
            width: 250,
            height: 200,
            noise: 0.0,
            distractors: 18,
            speed: [1.35, 2.15],
            ink: Ink::Replace,
            subpixel: false,
        }
    }
}

/// A video made of [`Clutter`] and digits: what is needed to draw any of its frames.
#[derive(Clone, Debug)]
pub struct ClutterVideo {
    settings: Clutter,
    background: Vec<u8>,
    target: Vec<u8>,
    truth: Vec<BBox>,
}

impl Clutter {
    /// Draws the background and the path.
    ///
    /// Errors: a setting is out of range, the digits lack a class, or no path fits the canvas.
    pub fn video(&self, digits: &Digits) -> Result<ClutterVideo> {
        self.check()?;
        let streams = self.streams(0);
        let target = pick(digits, self.digit, &mut streams.rng(0))?.to_vec();

        let mut background = vec![0; self.width * self.height];
        let others: Vec<u8> = (0..10).filter(|&c| c != self.digit).collect();
        let mut rng = streams.rng(1);
        for i in 0..self.distractors {
            let digit = pick(digits, others[i % others.len()], &mut rng)?;
            let x = rng.random_range(0..=self.width - SIDE);
            let y = rng.random_range(0..=self.height - SIDE);
            self.draw(&mut background, digit, x, y);
        }

        let path = self.path(&mut streams.rng(2))?;
        let side = SIDE as f64;
        let truth = path.into_iter().map(|[x, y]| BBox { x, y, w: side, h: side }).collect();
        Ok(ClutterVideo { settings: self.clone(), background, target, truth })
    }

    fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(Error::Config(format!("synthetic video: {what}")));
        let [slow, fast] = self.speed;
        match self {
            _ if self.digit > 9 => wrong(format!("digit is {}, expected 0 to 9", self.digit)),
            _ if self.frames == 0 => wrong("frames is 0, expected at least 1".into()),
            _ if self.width.min(self.height) < SIDE || self.width.max(self.height) > 10_000 => {
                wrong(format!("a canvas of {} x {}, expected sides of 28 to 10000", self.width, self.height))
            }
            _ if !(0.0..=1.0).contains(&self.noise) => wrong(format!("noise is {}, expected 0 to 1", self.noise)),
            _ if !(0.0 <= slow && slow <= fast && fast.is_finite()) => {
                wrong(format!("speed is from {slow} to {fast}, expected 0 or more, the slower first"))
            }
            _ => Ok(()),
        }
    }

    fn streams(&self, frame: u64) -> Streams {
        Streams::new(self.seed, u64::from(self.digit)).at(frame, Purpose::Scene)
    }

    /// Top-left corners of the target: a cubic spline through uniform points, equally sampled in its
    /// parameter, as long as the speed asks for. A point near a fault of the curve is drawn again: a
    /// fault is a place off the canvas, a step of 5 px or more (none of the authors' videos has one;
    /// 2.3 times the mean where that is more), or two points nearer than a tenth of the canvas.
    fn path(&self, rng: &mut Rng) -> Result<Vec<[f64; 2]>> {
        const TRIES: usize = 100_000;
        let room = [(self.width - SIDE) as f64, (self.height - SIDE) as f64];
        let near = 0.1 * room[0].hypot(room[1]);
        let mean = self.speed[0] + (self.speed[1] - self.speed[0]) * rng.random::<f64>();
        let top = (2.3 * mean).max(5.0);
        let length = mean * (self.frames - 1) as f64;

        let click = |rng: &mut Rng| room.map(|side| side * rng.random::<f64>());
        let mut points = vec![click(rng), click(rng)];
        for _ in 0..TRIES {
            while points.windows(2).map(|p| distance(p[0], p[1])).sum::<f64>() < length {
                points.push(click(rng));
                if points.len() > 2 * self.frames + 2 {
                    break;
                }
            }
            let curve = Spline::through(points.clone());
            let Some(end) = parameter_at(&curve, length) else { break };
            let step = end / (self.frames - 1).max(1) as f64;
            let mut path: Vec<_> = (0..self.frames).map(|t| curve.at(t as f64 * step)).collect();
            let crowded = (0..end.ceil() as usize).find(|&i| distance(points[i], points[i + 1]) < near);
            let outside = |p: &[f64; 2]| (0..2).any(|k| !(0.0..=room[k]).contains(&p[k]));
            let fast = |t: usize| t > 0 && distance(path[t - 1], path[t]) >= top;
            let fault = |t: &usize| outside(&path[*t]) || fast(*t);
            let at = crowded.or_else(|| (0..self.frames).find(fault).map(|t| (t as f64 * step) as usize));
            let Some(i) = at else {
                if !self.subpixel {
                    path.iter_mut().flatten().for_each(|x| *x = x.round());
                }
                return Ok(path);
            };
            let again = (i + rng.random_range(0..2)).min(points.len() - 1);
            points[again] = click(rng);
        }
        let (w, h) = (self.width, self.height);
        let problem =
            format!("no path of {length:.0} px fits a canvas of {w} x {h}; make it larger, or speed or frames less");
        Err(Error::Config(format!("synthetic video: {problem}")))
    }

    /// Draws a square digit with its top-left pixel at (x, y), cut where the canvas ends.
    fn draw(&self, canvas: &mut [u8], digit: &[u8], x: usize, y: usize) {
        let side = digit.len().isqrt();
        for (below, ink) in canvas.chunks_exact_mut(self.width).skip(y).zip(digit.chunks_exact(side)) {
            for (below, &ink) in below[x..].iter_mut().zip(ink) {
                *below = match self.ink {
                    Ink::Replace if ink == 0 => *below,
                    Ink::Replace | Ink::Opaque => ink,
                    Ink::Brighter => ink.max(*below),
                };
            }
        }
    }
}

impl ClutterVideo {
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.truth.len()
    }
    /// Never: a video has at least one frame.
    pub fn is_empty(&self) -> bool {
        self.truth.is_empty()
    }
    /// The target's box in each frame, 28 × 28, 0-based.
    pub fn truth(&self) -> &[BBox] {
        &self.truth
    }
    /// The target's class.
    pub fn label(&self) -> u8 {
        self.settings.digit
    }
    /// Draws frame `t`. Panics if the video is shorter.
    pub fn render(&self, t: usize) -> Image {
        let s = &self.settings;
        let mut canvas = self.background.clone();
        if s.noise > 0.0 {
            let mut rng = s.streams(1 + t as u64).rng(0);
            for pixel in canvas.iter_mut() {
                let salt = rng.random::<f64>() < s.noise / 2.0;
                if salt && *pixel == 0 {
                    *pixel = rng.random_range(1..=255);
                }
            }
        }
        let BBox { x, y, .. } = self.truth[t];
        let (column, row) = (x.floor(), y.floor());
        if s.subpixel {
            s.draw(&mut canvas, &shifted(&self.target, x - column, y - row), column as usize, row as usize);
        } else {
            s.draw(&mut canvas, &self.target, column as usize, row as usize);
        }
        Image::new(s.width, s.height, 1, canvas).expect("the canvas was made to these sides")
    }
    /// The frames in order, at 30 a second.
    pub fn source(self) -> ClutterFrames {
        let s = &self.settings;
        let reader = "synthetic digits".into();
        let info = SourceInfo { width: s.width, height: s.height, frames: Some(self.len()), rate: 30.0, reader };
        ClutterFrames { video: self, next: 0, info }
    }
}

/// The frames of a [`ClutterVideo`].
#[derive(Clone, Debug)]
pub struct ClutterFrames {
    video: ClutterVideo,
    next: usize,
    info: SourceInfo,
}

impl Iterator for ClutterFrames {
    type Item = Result<Frame>;
    fn next(&mut self) -> Option<Self::Item> {
        let index = self.next;
        (index < self.video.len()).then(|| {
            self.next += 1;
            Ok(Frame { index, time: index as f64 / self.info.rate, image: self.video.render(index) })
        })
    }
    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.video.len() - self.next;
        (left, Some(left))
    }
}

impl FrameSource for ClutterFrames {
    fn info(&self) -> &SourceInfo {
        &self.info
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

/// A digit moved right and down by less than a pixel, bilinear, 29 × 29.
fn shifted(digit: &[u8], dx: f64, dy: f64) -> Vec<u8> {
    let at = |x: usize, y: usize| if x < SIDE && y < SIDE { f64::from(digit[y * SIDE + x]) } else { 0.0 };
    let row = |x: usize, y: usize| (1.0 - dx) * at(x, y) + dx * at(x.wrapping_sub(1), y);
    let cells = (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (x, y)));
    cells.map(|(x, y)| ((1.0 - dy) * row(x, y) + dy * row(x, y.wrapping_sub(1))).round() as u8).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The parameter at which a curve is `length` long.
fn parameter_at(curve: &Spline, length: f64) -> Option<f64> {
    const PIECES: usize = 32; // a point: chords then miss less than 0.2 % of an arc's length
    let mut run = 0.0;
    let mut last = curve.at(0.0);
    for i in 1..=(curve.end() as usize * PIECES) {
        let (t, next) = (i as f64 / PIECES as f64, curve.at(i as f64 / PIECES as f64));
        let step = distance(last, next);
        if run + step >= length {
            return Some(t - (1.0 - (length - run) / step.max(f64::MIN_POSITIVE)) / PIECES as f64);
        }
        run += step;
        last = next;
    }
    (length <= run).then_some(curve.end())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One digit of each class: a filled square with a transparent rim, of grey 100 + class.
    fn squares() -> Digits {
        let pixel = |i: usize, c: u8| {
            let inside = |k: usize| (4..24).contains(&k);
            if inside(i / SIDE) && inside(i % SIDE) { 100 + c } else { 0 }
        };
        let images = (0..10).flat_map(|c| (0..SIDE * SIDE).map(move |i| pixel(i, c))).collect();
        Digits { images, labels: (0..10).collect() }
    }
    fn each() -> impl Iterator<Item = Clutter> {
        (0..10).flat_map(|seed| (0..10).map(move |digit| Clutter { digit, seed, ..Clutter::default() }))
    }

    #[test]
    fn tracks_move_as_the_authors_do() {
        for settings in each() {
            let video = settings.video(&squares()).expect("a video");
            let mut length = 0.0;
            for b in video.truth() {
                assert_eq!((b.x.fract(), b.y.fract(), b.w, b.h), (0.0, 0.0, 28.0, 28.0));
                assert!(b.x >= 0.0 && b.y >= 0.0 && b.x <= 222.0 && b.y <= 172.0, "{b:?} is off the canvas");
            }
            for pair in video.truth().windows(2) {
                let step = (pair[1].x - pair[0].x).hypot(pair[1].y - pair[0].y);
                assert!(step < 5.0 + 1.5, "a step of {step}"); // 5 before both ends are rounded
                length += step;
            }
            let mean = length / 299.0;
            assert!((1.35 * 0.95..2.15 * 1.15).contains(&mean), "mean speed {mean}"); // rounding adds some
        }
    }

    #[test]
    fn the_target_lies_where_the_truth_says() {
        let settings = Clutter { noise: NOISE, ..Clutter::default() };
        let video = settings.video(&squares()).expect("a video");
        for t in [0, 100, 299] {
            let (image, b) = (video.render(t), video.truth()[t]);
            for y in 4..24 {
                for x in 4..24 {
                    assert_eq!(image.at(0, b.x as usize + x, b.y as usize + y), 103);
                }
            }
        }
        assert_eq!((video.label(), video.len()), (3, 300));
    }

    #[test]
    fn there_are_two_distractors_of_each_other_class() {
        // Opaque ink and many seeds: what shows of a class is at most two squares, and each class shows.
        let mut shown = [0_usize; 10];
        for seed in 0..50 {
            let settings = Clutter { seed, ..Clutter::default() };
            let video = settings.video(&squares()).expect("a video");
            for class in 0..10_u8 {
                let pixels = video.background.iter().filter(|&&p| p == 100 + class).count();
                assert!(pixels <= 2 * 400 && (class != 3 || pixels == 0));
                shown[class as usize] += pixels;
            }
        }
        assert!((0..10).all(|c| c == 3 || shown[c] > 50 * 400), "{shown:?}");
    }

    #[test]
    fn noise_is_half_of_its_density_on_black_and_fresh_each_frame() {
        let quiet = Clutter { distractors: 0, ..Clutter::default() };
        let video = Clutter { noise: NOISE, ..quiet.clone() }.video(&squares()).expect("a video");
        let clean = quiet.video(&squares()).expect("a video");
        let (a, b) = (video.render(10), video.render(11));
        let (mut black, mut lit, mut sum) = (0_usize, 0_usize, 0_u64);
        for (&noisy, &clean) in a.bytes().iter().zip(clean.render(10).bytes()) {
            if clean > 0 {
                assert_eq!(noisy, clean, "noise lies under the ink");
            } else {
                black += 1;
                lit += usize::from(noisy > 0);
                sum += u64::from(noisy);
            }
        }
        // 49,600 pixels, binomial with p = 0.15: sd 80, 5 sd; greys uniform with mean 128, sd 73.6 / sqrt(7440), 5 sd.
        assert!((lit as f64 - 0.15 * black as f64).abs() < 400.0, "{lit} of {black}");
        assert!((sum as f64 / lit as f64 - 128.0).abs() < 4.3);
        let both = a.bytes().iter().zip(b.bytes()).filter(|(a, b)| **a > 0 && a == b).count();
        assert!(both < 700, "{both} pixels stayed"); // the target's 400, and 1 in 255 of 1,100
    }

    #[test]
    fn frames_do_not_need_each_other_and_repeat() {
        let settings = Clutter { noise: NOISE, frames: 5, ..Clutter::default() };
        let video = settings.video(&squares()).expect("a video");
        let frames: Vec<_> = video.clone().source().map(|f| f.expect("a frame")).collect();
        assert_eq!(frames.len(), 5);
        assert_eq!(frames[4].image, settings.video(&squares()).expect("again").render(4));
        assert_eq!((frames[4].index, frames[4].time), (4, 4.0 / 30.0));
        assert_eq!(video.source().info().frames, Some(5));
    }

    #[test]
    fn between_pixels_the_centre_of_mass_is_the_truth() {
        let settings = Clutter { subpixel: true, distractors: 0, ..Clutter::default() };
        let video = settings.video(&squares()).expect("a video");
        for t in [3, 150, 298] {
            let (image, truth) = (video.render(t), video.truth()[t].centre());
            let (mut mass, mut at) = (0.0, [0.0; 2]);
            for y in 0..image.height() {
                for x in 0..image.width() {
                    let ink = f64::from(image.at(0, x, y));
                    (mass, at) = (mass + ink, [at[0] + ink * x as f64, at[1] + ink * y as f64]);
                }
            }
            assert!((at[0] / mass - truth.0).hypot(at[1] / mass - truth.1) < 0.02, "frame {t}");
        }
    }

    #[test]
    fn wrong_settings_say_what_is_wrong() {
        let good = Clutter::default();
        for (settings, said) in [
            (Clutter { digit: 10, ..good.clone() }, "digit is 10"),
            (Clutter { frames: 0, ..good.clone() }, "frames is 0"),
            (Clutter { width: 27, ..good.clone() }, "27 x 200"),
            (Clutter { noise: f64::NAN, ..good.clone() }, "noise is NaN"),
            (Clutter { speed: [2.0, 1.0], ..good.clone() }, "speed is from 2 to 1"),
            (Clutter { width: 28, height: 28, ..good.clone() }, "no path"),
        ] {
            let problem = settings.video(&squares()).expect_err(said).to_string();
            assert!(problem.contains(said), "{problem}");
        }
        let one = Clutter { frames: 1, width: 28, height: 28, ..good.clone() };
        assert_eq!(one.video(&squares()).expect("one frame needs no room").len(), 1);
        assert!(Clutter { frames: 5000, ..good }.video(&squares()).is_ok());
    }
}
