//! Boxes of upright walkers out of the marks of a motion detector.
//!
//! A pedestrian in dark clothes before a dark window appears in parts, and two side by side appear as one. Parts
//! above each other are joined; regions too wide for one pedestrian are split at the columns with the fewest marks;
//! small regions are dropped. There is no model of people: every upright moving region is a pedestrian, and
//! pedestrians who occlude each other stay one region.

use crate::geometry::BBox;
use crate::scene::{Detection, Detector, Image, Map, Motion};

/// [`Motion`], with boxes for upright walkers.
#[derive(Clone, Debug)]
pub struct Walkers {
    /// Width of a walker, as a share of the height.
    pub shape: f64,
    /// Least area of a box, as a share of the picture.
    pub least: f64,
    /// Largest gap between parts of one walker, as a share of the height of both together.
    pub gap: f64,
    motion: Motion,
    whole: Vec<BBox>,
}

impl Default for Walkers {
    fn default() -> Self {
        let mut motion = Motion::default();
        motion.patience = u8::MAX;
        Self { shape: 0.42, least: 0.001, gap: 0.2, motion, whole: vec![] }
    }
}

impl Walkers {
    /// As [`Motion::learn_background`].
    pub fn learn_background(&mut self, frames: &[Image]) {
        self.motion.learn_background(frames);
    }
    /// Joins the parts that stand above each other.
    fn join(&mut self, found: &[Detection]) {
        self.whole.clear();
        self.whole.extend(found.iter().map(|d| d.bbox));
        let mut i = 0;
        while i < self.whole.len() {
            let joins = |j: &usize| *j != i && self.belongs(&self.whole[i], &self.whole[*j]);
            match (0..self.whole.len()).find(joins) {
                Some(j) => {
                    self.whole[i.min(j)] = self.whole[i].union(&self.whole[j]);
                    self.whole.remove(i.max(j));
                    i = 0;
                }
                None => i += 1,
            }
        }
    }
    fn belongs(&self, a: &BBox, b: &BBox) -> bool {
        let shared = (a.x + a.w).min(b.x + b.w) - a.x.max(b.x);
        let gap = a.y.max(b.y) - (a.y + a.h).min(b.y + b.h);
        let both = a.union(b);
        shared > 0.5 * a.w.min(b.w) && gap < self.gap * both.h && both.w < 1.3 * a.w.max(b.w)
    }
}

impl Detector for Walkers {
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        self.motion.detect(image, found);
        self.join(found);
        found.clear();
        let (map, picture) = (self.motion.map(), (image.width() * image.height()) as f64);
        for whole in &self.whole {
            let pieces = (whole.w / (self.shape * whole.h)).round().clamp(1.0, 20.0) as usize;
            let mut left = whole.x;
            for piece in 1..=pieces {
                let even = whole.x + whole.w * piece as f64 / pieces as f64;
                let right =
                    if piece == pieces { even } else { thinnest(map, whole, even, whole.w / pieces as f64 / 3.0) };
                let (bbox, mass) = tight(map, &BBox { x: left, w: (right - left).max(1.0), ..*whole });
                if bbox.w * bbox.h >= self.least * picture && mass > 0.0 {
                    found.push(Detection::new(bbox, mass));
                }
                left = right;
            }
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable: among equals the order of the parts
    }
    fn map(&self) -> &Map {
        self.motion.map()
    }
}

/// The column within `reach` of `x` that has the fewest marks in a box.
fn thinnest(map: &Map, bbox: &BBox, x: f64, reach: f64) -> f64 {
    let (from, to) = ((x - reach).max(bbox.x + 1.0) as usize, (x + reach).min(bbox.x + bbox.w - 1.0) as usize);
    let rows = bbox.y as usize..(bbox.y + bbox.h) as usize;
    let marks = |column: usize| rows.clone().filter(|row| map.values()[row * map.width() + column] > 0.0).count();
    let columns = (from..=to).filter(|column| *column < map.width());
    columns.min_by_key(|column| (marks(*column), (*column as f64 - x).abs() as usize)).map_or(x, |column| column as f64)
}

/// The box of the marks within a box, and the sum of their values.
fn tight(map: &Map, b: &BBox) -> (BBox, f64) {
    let (mut left, mut right, mut top, mut bottom, mut mass) = (usize::MAX, 0, usize::MAX, 0, 0.0);
    let columns = b.x as usize..((b.x + b.w) as usize).min(map.width());
    for row in b.y as usize..((b.y + b.h) as usize).min(map.height()) {
        for column in columns.clone() {
            let value = map.values()[row * map.width() + column];
            if value > 0.0 {
                (left, right, top, bottom) = (left.min(column), right.max(column), top.min(row), bottom.max(row));
                mass += f64::from(value);
            }
        }
    }
    if mass <= 0.0 {
        return (*b, 0.0);
    }
    let (w, h) = ((right - left + 1) as f64, (bottom - top + 1) as f64);
    (BBox { x: left as f64, y: top as f64, w, h }, mass)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    fn picture(boxes: &[(usize, usize, usize, usize)]) -> Image {
        let marked = |k: usize| {
            let (x, y) = (k % 200, k / 200);
            boxes.iter().any(|&(left, top, w, h)| (left..left + w).contains(&x) && (top..top + h).contains(&y))
        };
        Image::new(200, 150, 1, (0..200 * 150).map(|k| if marked(k) { 220 } else { 40 }).collect()).expect("bytes")
    }

    #[test]
    fn walkers_keep_the_law() {
        conformance::detector(&|| Box::<Walkers>::default());
    }

    #[test]
    fn parts_are_joined_and_pairs_are_cut() {
        let mut walkers = Walkers::default();
        walkers.learn_background(&[picture(&[]), picture(&[(9, 9, 30, 60)]), picture(&[])]);
        // One in two parts, and two side by side whose arms touch; a speck.
        let image = picture(&[
            (20, 20, 24, 30),
            (21, 60, 22, 30),
            (80, 30, 25, 60),
            (112, 30, 25, 60),
            (104, 50, 9, 6),
            (190, 5, 5, 5),
        ]);
        let mut found = vec![];
        walkers.detect(&image, &mut found);
        found.sort_by(|a, b| a.bbox.x.total_cmp(&b.bbox.x));
        let near = |a: &BBox, x: f64, y: f64, w: f64, h: f64| {
            [a.x - x, a.y - y, a.w - w, a.h - h].iter().all(|off| off.abs() <= 6.0)
        };
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(near(&found[0].bbox, 20.0, 20.0, 24.0, 70.0), "{found:?}");
        assert!(near(&found[1].bbox, 80.0, 30.0, 28.0, 60.0), "{found:?}");
        assert!(near(&found[2].bbox, 109.0, 30.0, 28.0, 60.0), "{found:?}");
    }
}
