//! Boxes and the picture: the valid boxes of a target, and the place of boxes outside the picture in results.

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::scene::Image;
use foveate_video::SourceInfo;

/// Returns whether a part of a box lies in the picture.
pub fn touches(b: &BBox, image: &Image) -> bool {
    b.x < image.width() as f64 && b.y < image.height() as f64 && b.x + b.w > 0.0 && b.y + b.h > 0.0
}

/// Checks that a target of this video can have the box; `what` names the box in the error.
///
/// # Errors
/// [`Error::Invalid`], with the box and the expectation.
pub fn check_box(what: &str, b: &BBox, info: &SourceInfo) -> Result<()> {
    let (w, h) = (info.width as f64, info.height as f64);
    let numbers = [b.x, b.y, b.w, b.h];
    let inside = b.x < w && b.y < h && b.x + b.w > 0.0 && b.y + b.h > 0.0;
    let sized = b.w >= 2.0 && b.h >= 2.0 && b.w <= 4.0 * w && b.h <= 4.0 * h;
    if inside && sized && numbers.iter().all(|n| n.is_finite()) {
        return Ok(());
    }
    Err(Error::Invalid(format!(
        "{what} is x={}, y={}, w={}, h={}; expected a box of at least 2 x 2 pixels and at most {} x {}, touching the {w} x {h} \
         picture, x,y being its top-left corner in pixels, counted from 1",
        b.x + 1.0,
        b.y + 1.0,
        b.w,
        b.h,
        4.0 * w,
        4.0 * h
    )))
}

/// Returns the box for results: a box outside the picture moves to the nearest place where it touches the picture, and keeps its size. It
/// moves no farther from any visible target, so no score becomes worse.
pub fn touching(b: &BBox, image: &Image) -> BBox {
    if touches(b, image) {
        return *b;
    }
    let moved = |at: f64, side: f64, picture: usize| {
        let overlap = side.min(1.0);
        at.min(picture as f64 - overlap).max(overlap - side)
    };
    BBox { x: moved(b.x, b.w, image.width()), y: moved(b.y, b.h, image.height()), ..*b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_outside_is_moved_to_the_nearest_edge() {
        let image = Image::grey(100, 50, 0);
        let moved = |x, y, w, h| touching(&BBox { x, y, w, h }, &image);
        for (inside, why) in [((90.0, 40.0, 20.0, 20.0), "partly"), ((-19.5, 0.0, 20.0, 9.0), "hardly")] {
            let (x, y, w, h) = inside;
            assert_eq!(moved(x, y, w, h), BBox { x, y, w, h }, "{why} inside: it stays");
        }
        assert_eq!(moved(-1208.0, 10.0, 20.0, 30.0), BBox { x: -19.0, y: 10.0, w: 20.0, h: 30.0 });
        assert_eq!(moved(100.0, 900.0, 20.0, 0.5), BBox { x: 99.0, y: 49.5, w: 20.0, h: 0.5 });
        for odd in [f64::NAN, f64::INFINITY, -1e300] {
            let b = moved(odd, odd, 4.0, 4.0);
            assert!(b.x.is_finite() && b.y.is_finite() && touches(&b, &image), "{b:?}");
        }
    }
}
