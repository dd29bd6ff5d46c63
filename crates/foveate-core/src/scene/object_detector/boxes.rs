//! Boxes out of the numbers that a detector gives.

use super::Layout;
use crate::geometry::BBox;
use crate::scene::Detection;

/// How to read an output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    layout: Layout,
    boxes: usize,
    /// Numbers a box.
    numbers: usize,
}

impl Reading {
    /// The layout of an output with this shape. Fails with the expected shape.
    pub(super) fn new(layout: Layout, output: &[usize]) -> Result<Self, &'static str> {
        let [1, a, b] = *output else { return Err("expected (1, 4 + classes, boxes) or (1, boxes, 5 + classes)") };
        let wanted = |ok: bool, reading: Self, what| if ok { Ok(reading) } else { Err(what) };
        let reading = |layout, boxes, numbers| Self { layout, boxes, numbers };
        match layout {
            Layout::Auto if a < b => Self::new(Layout::Yolov8, output),
            Layout::Auto if b == 6 => Err(
                "that may be yolov5 of one class or end-to-end: choose with detector.layout (of --detect: --layout)",
            ),
            Layout::Auto if a > b => Self::new(Layout::Yolov5, output),
            Layout::Auto => Err("two equal sides: name the layout with detector.layout (of --detect: --layout)"),
            Layout::Yolov8 => {
                wanted(a >= 5, reading(layout, b, a), "expected (1, 4 + classes, boxes) of 1 class at least")
            }
            Layout::Yolov5 => {
                wanted(b >= 6, reading(layout, a, b), "expected (1, boxes, 5 + classes) of 1 class at least")
            }
            Layout::EndToEnd => wanted(b == 6, reading(layout, a, b), "expected (1, boxes, 6)"),
        }
    }

    /// The number of classes, if the output determines it.
    pub(super) fn classes(&self) -> Option<usize> {
        match self.layout {
            Layout::Yolov5 => Some(self.numbers - 5),
            Layout::EndToEnd => None,
            Layout::Auto | Layout::Yolov8 => Some(self.numbers - 4),
        }
    }

    /// Calls `take` with left, top, right, bottom, score and class of every box of a score of at least `least`, above 0. Of equal
    /// scores the first class counts.
    pub(super) fn each(&self, output: &[f32], least: f64, mut take: impl FnMut([f64; 4], f64, usize)) {
        let number = |k: usize, i: usize| match self.layout {
            Layout::Auto | Layout::Yolov8 => output[i * self.boxes + k],
            Layout::Yolov5 | Layout::EndToEnd => output[k * self.numbers + i],
        };
        for k in 0..self.boxes {
            let at = |i: usize| f64::from(number(k, i));
            let best = |from: usize| {
                let classes = (from..self.numbers).map(|i| (i - from, at(i)));
                classes.fold((0, f64::NEG_INFINITY), |best, class| if class.1 > best.1 { class } else { best })
            };
            let (class, score) = match self.layout {
                Layout::EndToEnd => (at(5).max(0.0).round() as usize, at(4)),
                Layout::Yolov5 => {
                    let (class, score) = best(5);
                    (class, score * at(4))
                }
                Layout::Auto | Layout::Yolov8 => best(4),
            };
            if !(score > 0.0 && score >= least && score.is_finite()) {
                continue;
            }
            let corners = match self.layout {
                Layout::EndToEnd => [0, 1, 2, 3].map(at),
                _ => {
                    let [x, y, w, h] = [0, 1, 2, 3].map(at);
                    [x - w / 2.0, y - h / 2.0, x + w / 2.0, y + h / 2.0]
                }
            };
            take(corners, score, class);
        }
    }
}

/// Leaves the best boxes, best first: none overlaps a better one by an intersection over union above `overlap`, and there are `most` at
/// most.
pub(super) fn suppress(found: &mut Vec<Detection>, overlap: f64, most: usize) {
    found.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable: among equals the order of the network
    let mut kept = 0;
    for i in 0..found.len() {
        let apart = |other: &BBox| other.iou(&found[i].bbox) <= overlap;
        if kept < most && found[..kept].iter().all(|better| apart(&better.bbox)) {
            found[kept] = found[i];
            kept += 1;
        }
    }
    found.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    type Row = ([f64; 4], f64, usize);

    fn rows(layout: Layout, sides: &[usize], output: &[f32]) -> Vec<Row> {
        let mut rows = vec![];
        let reading = Reading::new(layout, sides).expect("sides that fit");
        reading.each(output, 0.25, |corners, score, class| rows.push((corners, score, class)));
        rows
    }

    /// The same three boxes, of which the second scores too low, in each layout.
    #[test]
    fn layouts_say_the_same() {
        let wanted = vec![([10.0, 20.0, 30.0, 60.0], 0.75, 1), ([-1.0, 0.0, 3.0, 2.0], 0.5, 0)];
        let across = [20.0, 40.0, 20.0, 40.0, 0.5, 0.75, 5.0, 5.0, 2.0, 2.0, 0.125, 0.0, 1.0, 1.0, 4.0, 2.0, 0.5, 0.25];
        let down: Vec<f32> = (0..18).map(|i| across[i % 3 * 6 + i / 3]).collect();
        assert_eq!(rows(Layout::Yolov8, &[1, 6, 3], &down), wanted);
        let object = [
            20.0, 40.0, 20.0, 40.0, 0.75, 0.5, 1.0, 5.0, 5.0, 2.0, 2.0, 0.25, 0.5, 0.5, 1.0, 1.0, 4.0, 2.0, 1.0, 0.5,
            0.5,
        ];
        assert_eq!(rows(Layout::Yolov5, &[1, 3, 7], &object), wanted);
        let corners =
            [10.0, 20.0, 30.0, 60.0, 0.75, 1.0, 4.0, 4.0, 6.0, 6.0, 0.125, 0.0, -1.0, 0.0, 3.0, 2.0, 0.5, 0.0];
        assert_eq!(rows(Layout::EndToEnd, &[1, 3, 6], &corners), wanted);
        let nothing = [f32::NAN, f32::INFINITY, -1.0, 0.0].map(|score| [1.0, 1.0, 1.0, 1.0, score, 0.0]).concat();
        let reading = Reading::new(Layout::EndToEnd, &[1, 4, 6]).expect("sides that fit");
        reading.each(&nothing, 0.0, |_, _, _| panic!("no score is a score"));
    }

    #[test]
    fn layouts_are_known_by_their_sides() {
        let layout = |sides: &[usize]| Reading::new(Layout::Auto, sides).map(|r| (r.layout, r.boxes, r.classes()));
        assert_eq!(layout(&[1, 84, 8400]), Ok((Layout::Yolov8, 8400, Some(80))));
        assert_eq!(layout(&[1, 25200, 85]), Ok((Layout::Yolov5, 25200, Some(80))));
        for odd in [&[1, 300, 6][..], &[1, 9, 9], &[2, 84, 8400], &[84, 8400], &[1, 4, 8400], &[1, 8400, 5], &[]] {
            assert!(layout(odd).is_err(), "{odd:?}");
        }
        assert!(Reading::new(Layout::EndToEnd, &[1, 300, 7]).is_err());
    }

    #[test]
    fn of_boxes_that_overlap_the_best_stays() {
        let at = |x: f64, score: f64| Detection::new(BBox { x, y: 0.0, w: 10.0, h: 10.0 }, score);
        let all = vec![at(40.0, 0.3), at(1.0, 0.8), at(0.0, 0.9), at(5.0, 0.7), at(3.0, 0.6)];
        let left = |overlap: f64, most: usize| {
            let mut found = all.clone();
            suppress(&mut found, overlap, most);
            found.iter().map(|d| d.bbox.x).collect::<Vec<_>>()
        };
        assert_eq!(left(0.45, 9), [0.0, 5.0, 40.0], "9/11 is too much, 5/15 is not, 8/12 of the second is");
        assert_eq!(left(0.0, 9), [0.0, 40.0]);
        assert_eq!(left(1.0, 9), [0.0, 1.0, 5.0, 3.0, 40.0]);
        assert_eq!(left(0.45, 2), [0.0, 5.0]);
    }
}
