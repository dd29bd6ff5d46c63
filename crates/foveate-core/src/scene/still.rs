//! Does the camera stand still? Detectors of motion take for granted that it does.

use super::{Flow, Image};

/// Level of the pyramid at which the flow ends: an eighth of the sides is enough for the camera.
const LEVEL: usize = 3;
/// Motion between two frames, as a share of the picture's diagonal, above which the camera moved.
const MOVED: f64 = 0.002;
/// Frames that are watched before anything is said, and share of all in which the camera must have moved: a large thing
/// before a camera that stands passes for its motion in some.
const FEWEST: usize = 20;
const SHARE: f64 = 0.5;

/// Watches the flow between pictures for motion of the camera.
pub struct StillCamera {
    flow: Flow,
    seen: bool,
    frames: usize,
    moved: usize,
}

impl Default for StillCamera {
    fn default() -> Self {
        Self { flow: Flow::down_to(LEVEL), seen: false, frames: 0, moved: 0 }
    }
}

impl StillCamera {
    /// Takes the next picture; it is not compared with the one before where a cut lies between.
    pub fn look(&mut self, image: &Image, cut: bool) {
        self.flow.look(image);
        if std::mem::replace(&mut self.seen, true) && !cut {
            self.frames += 1;
            self.moved += usize::from(self.motion(image) > MOVED);
        }
    }

    /// How far the picture moved since the last one, as a share of its diagonal: the mean of four places, so that zoom and
    /// driving forward count.
    pub fn motion(&self, image: &Image) -> f64 {
        let (w, h) = (image.width() as f64, image.height() as f64);
        let at = |x: f64, y: f64| {
            let (u, v) = self.flow.camera().at(x * w, y * h);
            u.hypot(v)
        };
        (at(0.25, 0.25) + at(0.75, 0.25) + at(0.25, 0.75) + at(0.75, 0.75)) / 4.0 / w.hypot(h)
    }

    /// The share of the frames in which the camera moved, 0 to 1, if it moves: in half of them, of twenty at least.
    pub fn moves(&self) -> Option<f64> {
        let share = self.moved as f64 / self.frames.max(1) as f64;
        (self.frames >= FEWEST && share >= SHARE).then_some(share)
    }
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
    fn a_camera_that_turns_is_told_from_one_that_stands() {
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
}
