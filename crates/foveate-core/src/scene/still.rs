//! Does the camera stand still? Detectors of motion need one that does.
//!
//! The dominant flow of a picture is the camera's, unless large objects cross it. So the picture must agree: with a
//! moving camera hardly any textured place stays unchanged, with a fixed one all of the background does.

use super::{Flow, Image, Map};

/// Level of the pyramid at which the flow ends: an eighth of the sides is enough for the camera.
const LEVEL: usize = 3;
/// Motion between two frames, as a share of the picture's diagonal, above which the camera moved.
const MOVED: f64 = 0.002;
/// Cells along the diagonal of the picture in which places are compared: a motion of `MOVED` is 0.4 cells.
const CELLS: f64 = 200.0;
/// The least difference between neighbouring cells of a textured place, as a share of white.
const TEXTURE: f32 = 4.0 / 255.0;
/// Share of unchanged textured places above which the camera is fixed. With fixed cameras it is 0.6 to 0.9, even if
/// large objects cross the picture; in 22 sequences with a moving camera it is 0.05 to 0.44 (median over frames).
const STANDING: f64 = 0.5;
/// Frames before a moving camera is reported, and the least share of them with motion.
const FEWEST: usize = 20;
const SHARE: f64 = 0.5;

/// Watches pictures for motion of the camera.
#[derive(Debug)]
pub struct StillCamera {
    flow: Flow,
    /// The last two pictures in coarse cells.
    before: Map,
    now: Map,
    sums: Vec<u16>,
    seen: bool,
    frames: usize,
    moved: usize,
}

impl Default for StillCamera {
    fn default() -> Self {
        let [before, now] = [Map::default(), Map::default()];
        Self { flow: Flow::down_to(LEVEL), before, now, sums: vec![], seen: false, frames: 0, moved: 0 }
    }
}

impl StillCamera {
    /// Adds the next picture; it is not compared with the previous one across a cut.
    pub fn look(&mut self, image: &Image, cut: bool) {
        self.flow.look(image);
        std::mem::swap(&mut self.before, &mut self.now);
        let cell = (diagonal(image) / CELLS).round().max(2.0) as usize;
        self.now.square_intensity(image, cell, &mut self.sums);
        if std::mem::replace(&mut self.seen, true) && !cut {
            self.frames += 1;
            let moved = self.motion(image) > MOVED && self.standing(image) < STANDING;
            self.moved += usize::from(moved);
        }
    }

    /// The share of unchanged textured places in the last two pictures, 0 to 1; 0 without texture. An unchanged place
    /// differs by less than a motion of half of `MOVED` along its gradient would cause.
    fn standing(&self, image: &Image) -> f64 {
        let (w, h) = (self.now.width(), self.now.height());
        if (self.before.width(), self.before.height()) != (w, h) || w < 3 {
            return 0.0;
        }
        let (before, now) = (self.before.values(), self.now.values());
        let most = (0.5 * MOVED * diagonal(image) / self.now.cell() as f64) as f32;
        let (mut textured, mut standing) = (0, 0);
        for y in 1..h.saturating_sub(1) {
            for k in y * w + 1..(y + 1) * w - 1 {
                let mean = |k: usize| 0.5 * (before[k] + now[k]);
                let (across, down) = (0.5 * (mean(k + 1) - mean(k - 1)), 0.5 * (mean(k + w) - mean(k - w)));
                let gradient = across.hypot(down);
                let is_textured = gradient >= TEXTURE;
                textured += usize::from(is_textured);
                standing += usize::from(is_textured && (now[k] - before[k]).abs() < most * gradient);
            }
        }
        standing as f64 / textured.max(1) as f64
    }

    /// Motion of the picture since the last one, by its dominant flow, as a share of the diagonal: the mean of four
    /// places, so that zoom and forward motion count. Large objects before a fixed camera may be mistaken for it.
    pub fn motion(&self, image: &Image) -> f64 {
        let (w, h) = (image.width() as f64, image.height() as f64);
        let at = |x: f64, y: f64| {
            let (u, v) = self.flow.camera().at(x * w, y * h);
            u.hypot(v)
        };
        (at(0.25, 0.25) + at(0.75, 0.25) + at(0.25, 0.75) + at(0.75, 0.75)) / 4.0 / diagonal(image)
    }

    /// The share of the frames in which the camera moved, 0 to 1, if it moves: in half of them, of twenty at least.
    pub fn moves(&self) -> Option<f64> {
        let share = self.moved as f64 / self.frames.max(1) as f64;
        (self.frames >= FEWEST && share >= SHARE).then_some(share)
    }
}

/// Of a picture, pixels.
fn diagonal(image: &Image) -> f64 {
    (image.width() as f64).hypot(image.height() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    /// A window of 320 x 240 px onto smooth noise, at (x, y), with a disc that walks across it.
    fn picture(x: usize, y: usize, disc: usize) -> Image {
        let mut rng = Streams::new(3, 0).at(0, Purpose::Scene).rng(0);
        let waves: Vec<[f64; 3]> = (0..30)
            .map(|_| [rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.1), rng.random_range(0.0..6.3)])
            .collect();
        let pixel = |k: usize| {
            let (i, j) = (k % 320, k / 320);
            if i.abs_diff(disc).pow(2) + j.abs_diff(120).pow(2) < 400 {
                return 250;
            }
            let (u, v) = ((i + x) as f64, (j + y) as f64);
            let sum: f64 = waves.iter().map(|w| (w[0] * u + w[1] * v + w[2]).sin()).sum();
            (128.0 + 15.0 * sum).clamp(0.0, 255.0) as u8
        };
        Image::new(320, 240, 1, (0..320 * 240).map(pixel).collect()).expect("as many bytes")
    }

    #[test]
    fn a_turning_camera_is_distinguished_from_a_fixed_one() {
        let (mut stands, mut turns) = (StillCamera::default(), StillCamera::default());
        for t in 0..22 {
            stands.look(&picture(0, 0, 20 + 5 * t), false);
            turns.look(&picture(3 * t, t, 20 + 5 * t), false);
            assert!(t > 19 || turns.moves().is_none(), "frame {t}: too early to say");
        }
        assert_eq!((stands.moves(), turns.moves()), (None, Some(1.0)));
        let last = turns.motion(&picture(0, 0, 0));
        assert!((last - 10f64.sqrt() / 400.0).abs() < 0.5 / 400.0, "it moves by 3.16 px of 400: {last}");
    }

    #[test]
    fn cuts_are_no_motion() {
        let mut cuts = StillCamera::default();
        (0..30).for_each(|t| cuts.look(&picture(7 * (t / 2), 0, 160), t % 2 == 0));
        assert_eq!(cuts.moves(), None);
    }

    /// The same world, with people of half the picture's height and more who walk through it in both directions: a texture of stripes each.
    fn crossed(x: usize, y: usize, t: usize) -> Image {
        let mut image = picture(x, y, 5000);
        for (first, speed, width) in [(0, 5, 70), (90, 4, 60), (200, 6, 70)] {
            let left = (first + speed * t) % 400;
            for row in 20..230 {
                for column in (left..left + width).map(|c| c % 400).filter(|c| *c < 320) {
                    let (u, v) = ((column + 400 - left) % 400, row - 20);
                    image.plane_mut(0)[row * 320 + column] = (60 + 50 * (u / 9 % 3) + 30 * (v / 14 % 3)) as u8;
                }
            }
        }
        image
    }

    #[test]
    fn large_objects_before_a_camera_that_stands_are_not_its_motion() {
        let (mut stands, mut turns) = (StillCamera::default(), StillCamera::default());
        let mut mistaken = 0;
        for t in 0..40 {
            let image = crossed(0, 0, t);
            stands.look(&image, false);
            mistaken += usize::from(t > 0 && stands.motion(&image) > MOVED);
            turns.look(&crossed(3 * t, t, t), false);
        }
        assert!(mistaken >= 20, "the flow alone takes them for the camera's motion in {mistaken} of 39 frames");
        assert_eq!(stands.moves(), None);
        assert!(turns.moves().is_some_and(|share| share > 0.9), "{:?}", turns.moves());
    }

    /// Noise of a sensor, two grey levels either way, moves nothing; nor does a picture without texture. More noise hides which places stay:
    /// then the flow alone decides.
    #[test]
    fn noise_is_no_motion_and_a_blank_wall_has_none() {
        let mut rng = Streams::new(5, 0).at(0, Purpose::Scene).rng(0);
        let (mut noisy, mut blank) = (StillCamera::default(), StillCamera::default());
        for t in 0..30 {
            let mut image = crossed(0, 0, t);
            image.plane_mut(0).iter_mut().for_each(|p| *p = p.saturating_add_signed(rng.random_range(-2..=2)));
            noisy.look(&image, false);
            blank.look(&Image::grey(320, 240, 90), false);
        }
        assert_eq!((noisy.moves(), blank.moves()), (None, None));
    }
}
