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

use crate::idx::{Digits, SIDE};
use crate::synthetic::path::Path;
use crate::synthetic::{Drawn, Ink, check_scene, pick, shifted};
use foveate_base::Result;
use foveate_base::rng::{Purpose, Streams};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;

/// The salt and pepper density of the authors' noisy videos.
pub const NOISE: f64 = 0.3;

foveate_base::settings! {
    /// Settings of a video; [`Default`] is the experiment without noise.
    pub struct Clutter in "clutter" and rules {
        /// Class of the moving digit, 0 to 9.
        pub digit: u8 = 3; 0.0 to 9.0,
        /// Everything random follows from this and `digit`.
        pub seed: u64 = 7,
        /// Length of the video.
        pub frames: usize = 300,
        /// Width of the canvas in pixels, at least 28.
        pub width: usize = 250,
        /// Height of the canvas in pixels, at least 28.
        pub height: usize = 200,
        /// Share of the black pixels hit by salt and pepper, 0 to 1; half of it is visible.
        pub noise: f64 = 0.0; 0.0 to 1.0,
        /// Number of static digits, the nine other classes in turn.
        pub distractors: usize = 18,
        /// Slowest and fastest mean speed of a video, pixels a frame (the authors' ten: 1.35 to 2.15).
        pub speed: [f64; 2] = [1.35, 2.15],
        /// How digits cover each other.
        pub ink: Ink = Ink::Replace,
        /// Whether the target is drawn between pixels (bilinear); the authors round to whole ones.
        pub subpixel: bool = false,
    }
}

/// A video of [`Clutter`] and digits that can draw any of its frames.
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
            self.ink.draw(&mut background, self.width, digit, x, y);
        }

        let room = [(self.width - SIDE) as f64, (self.height - SIDE) as f64];
        let mut path = Path { room, frames: self.frames, speed: self.speed }.draw(&mut streams.rng(2))?;
        if !self.subpixel {
            path.iter_mut().flatten().for_each(|x| *x = x.round());
        }
        let side = SIDE as f64;
        let truth = path.into_iter().map(|[x, y]| BBox { x, y, w: side, h: side }).collect();
        Ok(ClutterVideo { settings: self.clone(), background, target, truth })
    }

    fn rules(&self) -> Result<()> {
        check_scene(self.frames, Size::new(self.width, self.height), SIDE as f64, self.speed)
    }

    fn streams(&self, frame: u64) -> Streams {
        Streams::new(self.seed, u64::from(self.digit)).at(frame, Purpose::Scene)
    }
}

impl Drawn for ClutterVideo {
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
            let between = shifted(&self.target, x - column, y - row);
            s.ink.draw(&mut canvas, s.width, &between, column as usize, row as usize);
        } else {
            s.ink.draw(&mut canvas, s.width, &self.target, column as usize, row as usize);
        }
        Image::new(s.width, s.height, 1, canvas).expect("the canvas was made to these sides")
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::squares;
    use super::*;
    use foveate_video::FrameSource;

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
    fn the_target_is_at_its_true_box() {
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
        assert_eq!((video.label(), video.truth().len()), (3, 300));
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
    fn wrong_settings_are_errors_with_the_cause() {
        let good = Clutter::default();
        for (settings, said) in [
            (Clutter { digit: 10, ..good.clone() }, "clutter.digit"),
            (Clutter { frames: 0, ..good.clone() }, "frames is 0"),
            (Clutter { width: 27, ..good.clone() }, "27 x 200"),
            (Clutter { noise: f64::NAN, ..good.clone() }, "clutter.noise"),
            (Clutter { speed: [2.0, 1.0], ..good.clone() }, "speed is from 2 to 1"),
            (Clutter { width: 28, height: 28, ..good.clone() }, "no path"),
        ] {
            let problem = settings.video(&squares()).expect_err(said).to_string();
            assert!(problem.contains(said), "{problem}");
        }
        let one = Clutter { frames: 1, width: 28, height: 28, ..good.clone() };
        assert_eq!(one.video(&squares()).expect("one frame needs no room").truth().len(), 1);
        assert!(Clutter { frames: 5000, ..good }.video(&squares()).is_ok());
    }
}
