//! Training images with fixations.

use super::TrainingImage;
use crate::Digits;
use crate::idx::SIDE;
use foveate_base::rng::Rng;
use foveate_core::geometry::{Extent, Gaze, State};
use foveate_core::scene::Image;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use std::borrow::Cow;

/// Sides of a canvas of digits, pixels.
const CANVAS: usize = 140;
/// Number of digits on a canvas: at most as dense as in the authors' videos.
const CROWD: std::ops::RangeInclusive<usize> = 3..=12;
/// Maximum distance of a glimpse near a digit from its centre, pixels along an axis: a gaze and the particles' spread.
const NEAR: f64 = 14.0;

/// Draws a canvas of digits: clean (40 %), with the authors' noise under the ink at a third to four thirds of their density (35 %), with
/// noise in some of all pixels (10 %), or with Gaussian noise everywhere (15 %). Nine of ten glimpses are near a digit, the tenth anywhere;
/// the target's size is off by up to 15 %, and its angle by a few degrees.
pub(super) fn digits(digits: &Digits, looks: usize, rng: &mut Rng) -> TrainingImage<'static> {
    let mut canvas = vec![0u8; CANVAS * CANVAS];
    let mut centres = Vec::new();
    for _ in 0..rng.random_range(CROWD) {
        let digit = digits.digit(rng.random_range(0..digits.len()));
        let (x, y) = (rng.random_range(0..=CANVAS - SIDE), rng.random_range(0..=CANVAS - SIDE));
        for (row, ink) in digit.chunks_exact(SIDE).enumerate() {
            let below = &mut canvas[(y + row) * CANVAS + x..][..SIDE];
            below.iter_mut().zip(ink).filter(|(_, ink)| **ink > 0).for_each(|(below, &ink)| *below = ink);
        }
        let half = (SIDE as f64 - 1.0) / 2.0;
        centres.push((x as f64 + half, y as f64 + half));
    }
    let kind: f64 = rng.random();
    let strength: f64 = rng.random();
    for pixel in &mut canvas {
        if (0.4..0.75).contains(&kind) {
            // Salt and pepper of density d: half of it is black.
            if *pixel == 0 && rng.random::<f64>() < 0.05 + 0.15 * strength {
                *pixel = rng.random_range(1..=255);
            }
        } else if (0.75..0.85).contains(&kind) {
            if rng.random::<f64>() < 0.3 * strength {
                *pixel = if rng.random() { 255 } else { 0 };
            }
        } else if kind >= 0.85 {
            let noise: f64 = StandardNormal.sample(rng);
            *pixel = (f64::from(*pixel) + 76.0 * strength * noise).round().clamp(0.0, 255.0) as u8;
        }
    }
    let half = SIDE as f64 / 2.0 * rng.random_range(0.9..1.1);
    let extent = Extent { half_w: half, half_h: half };
    let looks = (0..looks)
        .map(|_| {
            let (x, y) = if rng.random::<f64>() < 0.9 {
                let (x, y) = centres[rng.random_range(0..centres.len())];
                (x + rng.random_range(-NEAR..NEAR), y + rng.random_range(-NEAR..NEAR))
            } else {
                (rng.random_range(0.0..CANVAS as f64), rng.random_range(0.0..CANVAS as f64))
            };
            let turn: f64 = StandardNormal.sample(rng);
            let log_scale = rng.random_range(-0.05..0.05);
            State { x, y, log_scale, angle: 0.08 * turn, ..State::default() }.fixate(Gaze::CENTRE, extent)
        })
        .collect();
    let image = Image::new(CANVAS, CANVAS, 1, canvas).expect("the canvas was made to these sides");
    TrainingImage { image: Cow::Owned(image), extent, looks }
}

/// Samples a photograph as a target of random size: 0.5 to 4 pixels per template pixel (`side` template pixels make the target's box), with
/// an aspect ratio from a half to two; glimpses anywhere, rotated by up to 0.3 rad, mirrored half the time.
pub(super) fn photograph<'a>(images: &'a [Image], side: f64, looks: usize, rng: &mut Rng) -> TrainingImage<'a> {
    let image = &images[rng.random_range(0..images.len())];
    let half = side / 2.0 * rng.random_range(f64::ln(0.5)..f64::ln(4.0)).exp();
    let stretch = rng.random_range(-0.35f64..0.35).exp();
    let extent = Extent { half_w: half * stretch, half_h: half / stretch };
    // Half a target from the border, if the picture is large enough.
    let along = |n: usize, half: f64| {
        let margin = half.min(0.35 * n as f64);
        move |rng: &mut Rng| rng.random_range(margin..n as f64 - margin)
    };
    let (x, y) = (along(image.width(), extent.half_w), along(image.height(), extent.half_h));
    let looks = (0..looks)
        .map(|_| {
            let (x, y, angle) = (x(rng), y(rng), rng.random_range(-0.3..0.3));
            let log_scale = rng.random_range(-0.1..0.1);
            let mut look = State { x, y, log_scale, angle, ..State::default() }.fixate(Gaze::CENTRE, extent);
            if rng.random() {
                (look.ux, look.uy) = (-look.ux, -look.uy);
            }
            look
        })
        .collect();
    TrainingImage { image: Cow::Borrowed(image), extent, looks }
}
