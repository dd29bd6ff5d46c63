//! Assignment of detections to targets, one to one, by overlap, motion and appearance.

use super::groups::{Fit, best};
use super::settings::Settings;
use crate::engine::Claim;
use crate::geometry::BBox;
use crate::scene::Detection;

/// The prediction of a target in this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Expected {
    pub bbox: BBox,
    /// Variance of its centre along x and y, pixels².
    pub variance: (f64, f64),
    /// Whether it has had no detection lately, so that its box is a guess.
    pub guess: bool,
}

impl Expected {
    /// Returns the density of its place, no sharper than the accuracy of boxes.
    pub(super) fn claim(&self) -> Claim {
        let BBox { w, h, .. } = self.bbox;
        Claim { centre: self.bbox.centre(), variance: (off(self.variance.0, w), off(self.variance.1, h)) }
    }
}

/// Adds the variance of box centres along a side to a variance of place.
fn off(variance: f64, side: f64) -> f64 {
    variance + (OFF * side / 2.0).powi(2)
}

/// Standard deviation of a detector's centre, as a fraction of half the box.
const OFF: f64 = 0.25;

/// Returns the score of a detection for a target by place alone, 0 to 1; `None` beyond the gate.
pub(super) fn by_place(expected: &Expected, detection: &BBox, s: &Settings) -> Option<f64> {
    let BBox { w, h, .. } = expected.bbox;
    let ((x, y), (cx, cy)) = (detection.centre(), expected.bbox.centre());
    let (dx, dy) = (x - cx, y - cy);
    let far = (2.0 * dx / w).hypot(2.0 * dy / h) > s.gate;
    if far || (detection.w * detection.h / (w * h)).ln().abs() / 2.0 > s.size.ln() {
        return None;
    }
    let mahalanobis = dx * dx / off(expected.variance.0, w) + dy * dy / off(expected.variance.1, h);
    Some((expected.bbox.iou(detection) + (-mahalanobis / 2.0).exp()) / 2.0)
}

/// Returns whether a detection is a valid box.
pub(super) fn is_box(b: &BBox) -> bool {
    let sane = |side: f64| (1.0..=1e6).contains(&side);
    b.x.abs() <= 1e6 && b.y.abs() <= 1e6 && sane(b.w) && sane(b.h)
}

/// Returns whether a detection merges several targets into one box: it contains most of each of two or more, and is larger than each.
pub(super) fn holds_several(detection: &BBox, expected: &[Expected]) -> bool {
    let area = |b: &BBox| b.w * b.h;
    let held = |e: &&Expected| {
        detection.intersection(&e.bbox) > MOST * area(&e.bbox) && area(detection) > LARGER * area(&e.bbox)
    };
    expected.iter().filter(held).count() > 1
}

/// Fraction of a target's box that counts as most of it, and least ratio of the areas of a merged box and a target's box.
const MOST: f64 = 0.6;
const LARGER: f64 = 1.4;

/// The targets and detections of each stage: (guess, weak).
const STAGES: [(bool, bool); 3] = [(false, false), (true, false), (false, true)];

/// Returns the detection of each target, by index; `None` if it has none. Targets that were detected lately take strong detections first,
/// then targets whose boxes are guesses (the cascade of DeepSORT); weak detections are left to the former (the second stage of ByteTrack).
pub(super) fn in_stages(
    expected: &[Expected],
    detections: &[Detection],
    weak: &dyn Fn(&Detection) -> bool,
    s: &Settings,
    similarity: &mut dyn FnMut(usize, usize) -> Option<f64>,
) -> Vec<Option<usize>> {
    let (mut given, mut taken) = (vec![None; expected.len()], vec![false; detections.len()]);
    for (guess, of_weak) in STAGES {
        let rows: Vec<usize> =
            (0..expected.len()).filter(|i| given[*i].is_none() && expected[*i].guess == guess).collect();
        let columns: Vec<usize> =
            (0..detections.len()).filter(|j| !taken[*j] && weak(&detections[*j]) == of_weak).collect();
        if rows.is_empty() || columns.is_empty() {
            continue;
        }
        let targets: Vec<Expected> = rows.iter().map(|i| expected[*i]).collect();
        let found: Vec<Detection> = columns.iter().map(|j| detections[*j]).collect();
        let of_stage = pairs(&targets, &found, s, &mut |i, j| similarity(rows[i], columns[j]));
        for (i, j) in rows.iter().zip(of_stage) {
            given[*i] = j.map(|j| columns[j]);
            given[*i].into_iter().for_each(|j| taken[j] = true);
        }
    }
    given
}

/// Returns the detection of each target, by index; `None` if it has none. A target takes its only detection if no other target claims it.
/// If several claim the same, `similarity(target, detection)`, 0 to 1, adds to the score if it is available.
fn pairs(
    expected: &[Expected],
    detections: &[Detection],
    s: &Settings,
    similarity: &mut dyn FnMut(usize, usize) -> Option<f64>,
) -> Vec<Option<usize>> {
    let (rows, columns) = (expected.len(), detections.len());
    let by_place = |e: &Expected, j: usize| by_place(e, &detections[j].bbox, s).filter(|score| *score > 0.0);
    // From left to right, so that a crowd's target meets those alone that are beside it.
    let centre = |j: usize| detections[j].bbox.centre().0;
    let mut across: Vec<usize> = (0..columns).collect();
    across.sort_by(|a, b| centre(*a).total_cmp(&centre(*b)));
    let (mut fits, mut beside) = (vec![], vec![]);
    for (i, e) in expected.iter().enumerate() {
        let (x, reach) = (e.bbox.centre().0, 0.5 * e.bbox.w * s.gate + 1e-6);
        let first = across.partition_point(|j| centre(*j) < x - reach);
        beside.clear();
        beside.extend(across[first..].iter().take_while(|j| centre(**j) <= x + reach));
        beside.sort_unstable();
        fits.extend(beside.iter().filter_map(|j| Some(Fit { i, j: *j, score: by_place(e, *j)? })));
    }
    let (mut claims, mut claimed) = (vec![0; rows], vec![0; columns]);
    fits.iter().for_each(|fit| (claims[fit.i], claimed[fit.j]) = (claims[fit.i] + 1, claimed[fit.j] + 1));
    for Fit { i, j, score } in &mut fits {
        if claims[*i] > 1 || claimed[*j] > 1 {
            *score += s.looks * similarity(*i, *j).map_or(0.0, |similarity| similarity - *score);
        }
    }
    fits.retain(|fit| fit.score >= s.score && fit.score > 0.0);
    best(&fits, rows, columns)
}

/// Keeps the detections, and their indices, for which `keep` holds for index and detection.
pub(super) fn retain_both(
    detections: &mut Vec<Detection>,
    numbers: &mut Vec<usize>,
    keep: impl Fn(usize, &Detection) -> bool,
) {
    let mut kept = 0;
    for j in 0..detections.len() {
        if keep(j, &detections[j]) {
            (detections[kept], numbers[kept]) = (detections[j], numbers[j]);
            kept += 1;
        }
    }
    detections.truncate(kept);
    numbers.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> BBox {
        BBox { x, y: 10.0, w: 20.0, h: 40.0 }
    }

    fn expected(x: f64) -> Expected {
        Expected { bbox: at(x), variance: (4.0, 4.0), guess: false }
    }

    fn found(x: f64) -> Detection {
        Detection::new(at(x), 1.0)
    }

    #[test]
    fn near_detections_are_assigned_and_far_ones_are_not() {
        let s = Settings::default();
        let mut never = |_: usize, _: usize| -> Option<f64> { panic!("nothing is contested") };
        let given =
            pairs(&[expected(0.0), expected(100.0), expected(200.0)], &[found(103.0), found(2.0)], &s, &mut never);
        assert_eq!(given, [Some(1), Some(0), None]);
        assert_eq!(pairs(&[], &[found(1.0)], &s, &mut never), []);
        assert_eq!(pairs(&[expected(1.0)], &[], &s, &mut never), [None]);
        let large = Detection::new(BBox { x: -30.0, y: -30.0, w: 80.0, h: 120.0 }, 1.0);
        assert_eq!(pairs(&[expected(0.0)], &[large], &s, &mut never), [None], "of another size");
    }

    /// By place, the score is the mean of the IoU and of the Gaussian density relative to its maximum: boxes of 20 x 40 with variances of 4
    /// and 9 pixels², and detections of a standard deviation of a quarter of half a side. Beyond the gate, in half boxes, there is none.
    #[test]
    fn the_score_of_place_is_that_of_overlap_and_distance() {
        let s = Settings { gate: 2.0, ..Settings::default() };
        let target = Expected { variance: (4.0, 9.0), ..expected(100.0) };
        let score = |dx: f64, dy: f64| by_place(&target, &BBox { x: 100.0 + dx, y: 10.0 + dy, w: 20.0, h: 40.0 }, &s);
        for (dx, dy) in [(0.0, 0.0), (3.0, -5.0), (-7.0, 2.0), (15.0, 0.0), (0.0, 30.0)] {
            let shared = (20.0 - f64::abs(dx)) * (40.0 - f64::abs(dy));
            let distance = dx * dx / (4.0 + 2.5 * 2.5) + dy * dy / (9.0 + 5.0 * 5.0);
            let wanted = 0.5 * (shared / (1600.0 - shared) + (-0.5 * distance).exp());
            assert!(score(dx, dy).is_some_and(|score| (score - wanted).abs() < 1e-12), "{dx} {dy}");
        }
        assert!(score(19.0, 0.0).is_some() && score(21.0, 0.0).is_none());
        assert!(score(0.0, 39.0).is_some() && score(0.0, -41.0).is_none());
        assert!(score(15.0, 30.0).is_none(), "farther than the gate along a diagonal");
    }

    /// The size of a detection is the square root of its area: it may differ by the factor `size`, whatever the shape.
    #[test]
    fn the_gate_of_size_is_a_ratio() {
        let s = Settings { size: 1.5, ..Settings::default() };
        let fits = |w: f64, h: f64| by_place(&expected(0.0), &BBox::around(10.0, 30.0, w, h), &s).is_some();
        assert!(fits(20.0 * 1.4, 40.0 * 1.4) && fits(20.0 / 1.4, 40.0 / 1.4) && fits(40.0, 40.0));
        assert!(!fits(20.0 * 1.6, 40.0 * 1.6) && !fits(20.0 / 1.6, 40.0 / 1.6) && !fits(50.0, 40.0));
    }

    #[test]
    fn damaged_detections_are_no_boxes() {
        let sane = at(5.0);
        assert!(is_box(&sane) && is_box(&BBox { x: -1e6, y: 1e6, w: 1.0, h: 1e6 }));
        for wrong in [
            BBox { x: -2e6, ..sane },
            BBox { y: 2e6, ..sane },
            BBox { w: 0.5, ..sane },
            BBox { h: 2e6, ..sane },
            BBox { x: f64::NAN, ..sane },
        ] {
            assert!(!is_box(&wrong), "{wrong:?}");
        }
    }

    #[test]
    fn detected_targets_come_first_and_weak_detections_last() {
        let s = Settings::default();
        let mut unknown = |_: usize, _: usize| None;
        let guess = |x: f64| Expected { guess: true, ..expected(x) };
        let scored = |x: f64, score: f64| Detection { score, ..found(x) };
        let mut stages =
            |targets: &[Expected], found: &[Detection]| in_stages(targets, found, &|d| d.score < 0.5, &s, &mut unknown);
        // The guess is nearer, but the other was detected lately; alone, the guess takes the detection.
        assert_eq!(stages(&[guess(0.0), expected(4.0)], &[scored(1.0, 1.0)]), [None, Some(0)]);
        assert_eq!(stages(&[guess(0.0)], &[scored(1.0, 1.0)]), [Some(0)]);
        // A strong detection is taken before a nearer weak one, which no guess may take.
        assert_eq!(stages(&[expected(0.0)], &[scored(0.0, 0.1), scored(4.0, 0.9)]), [Some(1)]);
        assert_eq!(stages(&[expected(0.0)], &[scored(0.0, 0.1)]), [Some(0)]);
        assert_eq!(stages(&[guess(0.0)], &[scored(0.0, 0.1)]), [None]);
    }

    #[test]
    fn appearance_decides_between_near_targets() {
        let s = Settings { looks: 0.8, ..Settings::default() };
        // By place the first is nearer to the first; by appearance they have swapped places.
        let mut similarity = |i: usize, j: usize| Some(if i == j { 0.1 } else { 0.9 });
        let (targets, detections) = ([expected(0.0), expected(6.0)], [found(2.0), found(4.0)]);
        assert_eq!(pairs(&targets, &detections, &s, &mut similarity), [Some(1), Some(0)]);
        // Without a weight of appearance, place decides.
        let place = Settings { looks: 0.0, ..s };
        assert_eq!(pairs(&targets, &detections, &place, &mut similarity), [Some(0), Some(1)]);
        // Two targets that claim one detection: it is that of the similar one, not of the nearer one.
        let mut similarity = |i: usize, _: usize| Some(if i == 0 { 0.1 } else { 0.9 });
        assert_eq!(pairs(&targets, &[found(2.0)], &s, &mut similarity), [None, Some(0)]);
        // Only one of two detections is claimed by another target, too.
        let mut similarity = |_: usize, j: usize| Some(if j == 0 { 0.1 } else { 0.9 });
        assert_eq!(pairs(&targets[..1], &detections, &s, &mut similarity), [Some(1)]);
    }
}
