//! Detection of candidates in a frame without knowledge of the target: the trait [`Detector`], and boxes from maps.
//!
//! [`Motion`](super::Motion), [`Saliency`](super::Saliency) and [`Flow`](super::Flow) fill a [`Map`], and [`Blobs`]
//! draws boxes around regions above a threshold.

use crate::geometry::{BBox, Size};
use crate::scene::{Image, Map};
use foveate_base::{Error, Result};

/// A box found by a detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Where, in pixels.
    pub bbox: BBox,
    /// How sure the detector is; larger is surer. NaN: it gives no score.
    pub score: f64,
    /// The number of its class, from 0; `None` if the detector has no classes.
    pub class: Option<usize>,
}

impl Detection {
    /// A detection without a class.
    pub fn new(bbox: BBox, score: f64) -> Self {
        Self { bbox, score, class: None }
    }

    /// Fails if the box is invalid, with the number of the detection and the value.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a number of the box is not finite, or width or height is not above 0.
    pub(crate) fn check(&self, index: usize) -> Result<()> {
        let BBox { x, y, w, h } = self.bbox;
        for (name, value) in [("left", x), ("top", y), ("width", w), ("height", h)] {
            if !value.is_finite() {
                return Err(Error::Invalid(format!(
                    "detection {index} (from 0): {name} is {value}; expected a finite number"
                )));
            }
        }
        for (name, value) in [("width", w), ("height", h)] {
            if value <= 0.0 {
                return Err(Error::Invalid(format!(
                    "detection {index} (from 0): {name} is {value}; expected pixels above 0, as in left, top, width, height"
                )));
            }
        }
        Ok(())
    }
}

/// Finds candidates in a frame, such as moving or salient regions.
///
/// May be assumed: frames come in the order of the video; the first frame, and one of another size than the one before,
/// begins a new video.
///
/// Must be obeyed: `found` is emptied first. Boxes lie within the picture, are at least 1 × 1 pixel, and come best first;
/// scores are finite and positive. The same frames in the same order give the same boxes, bit for bit. No frame causes a
/// panic. After the first frames a call allocates nothing but room in `found`. Otherwise the initiation of tracks, and proposals
/// that mix detections with the prior, would depend on leftovers, or fail in mid-video.
pub trait Detector: Send + Sync {
    /// Looks at the next frame.
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>);
    /// The map from which the candidates of the last frame were drawn: values of 0 or more over the whole frame. Empty before the
    /// first frame.
    fn map(&self) -> &Map;
}

/// The meaning of a candidate's score.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Score {
    /// The largest value in it.
    Peak,
    /// The sum of its values, times the area of a cell in pixels.
    Mass,
}

/// Boxes round the connected parts of a map.
#[derive(Clone, Debug)]
pub struct Blobs {
    /// Parts of fewer pixels than this are dropped.
    pub min_area: usize,
    /// The meaning of a part's score.
    pub score: Score,
    seen: Vec<bool>,
    stack: Vec<usize>,
}

impl Blobs {
    /// Parts of at least `min_area` pixels.
    pub fn new(min_area: usize, score: Score) -> Self {
        Self { min_area, score, seen: vec![], stack: vec![] }
    }
    /// Fills `found` with a box for each part of `map` that is above `threshold`, best first. Cells that touch at a side or a
    /// corner are one part. Boxes are cut to a picture of this size; a threshold below 0 is taken as 0.
    pub fn find(&mut self, map: &Map, threshold: f32, picture: Size, found: &mut Vec<Detection>) {
        found.clear();
        let threshold = threshold.max(0.0);
        self.seen.clear();
        self.seen.extend(map.values().iter().map(|v| *v <= threshold || !v.is_finite()));
        for start in 0..self.seen.len() {
            if !self.seen[start] {
                found.extend(self.part(map, start, picture));
            }
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable: among equals the upper one comes first
    }
    /// The part that holds cell `start`, if it is large enough.
    fn part(&mut self, map: &Map, start: usize, picture: Size) -> Option<Detection> {
        let (w, h, cell) = (map.width(), map.height(), map.cell());
        let (mut left, mut right, mut top, mut bottom) = (w, 0, h, 0);
        let (mut cells, mut sum, mut peak) = (0, 0.0_f64, 0.0_f64);
        self.seen[start] = true;
        self.stack.push(start);
        while let Some(k) = self.stack.pop() {
            let (i, j) = (k % w, k / w);
            (left, right, top, bottom) = (left.min(i), right.max(i), top.min(j), bottom.max(j));
            let value = f64::from(map.values()[k]);
            (cells, sum, peak) = (cells + 1, sum + value, peak.max(value));
            for y in j.saturating_sub(1)..=(j + 1).min(h - 1) {
                for x in i.saturating_sub(1)..=(i + 1).min(w - 1) {
                    if !std::mem::replace(&mut self.seen[y * w + x], true) {
                        self.stack.push(y * w + x);
                    }
                }
            }
        }
        let (x, y) = (left * cell, top * cell);
        let (x1, y1) = (((right + 1) * cell).min(picture.width), ((bottom + 1) * cell).min(picture.height));
        if cells * cell * cell < self.min_area || x1 <= x || y1 <= y {
            return None;
        }
        let score = match self.score {
            Score::Peak => peak,
            Score::Mass => sum * (cell * cell) as f64,
        };
        let bbox = BBox { x: x as f64, y: y as f64, w: (x1 - x) as f64, h: (y1 - y) as f64 };
        Some(Detection::new(bbox, score))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_become_boxes_best_first() {
        let mut map = Map::over(19, 10, 2); // 10 x 5 cells; the last column reaches past the picture
        for (i, j, value) in [(0, 0, 1.0), (1, 1, 2.0), (2, 0, 1.0), (9, 3, 5.0), (9, 4, 3.0), (5, 4, 9.0), (6, 2, 0.4)]
        {
            map.values_mut()[j * 10 + i] = value;
        }
        let mut found = vec![Detection::new(BBox { x: 0.0, y: 0.0, w: 1.0, h: 1.0 }, 1.0)];
        let mut blobs = Blobs::new(8, Score::Peak);
        blobs.find(&map, 0.5, Size::new(19, 10), &mut found);
        let boxes = |found: &[Detection]| {
            found.iter().map(|d| (d.bbox.x, d.bbox.y, d.bbox.w, d.bbox.h, d.score)).collect::<Vec<_>>()
        };
        assert_eq!(
            boxes(&found),
            [(18.0, 6.0, 1.0, 4.0, 5.0), (0.0, 0.0, 6.0, 4.0, 2.0)],
            "corners join, one cell is too small"
        );
        blobs.score = Score::Mass;
        blobs.find(&map, 0.5, Size::new(19, 10), &mut found);
        assert_eq!(boxes(&found)[0].4, 32.0);
        blobs.min_area = 0;
        blobs.find(&map, 0.5, Size::new(19, 10), &mut found);
        assert_eq!(boxes(&found)[0], (10.0, 8.0, 2.0, 2.0, 36.0));
    }
}
