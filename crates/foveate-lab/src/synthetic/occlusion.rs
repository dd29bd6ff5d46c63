//! The paper's partial-information scenes: one digit on black passes behind things, under noise (section 6.2).
//!
//! "Digits from the MNIST data set moving on a black background. The target in each video encounters one or more
//! partial occlusions ... each video sequence has been corrupted with 30% noise": no more is printed. Ours: bars of
//! 14 × 40 px lie across the path, 4 px from it at most, none over the first place; then noise goes over the
//! whole frame, the target and the first frame too.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::idx::{Digits, SIDE};
use crate::synthetic::path::Path;
use crate::synthetic::{Drawn, Ink, NOISE, check_scene, pick, shifted, wrong};
use foveate_base::Result;
use foveate_base::rng::{Purpose, Streams};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;

/// Settings that give the configuration `digits-partial` a sharp window of 5 x 5 pixels, a 31st of the digit's box. A
/// smaller look carries less evidence, so there are more particles and a flatter likelihood. The experiment `budget`
/// of the paper's crate uses the same.
pub const GLIMPSE: [&str; 4] =
    ["particles=2000", "retina.rings=[[5,1]]", "likelihood.sharpness=13", "likelihood.distance.presence.extra=0.7"];

/// What noise does to a pixel it hits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Corruption {
    /// Black or white take its place, by a coin.
    #[default]
    Replaced,
    /// It becomes 255 minus its value. This is much harder, because every hit changes the pixel.
    Inverted,
}

foveate_base::settings! {
    /// Settings of a video; [`Default`] is the partial-information experiment.
    pub struct Occlusion in "occlusion" and rules {
        /// Class of the digit, 0 to 9.
        pub digit: u8 = 3; 0.0 to 9.0,
        /// Everything random follows from this and `digit`.
        pub seed: u64 = 7,
        /// Length of the video.
        pub frames: usize = 300,
        /// Width of the canvas in pixels.
        pub width: usize = 200,
        /// Height of the canvas in pixels.
        pub height: usize = 200,
        /// Side of the target's square in pixels, 28 to 280; beyond 28 the digit is enlarged (bilinear).
        pub side: usize = SIDE; 28.0 to 280.0,
        /// Slowest and fastest mean speed of a video, pixels a frame.
        pub speed: [f64; 2] = [2.0, 3.0],
        /// Number of bars that lie across the path.
        pub bars: usize = 2; 0.0 to 1000.0,
        /// Short and long side of a bar, in units of a 28th of the target's side.
        pub bar: [usize; 2] = [14, 40],
        /// Grey of the bars: 0 is the background's.
        pub shade: u8 = 0,
        /// Side of a black square that hides the middle of the target from the second frame on, in units of a 28th of the
        /// target's side; 0 for none.
        pub patch: usize = 0; 0.0 to 28.0,
        /// Share of the pixels hit by noise, 0 to 1; the first frame's too.
        pub noise: f64 = NOISE; 0.0 to 1.0,
        /// What becomes of them.
        pub corruption: Corruption = Corruption::Replaced,
    }
}

/// A video made of [`Occlusion`] and a digit.
#[derive(Clone, Debug)]
pub struct OcclusionVideo {
    settings: Occlusion,
    target: Vec<u8>,
    bars: Vec<BBox>,
    truth: Vec<BBox>,
}

impl Occlusion {
    /// Draws the path and the bars.
    ///
    /// Errors: a setting is out of range, the digits lack the class, or no path fits the canvas.
    pub fn video(&self, digits: &Digits) -> Result<OcclusionVideo> {
        self.check()?;
        let streams = self.streams(0);
        let target = enlarged(pick(digits, self.digit, &mut streams.rng(0))?, self.side);
        let room = [(self.width - self.side) as f64, (self.height - self.side) as f64];
        let path = Path { room, frames: self.frames, speed: self.speed }.draw(&mut streams.rng(2))?;
        let side = self.side as f64;
        let truth: Vec<_> = path.into_iter().map(|[x, y]| BBox { x, y, w: side, h: side }).collect();
        let bars = self.bars_across(&truth, streams);
        Ok(OcclusionVideo { settings: self.clone(), target, bars, truth })
    }

    /// Alternating vertical and horizontal bars, each about a point of its section of the path. A bar that would
    /// touch the first box is drawn again, and dropped after 1000 attempts.
    fn bars_across(&self, truth: &[BBox], streams: Streams) -> Vec<BBox> {
        let mut rng = streams.rng(1);
        let [short, long] = self.bar.map(|b| (b * self.side) as f64 / SIDE as f64);
        let off = 4.0 * self.side as f64 / SIDE as f64;
        let mut bar = |i: usize| {
            let (w, h) = if i.is_multiple_of(2) { (short, long) } else { (long, short) };
            (0..1000).find_map(|_| {
                let t = (truth.len() as f64 * (i as f64 + rng.random::<f64>()) / self.bars as f64) as usize;
                let (x, y) = truth[t.min(truth.len() - 1)].centre();
                let [dx, dy] = std::array::from_fn(|_| rng.random_range(-off..=off));
                let BBox { x, y, .. } = BBox::around(x + dx, y + dy, w, h);
                let bar = BBox { x: x.round(), y: y.round(), w, h };
                (bar.intersection(&truth[0]) == 0.0).then_some(bar)
            })
        };
        (0..self.bars).filter_map(&mut bar).collect()
    }

    fn rules(&self) -> Result<()> {
        check_scene(self.frames, Size::new(self.width, self.height), self.side as f64, self.speed)?;
        if self.bar.iter().all(|b| (1..=1000).contains(b)) {
            return Ok(());
        }
        wrong(format!("bars of {:?}, expected sides of 1 to 1000", self.bar))
    }

    fn streams(&self, frame: u64) -> Streams {
        // Apart from the streams of clutter with the same seed.
        Streams::new(self.seed, 1000 + u64::from(self.digit)).at(frame, Purpose::Scene)
    }
}

impl OcclusionVideo {
    /// The bars in front of the target, 0-based; some may lie beyond the canvas in part.
    pub fn bars(&self) -> &[BBox] {
        &self.bars
    }
    /// Share of the target's box that bars cover in frame `t`, 0 to 1; overlapping bars count twice.
    pub fn covered(&self, t: usize) -> f64 {
        let truth = &self.truth[t];
        (self.bars.iter().map(|bar| bar.intersection(truth)).sum::<f64>() / (truth.w * truth.h)).min(1.0)
    }
    /// Fills a box of the canvas, clipped to it.
    fn fill(&self, canvas: &mut [u8], area: &BBox, grey: u8) {
        let clip = |from: f64, length: f64, end: usize| {
            let to = (from + length).round().clamp(0.0, end as f64) as usize;
            from.round().clamp(0.0, end as f64) as usize..to
        };
        let (columns, rows) = (clip(area.x, area.w, self.settings.width), clip(area.y, area.h, self.settings.height));
        for row in rows {
            canvas[row * self.settings.width..][columns.clone()].fill(grey);
        }
    }
}

impl Drawn for OcclusionVideo {
    fn size(&self) -> Size {
        Size::new(self.settings.width, self.settings.height)
    }
    fn truth(&self) -> &[BBox] {
        &self.truth
    }
    fn label(&self) -> u8 {
        self.settings.digit
    }
    fn render(&self, t: usize) -> Image {
        let s = &self.settings;
        let mut canvas = vec![0; s.width * s.height];
        let at = &self.truth[t];
        let digit = shifted(&self.target, at.x.fract(), at.y.fract());
        Ink::Replace.draw(&mut canvas, s.width, &digit, at.x as usize, at.y as usize);
        if t > 0 && s.patch > 0 {
            let ((x, y), side) = (at.centre(), (s.patch * s.side) as f64 / SIDE as f64);
            self.fill(&mut canvas, &BBox::around(x, y, side, side), 0);
        }
        for bar in &self.bars {
            self.fill(&mut canvas, bar, s.shade);
        }
        if s.noise > 0.0 {
            let mut rng = s.streams(1 + t as u64).rng(0);
            for pixel in canvas.iter_mut() {
                let roll = rng.random::<f64>();
                if roll < s.noise {
                    *pixel = match s.corruption {
                        Corruption::Replaced => 255 * u8::from(roll < s.noise / 2.0),
                        Corruption::Inverted => 255 - *pixel,
                    };
                }
            }
        }
        Image::new(s.width, s.height, 1, canvas).expect("the canvas was made to these sides")
    }
}

/// A digit at another size, bilinear, aligned at its edges.
fn enlarged(digit: &[u8], side: usize) -> Vec<u8> {
    let step = SIDE as f64 / side as f64;
    let at = |x: usize, y: usize| f64::from(digit[y.min(SIDE - 1) * SIDE + x.min(SIDE - 1)]);
    let split = |i: usize| {
        let place = ((i as f64 + 0.5) * step - 0.5).max(0.0);
        (place as usize, place.fract())
    };
    let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    let value = |(x, y): (usize, usize)| {
        let ((x, dx), (y, dy)) = (split(x), split(y));
        let row = |y| (1.0 - dx) * at(x, y) + dx * at(x + 1, y);
        ((1.0 - dy) * row(y) + dy * row(y + 1)).round() as u8
    };
    cells.map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::squares;
    use super::*;

    fn each() -> impl Iterator<Item = Occlusion> {
        (0..5).flat_map(|seed| (0..10).map(move |digit| Occlusion { digit, seed, ..Occlusion::default() }))
    }

    #[test]
    fn every_video_has_its_occlusions_and_an_open_start() {
        for settings in each() {
            let video = settings.video(&squares()).expect("a video");
            assert_eq!((video.bars().len(), video.truth().len()), (2, 300));
            assert_eq!(video.covered(0), 0.0, "the template is not occluded");
            let most = (0..300).map(|t| video.covered(t)).fold(0.0, f64::max);
            assert!(most > 0.25, "digit {} seed {}: {most} of the box at most", settings.digit, settings.seed);
        }
    }

    #[test]
    fn the_target_shows_but_for_bars() {
        let settings = Occlusion { noise: 0.0, shade: 77, ..Occlusion::default() };
        let video = settings.video(&squares()).expect("a video");
        for t in [0, 100, 299] {
            let (image, truth) = (video.render(t), video.truth()[t]);
            let (x, y) = truth.centre();
            let pixel = image.at(0, x as usize, y as usize);
            let hidden = video
                .bars()
                .iter()
                .any(|b| (b.x..b.x + b.w).contains(&x.floor()) && (b.y..b.y + b.h).contains(&y.floor()));
            assert_eq!(pixel, if hidden { 77 } else { 103 }, "frame {t}");
        }
        let bars = video.bars().iter().map(|b| b.w * b.h).sum::<f64>();
        let grey = video.render(0).plane(0).iter().filter(|p| **p == 77).count();
        assert!(grey > 0 && grey as f64 <= bars, "{grey} pixels of bars");
    }

    /// 40,000 pixels, seed 7; binomial, 5 deviations: three counts fail less than once in 10⁵.
    #[test]
    fn noise_hits_its_share() {
        let clear = Occlusion { noise: 0.0, ..Occlusion::default() }.video(&squares()).expect("a video");
        let count = |image: &Image, grey: u8| image.plane(0).iter().filter(|p| **p == grey).count() as f64;
        let near = |k: f64, n: f64, p: f64| (k - n * p).abs() < 5.0 * (n * p * (1.0 - p)).sqrt();
        for t in [0, 50] {
            let black = count(&clear.render(t), 0);
            let replaced = Occlusion::default().video(&squares()).expect("a video").render(t);
            assert!(near(count(&replaced, 255), 40_000.0, 0.15), "white takes 15 % of all pixels");
            let inverted = Occlusion { corruption: Corruption::Inverted, ..Occlusion::default() };
            let inverted = inverted.video(&squares()).expect("a video").render(t);
            assert!(near(count(&inverted, 255), black, 0.3), "30 % of the black pixels turn white");
        }
        let one = Occlusion::default().video(&squares()).expect("a video");
        assert_eq!(one.render(7).plane(0), one.render(7).plane(0));
        assert_ne!(one.render(7).plane(0), one.render(8).plane(0));
    }

    #[test]
    fn a_patch_hides_the_middle_after_the_first_frame() {
        let settings = Occlusion { noise: 0.0, bars: 0, patch: 10, side: 56, ..Occlusion::default() };
        let video = settings.video(&squares()).expect("a video");
        for t in [0, 1, 200] {
            let (x, y) = video.truth()[t].centre();
            let at = |dx: f64| video.render(t).at(0, (x + dx) as usize, y as usize);
            assert_eq!(at(0.0), if t == 0 { 103 } else { 0 });
            assert_eq!(at(13.0), 103, "20 px of 56 are hidden, 40 are inked");
        }
    }

    #[test]
    fn wrong_settings_are_errors_with_the_cause() {
        let good = Occlusion::default();
        for (settings, said) in [
            (Occlusion { digit: 10, ..good.clone() }, "occlusion.digit"),
            (Occlusion { patch: usize::MAX, ..good.clone() }, "occlusion.patch"),
            (Occlusion { side: 27, ..good.clone() }, "occlusion.side"),
            (Occlusion { side: 201, ..good.clone() }, "200 x 200"),
            (Occlusion { noise: f64::NAN, ..good.clone() }, "occlusion.noise"),
            (Occlusion { bar: [0, 40], ..good.clone() }, "bars of [0, 40]"),
            (Occlusion { side: 200, ..good.clone() }, "no path"),
        ] {
            let problem = settings.video(&squares()).expect_err(said).to_string();
            assert!(problem.contains(said), "{problem}");
        }
    }
}
