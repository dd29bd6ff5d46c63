//! Proposes a box around a click: where motion (different from the camera's) and saliency differ most from their surroundings.

use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::{Detector, Flow, Image, Map, Saliency};

/// Minimum side of a box in pixels, and maximum fraction of the picture.
const LEAST: f64 = 8.0;
const LARGEST: f64 = 0.4;
/// Motion threshold, pixels per frame; saliency threshold, 0 to 1.
const MOVES: f32 = 0.75;
const STANDS_OUT: f32 = 0.05;
/// Side of the default box, as a fraction of the picture's shorter side, if nothing was found.
const PLAIN: f64 = 0.15;
/// Points along the picture's longer side at which the maps are sampled.
const POINTS: usize = 160;
/// Candidate boxes: aspect ratios, distances of their centres from the click (fraction of a side), and the extent of the surroundings
/// (fraction of a side).
const ASPECTS: [f64; 7] = [0.4, 0.55, 0.75, 1.0, 1.35, 1.8, 2.5];
const SHIFTS: [f64; 5] = [-0.24, -0.12, 0.0, 0.12, 0.24];
const AROUND: f64 = 0.3;
/// Preference for larger boxes: the exponent of the area.
const PREFERENCE: f64 = 0.03;

/// Returns a box around a place, or the most salient box without one, and its origin: `motion`, `saliency`, `size`. Motion is computed with
/// another frame, the one before or after.
pub(crate) fn propose(other: Option<&Image>, image: &Image, at: Option<(f64, f64)>) -> (BBox, &'static str) {
    let size = image.size();
    let (mut flow, mut saliency) = (Flow::default(), Saliency::default());
    let (mut moving, mut salient) = (vec![], vec![]);
    if let Some(other) = other.filter(|other| other.shape() == image.shape()) {
        flow.detect(other, &mut moving);
        flow.detect(image, &mut moving);
    }
    saliency.detect(image, &mut salient);
    let place = at.or_else(|| salient.first().map(|d| d.bbox.centre()));
    let maps = [(flow.map(), MOVES), (saliency.map(), STANDS_OUT)];
    let found = place.and_then(|place| about(&maps, place, size));
    if let Some((bbox, map)) = found {
        return (bbox, ["motion", "saliency"][map]);
    }
    let (w, h) = (size.width as f64, size.height as f64);
    let (x, y) = at.unwrap_or((w / 2.0, h / 2.0));
    let side = (PLAIN * w.min(h)).max(LEAST);
    (inside(&BBox::around(x, y, side, side), size), "size")
}

/// Returns the box around a place in which the maps, relative to their values there, differ most from the surroundings; and the first map
/// above its threshold there.
fn about(maps: &[(&Map, f32)], (x, y): (f64, f64), size: Size) -> Option<(BBox, usize)> {
    let step = (size.width.max(size.height) as f64 / POINTS as f64).max(2.0);
    let (w, h) = ((size.width as f64 / step).ceil() as usize, (size.height as f64 / step).ceil() as usize);
    let (mut values, mut first) = (vec![0.0f64; w * h], None);
    for (k, (map, least)) in maps.iter().enumerate().filter(|(_, (map, _))| !map.values().is_empty()) {
        let near = |i: i32, j: i32| {
            map.at_pixel(x as f32 + (i * map.cell() as i32) as f32, y as f32 + (j * map.cell() as i32) as f32)
        };
        let value = (-1..=1).flat_map(|j| (-1..=1).map(move |i| near(i, j))).fold(0.0, f32::max);
        if value < *least {
            continue;
        }
        first.get_or_insert(k);
        for (i, v) in values.iter_mut().enumerate() {
            let centre = |i: usize| ((i as f64 + 0.5) * step) as f32;
            *v += f64::from((map.at_pixel(centre(i % w), centre(i / w)) / value).clamp(0.0, 1.0));
        }
    }
    let first = first?;
    let sums = Sums::of(&values, w, h);
    let (mut best, mut bbox) = (f64::NEG_INFINITY, None);
    let mut side = LEAST / step;
    while side * side <= LARGEST * (w * h) as f64 {
        for aspect in ASPECTS.map(f64::sqrt) {
            for (dx, dy) in SHIFTS.iter().flat_map(|dx| SHIFTS.map(|dy| (*dx, dy))) {
                let (bw, bh) = (side * aspect, side / aspect);
                let b = BBox::around(x / step + dx * bw, y / step + dy * bh, bw, bh);
                let around = BBox {
                    x: b.x - AROUND * bw,
                    y: b.y - AROUND * bh,
                    w: bw * (1.0 + 2.0 * AROUND),
                    h: bh * (1.0 + 2.0 * AROUND),
                };
                let ((within, area), (all, room)) = (sums.over(&b), sums.over(&around));
                if area < 1.0
                    || room <= area
                    || b.x < -0.5
                    || b.y < -0.5
                    || b.x + b.w > w as f64 + 0.5
                    || b.y + b.h > h as f64 + 0.5
                {
                    continue;
                }
                let score = (within / area - (all - within) / (room - area)) * area.powf(PREFERENCE);
                if score > best {
                    (best, bbox) = (score, Some(b));
                }
            }
        }
        side *= 1.15;
    }
    let scaled = |b: BBox| BBox { x: b.x * step, y: b.y * step, w: b.w * step, h: b.h * step };
    bbox.map(|b| (inside(&scaled(b), size), first))
}

/// Sums of values over boxes.
struct Sums {
    width: usize,
    height: usize,
    all: Vec<f64>,
}

impl Sums {
    fn of(values: &[f64], width: usize, height: usize) -> Self {
        let mut all = vec![0.0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += values[y * width + x];
                all[(y + 1) * (width + 1) + x + 1] = all[y * (width + 1) + x + 1] + row;
            }
        }
        Self { width, height, all }
    }
    /// Returns the sum over the points in a box, and their number.
    fn over(&self, b: &BBox) -> (f64, f64) {
        let cut = |v: f64, n: usize| v.round().clamp(0.0, n as f64) as usize;
        let (x0, x1) = (cut(b.x, self.width), cut(b.x + b.w, self.width));
        let (y0, y1) = (cut(b.y, self.height), cut(b.y + b.h, self.height));
        let at = |x: usize, y: usize| self.all[y * (self.width + 1) + x];
        (at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0), ((x1 - x0) * (y1 - y0)) as f64)
    }
}

/// Returns a box of whole pixels, of at least the minimum size, inside the picture.
fn inside(b: &BBox, Size { width, height }: Size) -> BBox {
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
        for (at, x) in [(Some((0.0, 0.0)), 0.0), (Some((99.0, 49.0)), 92.0), (None, 47.0)] {
            let (bbox, from) = propose(Some(&even), &even, at);
            assert_eq!((bbox.x, bbox.w, from), (x, 8.0, "size"));
        }
    }
}
