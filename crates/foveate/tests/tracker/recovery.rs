//! A target that vanishes and comes back elsewhere is found again.

use foveate::config::Config;
use foveate::control::RedetectionSettings;
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::lab::Digits;
use foveate::scene::Image;

/// Black, with a digit at a place or without.
fn picture(digit: &[u8], at: Option<(usize, usize)>) -> Image {
    let mut image = Image::grey(200, 150, 0);
    if let Some((x, y)) = at {
        for (row, ink) in digit.chunks_exact(28).enumerate() {
            image.plane_mut(0)[(y + row) * 200 + x..][..28].copy_from_slice(ink);
        }
    }
    image
}

/// Frames from the return until the estimate is within 5 px of the target; none if it never is.
fn found_after(redetection: Option<RedetectionSettings>, seed: u64) -> Option<usize> {
    let digits = Digits::drawn(seed, 1);
    let digit = digits.digit(3).to_vec();
    let config = Config {
        redetection,
        clamp_to_frame: true,
        ..Config::builtin("digits").expect("it ships").expect("it is right")
    };
    let mut tracker = config.check(&Folder::here()).expect("it fits").tracker(seed).expect("it fits");
    let (here, there) = ((20, 20), (150, 100));
    tracker.init(&picture(&digit, Some(here)), BBox { x: 20.0, y: 20.0, w: 28.0, h: 28.0 }).expect("a box");
    for t in 1..80 {
        let at = if t < 15 {
            Some(here)
        } else if t < 40 {
            None
        } else {
            Some(there)
        };
        let picture = picture(&digit, at);
        let (x, y) = tracker.update(&picture).expect("a picture of the first size").bbox.centre();
        if t >= 40 && (x - 163.5).hypot(y - 113.5) < 5.0 {
            return Some(t - 40);
        }
    }
    None
}

#[test]
fn what_comes_back_elsewhere_is_found() {
    let found: Vec<_> = (0..10).map(|seed| found_after(Some(RedetectionSettings::default()), seed)).collect();
    let soon = found.iter().flatten().filter(|frames| **frames <= 10).count();
    assert!(soon >= 8, "found again after so many frames: {found:?}");
    let without = (0..10).filter_map(|seed| found_after(None, seed)).filter(|frames| *frames <= 10).count();
    assert!(without < soon, "it is the search that finds it: {without} without");
}
