//! A box about a click: what moves there otherwise than the camera, or else what stands out there.

use foveate::geometry::BBox;
use foveate::scene::{Detection, Detector, Flow, Image, Map, Regions, Saliency};
use foveate::scene::detect::{Blobs, Score};

/// Sides of a box, pixels, at least; and its share of the picture, at most.
const LEAST: f64 = 8.0;
const LARGEST: f64 = 0.4;
/// Pixels a frame from which on something moves.
const MOVES: f32 = 0.75;
/// Saliency (0 to 1) from which on something stands out.
const STANDS_OUT: f32 = 0.08;
/// A candidate reaches as far as the map has this share of its value at the click.
const REACH: f32 = 0.5;
/// Share of the picture's shorter side that a box has where nothing was found.
const PLAIN: f64 = 0.15;

/// A box about a place, or without one about what is most conspicuous; and where it comes from: `motion`, `saliency`, `size`.
/// Motion is told by another frame, the one before or after.
pub fn propose(other: Option<&Image>, image: &Image, at: Option<(f64, f64)>) -> (BBox, &'static str) {
    let size = (image.width(), image.height());
    let mut found = vec![];
    if let Some(other) = other.filter(|other| other.shape() == image.shape()) {
        let mut flow = Flow::default();
        flow.detect(other, &mut found);
        flow.detect(image, &mut found);
        if let Some(bbox) = about(flow.map(), &found, at, MOVES, Score::Mass, size) {
            return (bbox, "motion");
        }
    }
    let mut saliency = Saliency::default();
    saliency.detect(image, &mut found);
    if let Some(bbox) = about(saliency.map(), &found, at, STANDS_OUT, Score::Peak, size) {
        return (bbox, "saliency");
    }
    let (w, h) = (size.0 as f64, size.1 as f64);
    let (x, y) = at.unwrap_or((w / 2.0, h / 2.0));
    let side = (PLAIN * w.min(h)).max(LEAST);
    (inside(&BBox::around(x, y, side, side), size), "size")
}

/// The part of a map about a place; without a place the best candidate.
fn about(
    map: &Map,
    found: &[Detection],
    at: Option<(f64, f64)>,
    least: f32,
    score: Score,
    size: (usize, usize),
) -> Option<BBox> {
    let fits = |b: &BBox| b.w.min(b.h) >= LEAST / 2.0 && b.w * b.h <= LARGEST * (size.0 * size.1) as f64;
    let Some((x, y)) = at else {
        return found.iter().map(|d| inside(&d.bbox, size)).find(fits);
    };
    let cell = map.cell() as f32;
    let near = |i: i32, j: i32| map.at_pixel(x as f32 + i as f32 * cell, y as f32 + j as f32 * cell);
    let value = (-1..=1).flat_map(|j| (-1..=1).map(move |i| near(i, j))).fold(0.0, f32::max);
    if value < least {
        return None;
    }
    let mut parts = vec![];
    Blobs::new(16, score).find(map, (REACH * value).max(least / 2.0), size, &mut parts);
    let slack = f64::from(1.5 * cell);
    let holds = |b: &BBox| x >= b.x - slack && x <= b.x + b.w + slack && y >= b.y - slack && y <= b.y + b.h + slack;
    let area = |b: &BBox| b.w * b.h;
    parts.iter().map(|d| d.bbox).filter(|b| holds(b) && fits(b)).max_by(|a, b| area(a).total_cmp(&area(b))).map(|b| inside(&b, size))
}

/// A box of whole pixels, not too small, in the picture.
fn inside(b: &BBox, (width, height): (usize, usize)) -> BBox {
    let fit = |from: f64, side: f64, room: usize| {
        let side = side.round().max(LEAST).min(room as f64);
        (from.round().clamp(0.0, room as f64 - side), side)
    };
    let ((x, w), (y, h)) = (fit(b.x, b.w, width), fit(b.y, b.h, height));
    BBox { x, y, w, h }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(left: usize) -> Image {
        let value = |x: usize, y: usize| match (left..left + 28).contains(&x) && (40..68).contains(&y) {
            true => 200 + ((x - left) * y % 40) as u8,
            false => 60 + ((x * 7919 + y * 104_729) % 23) as u8,
        };
        Image::new(160, 120, 1, (0..160 * 120).map(|i| value(i % 160, i / 160)).collect()).expect("160 x 120")
    }

    #[test]
    fn a_click_on_a_thing_gives_its_box() {
        let truth = BBox::new(60.0, 40.0, 28.0, 28.0);
        for before in [None, Some(&scene(57))] {
            for at in [None, Some((74.0, 54.0)), Some((65.0, 62.0))] {
                let (bbox, from) = propose(before, &scene(60), at);
                assert!(bbox.iou(&truth) > 0.5, "{from}, {at:?}: {bbox:?}");
            }
        }
    }

    #[test]
    fn a_click_on_nothing_gives_a_plain_box() {
        let even = Image::grey(100, 50, 80);
        for (at, x) in [(Some((0.0, 0.0)), 0.0), (Some((99.0, 49.0)), 92.0), (None, 46.0)] {
            let (bbox, from) = propose(Some(&even), &even, at);
            assert_eq!((bbox.x, bbox.w, from), (x, 8.0, "size"));
        }
    }
}
