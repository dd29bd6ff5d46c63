//! At the edge of the picture a detection shows no more of its target than has come in by now.

use crate::geometry::BBox;
use crate::scene::Image;

/// Pixels from the edge that count as at it.
const NEAR: f64 = 2.0;
/// How much larger than the target's box, in area, a detection must be for a new template.
const GROWN: f64 = 1.1;
/// Share of each side of the target's box that such a detection has at least.
const AS_LONG: f64 = 0.9;

/// Which ends of an interval lie at the ends of `0..side`.
fn ends(from: f64, length: f64, side: f64) -> (bool, bool) {
    (from <= NEAR, from + length >= side - NEAR)
}

/// Whether a target is coming in: its detection, at the edge, has outgrown its box, and is not most of the picture.
pub(super) fn comes_in(bbox: &BBox, found: &BBox, image: &Image, most: f64) -> bool {
    let (width, height) = (image.width() as f64, image.height() as f64);
    let (x, y) = (ends(found.x, found.w, width), ends(found.y, found.h, height));
    let area = found.w * found.h;
    (x.0 || x.1 || y.0 || y.1)
        && area > GROWN * bbox.w * bbox.h
        && area <= most * width * height
        && found.w > AS_LONG * bbox.w
        && found.h > AS_LONG * bbox.h
}

/// How far an interval in `0..side` moved: as far as both of its ends did, or as far as it came in at the edge.
pub(super) fn moved(was: (f64, f64), is: (f64, f64), side: f64) -> f64 {
    let (near, far) = (is.0 - was.0, is.0 + is.1 - was.0 - was.1);
    let at = |k: fn((bool, bool)) -> bool| k(ends(was.0, was.1, side)) && k(ends(is.0, is.1, side));
    match (at(|e| e.0), at(|e| e.1)) {
        (true, false) => far.max(0.0),
        (false, true) => (-near).max(0.0),
        (false, false) if near * far > 0.0 => near.abs().min(far.abs()),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_grows_at_the_edge_comes_in() {
        let image = Image::new(100, 80, 1, vec![0; 8000]).expect("bytes");
        let bbox = |x: f64, w: f64| BBox { x, y: 20.0, w, h: 40.0 };
        assert!(comes_in(&bbox(0.0, 10.0), &bbox(0.0, 14.0), &image, 0.5));
        assert!(comes_in(&bbox(90.0, 10.0), &bbox(84.0, 16.0), &image, 0.5));
        assert!(!comes_in(&bbox(30.0, 10.0), &bbox(30.0, 14.0), &image, 0.5), "not at the edge");
        assert!(!comes_in(&bbox(0.0, 14.0), &bbox(0.0, 10.0), &image, 0.5), "goes out");
        assert!(!comes_in(&bbox(0.0, 14.0), &BBox { h: 20.0, ..bbox(0.0, 50.0) }, &image, 0.5), "something else");
        assert!(!comes_in(&bbox(0.0, 80.0), &BBox { y: 0.0, h: 60.0, ..bbox(0.0, 90.0) }, &image, 0.5), "too large");
    }

    #[test]
    fn an_interval_moves_with_both_ends_or_comes_in() {
        assert_eq!(moved((10.0, 20.0), (13.0, 22.0), 100.0), 3.0);
        assert_eq!(moved((10.0, 20.0), (7.0, 26.0), 100.0), 0.0, "it grows");
        assert_eq!(moved((0.0, 20.0), (0.0, 26.0), 100.0), 6.0, "it comes in");
        assert_eq!(moved((80.0, 20.0), (71.0, 29.0), 100.0), 9.0);
        assert_eq!(moved((80.0, 20.0), (84.0, 16.0), 100.0), 0.0, "what leaves was there before");
        assert_eq!(moved((0.0, 100.0), (0.0, 100.0), 100.0), 0.0);
    }
}
