//! Detections at the edge of the picture, which contain only the visible part of their target.

use crate::geometry::BBox;
use crate::scene::Image;

/// Distance from the edge that counts as at the edge, pixels.
const NEAR: f64 = 2.0;
/// Least ratio of the areas of detection and target's box for a new template.
const GROWN: f64 = 1.1;
/// Least ratio of each side of such a detection to that of the target's box.
const AS_LONG: f64 = 0.9;

/// Returns whether each end of an interval lies at the end of `0..side`.
fn ends(from: f64, length: f64, side: f64) -> (bool, bool) {
    (from <= NEAR, from + length >= side - NEAR)
}

/// Returns whether a target is entering: its detection, at the edge, has outgrown its box, and covers at most the share `most` of the
/// picture.
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

/// Returns how far an interval in `0..side` moved: the smaller motion of its two ends, or, at the edge, the distance that it entered.
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
    fn a_growing_box_at_the_edge_is_entering() {
        let image = Image::new(100, 80, 1, vec![0; 8000]).expect("bytes");
        let bbox = |x: f64, w: f64| BBox { x, y: 20.0, w, h: 40.0 };
        assert!(comes_in(&bbox(0.0, 10.0), &bbox(0.0, 14.0), &image, 0.5));
        assert!(comes_in(&bbox(90.0, 10.0), &bbox(84.0, 16.0), &image, 0.5));
        assert!(!comes_in(&bbox(0.0, 10.0), &bbox(0.0, 10.5), &image, 0.5), "it has not grown by a tenth");
        // Each side may shrink by up to a tenth while the area grows.
        for (w, h, enters) in [(9.5, 60.0, true), (8.5, 60.0, false), (15.0, 37.0, true), (15.0, 35.0, false)] {
            let found = BBox { h, ..bbox(0.0, w) };
            assert_eq!(comes_in(&bbox(0.0, 10.0), &found, &image, 0.5), enters, "{w} x {h}");
        }
        assert!(!comes_in(&bbox(30.0, 10.0), &bbox(30.0, 14.0), &image, 0.5), "not at the edge");
        assert!(!comes_in(&bbox(0.0, 14.0), &bbox(0.0, 10.0), &image, 0.5), "goes out");
        assert!(!comes_in(&bbox(0.0, 14.0), &BBox { h: 20.0, ..bbox(0.0, 50.0) }, &image, 0.5), "something else");
        assert!(!comes_in(&bbox(0.0, 80.0), &BBox { y: 0.0, h: 60.0, ..bbox(0.0, 90.0) }, &image, 0.5), "too large");
    }

    #[test]
    fn an_interval_moves_by_its_smaller_motion_or_enters() {
        assert_eq!(moved((10.0, 20.0), (13.0, 22.0), 100.0), 3.0);
        assert_eq!(moved((10.0, 20.0), (7.0, 26.0), 100.0), 0.0, "it grows");
        assert_eq!(moved((0.0, 20.0), (0.0, 26.0), 100.0), 6.0, "it comes in");
        assert_eq!(moved((80.0, 20.0), (71.0, 29.0), 100.0), 9.0);
        assert_eq!(moved((80.0, 20.0), (84.0, 16.0), 100.0), 0.0, "what leaves was there before");
        assert_eq!(moved((0.0, 100.0), (0.0, 100.0), 100.0), 0.0);
    }
}
