//! The scores of one track in one-pass evaluation.

use serde::Serialize;

use super::curves::{Curves, QUOTED};
use foveate_base::text::counted;
use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;

/// The scores of one track; its names in JSON are short, as in OTB's literature.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Number of evaluated frames: those with a true box.
    pub frames: usize,
    /// Area under the success curve, 0 to 1.
    pub auc: f64,
    /// Fraction of frames with a centre error of at most 20 pixels, 0 to 1.
    pub p20: f64,
    /// Mean centre error, pixels; infinite if a frame has no box.
    #[serde(rename = "cle")]
    pub centre_error: f64,
    /// Standard deviation of the centre error over frames, pixels.
    #[serde(rename = "cle_std")]
    pub centre_error_sd: f64,
    /// Failures: frames with an IoU of 0.
    pub failures: usize,
    /// Percentage of failures.
    pub failure_pct: f64,
    /// Fraction of frames with an IoU above 0.5.
    pub sr50: f64,
    /// Frames per second, if times are known.
    pub fps: Option<f64>,
    /// Number of values read from a picture, mean over frames except the first, if known.
    pub values: Option<f64>,
    /// Percentage of the values of a picture that were read.
    pub read_pct: Option<f64>,
    /// Mean IoU of the box with the target's mask, if the sequence has masks.
    pub mask_iou: Option<f64>,
    /// Mean IoU of the box with the box around the mask.
    pub mask_box_iou: Option<f64>,
}

/// Scores a track against the truth, box by box (`None`: no box from the tracker, or an absent target).
///
/// As in the OTB toolkits the first frame counts, with the true box instead of the tracker's. Frames with absent truth or a truth without
/// area do not count. A frame without a box has overlap 0 and an infinite centre error. Only differences of coordinates matter, so both may
/// count from 0 or from 1.
///
/// # Errors
/// The lengths differ, or no frame counts.
pub fn score(boxes: &[Option<BBox>], truth: &[Option<BBox>]) -> Result<(Score, Curves)> {
    if boxes.len() != truth.len() {
        return Err(Error::Invalid(format!(
            "{} for {} of truth",
            counted(boxes.len(), "box"),
            counted(truth.len(), "frame")
        )));
    }
    let (mut overlaps, mut errors) = (Vec::new(), Vec::new());
    for (i, (found, truth)) in boxes.iter().zip(truth).enumerate() {
        let Some(truth) = truth.filter(|t| t.w > 0.0 && t.h > 0.0) else { continue };
        let found = if i == 0 { Some(truth) } else { *found };
        overlaps.push(found.map_or(0.0, |b| b.iou(&truth)));
        errors.push(found.map_or(f64::INFINITY, |b| centre_error(&b, &truth)));
    }
    let n = overlaps.len();
    if n == 0 {
        return Err(Error::Invalid("no frame has a true box to score against".into()));
    }
    let curves = Curves::of(&overlaps, &errors);
    let share = |count: usize| count as f64 / n as f64;
    let failures = overlaps.iter().filter(|&&o| o <= 0.0).count();
    let (centre_error, centre_error_sd) = mean_sd(&errors);
    let score = Score {
        frames: n,
        auc: curves.auc(),
        p20: curves.precision[QUOTED],
        centre_error,
        centre_error_sd,
        failures,
        failure_pct: 100.0 * share(failures),
        sr50: share(overlaps.iter().filter(|&&o| o > 0.5).count()),
        fps: None,
        values: None,
        read_pct: None,
        mask_iou: None,
        mask_box_iou: None,
    };
    Ok((score, curves))
}

impl Score {
    /// Adds the values read from a picture and their fraction of all values, if known.
    pub(super) fn counting(self, read: Option<[f64; 2]>) -> Self {
        Self { values: read.map(|r| r[0]), read_pct: read.map(|r| 100.0 * r[1]), ..self }
    }

    /// Adds the means of the overlaps with masks and with the boxes around them, if there are masks.
    pub(super) fn with_masks(self, ious: Option<[f64; 2]>) -> Self {
        Self { mask_iou: ious.map(|it| it[0]), mask_box_iou: ious.map(|it| it[1]), ..self }
    }

    /// Returns the mean over sequences, with equal weights; frames and failures are summed. `None` without one.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self>) -> Option<Self> {
        let all: Vec<_> = all.collect();
        let mean = |value: &dyn Fn(&Self) -> f64| all.iter().map(|s| value(s)).sum::<f64>() / all.len() as f64;
        let known = |value: &dyn Fn(&Self) -> Option<f64>| {
            let known: Vec<f64> = all.iter().filter_map(|s| value(s)).collect();
            (!known.is_empty()).then(|| mean_sd(&known).0)
        };
        (!all.is_empty()).then(|| Self {
            frames: all.iter().map(|s| s.frames).sum(),
            auc: mean(&|s| s.auc),
            p20: mean(&|s| s.p20),
            centre_error: mean(&|s| s.centre_error),
            centre_error_sd: mean(&|s| s.centre_error_sd),
            failures: all.iter().map(|s| s.failures).sum(),
            failure_pct: mean(&|s| s.failure_pct),
            sr50: mean(&|s| s.sr50),
            fps: known(&|s| s.fps),
            values: known(&|s| s.values),
            read_pct: known(&|s| s.read_pct),
            mask_iou: known(&|s| s.mask_iou),
            mask_box_iou: known(&|s| s.mask_box_iou),
        })
    }
}

/// Returns the frames per second from the seconds of each frame; the first frame, the start, does not count.
pub fn frames_per_second(seconds: &[f64]) -> Option<f64> {
    let tracked = seconds.get(1..).unwrap_or_default();
    let sum: f64 = tracked.iter().sum();
    (sum > 0.0).then(|| tracked.len() as f64 / sum)
}

/// Returns the distance of two centres in pixels.
pub fn centre_error(a: &BBox, b: &BBox) -> f64 {
    let (a, b) = (a.centre(), b.centre());
    let (dx, dy) = (a.0 - b.0, a.1 - b.1);
    (dx * dx + dy * dy).sqrt()
}

/// Returns the mean, and the standard deviation with n in the denominator, which is infinite if a value is.
pub fn mean_sd(values: &[f64]) -> (f64, f64) {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    if !mean.is_finite() {
        return (mean, f64::INFINITY);
    }
    (mean, (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn b(x: f64, y: f64, w: f64, h: f64) -> Option<BBox> {
        Some(BBox { x, y, w, h })
    }

    #[test]
    fn a_track_scored_by_hand() {
        // IoU 1 (frame 1 is given), 1/3 (half a box aside), 0 (far), then absent truth, then silence.
        let truth =
            [b(0.0, 0.0, 10.0, 10.0), b(0.0, 0.0, 10.0, 10.0), b(0.0, 0.0, 10.0, 10.0), None, b(5.0, 5.0, 10.0, 10.0)];
        let boxes =
            [b(99.0, 0.0, 1.0, 1.0), b(5.0, 0.0, 10.0, 10.0), b(30.0, 40.0, 10.0, 10.0), b(0.0, 0.0, 1.0, 1.0), None];
        let (s, _) = score(&boxes, &truth).expect("lengths agree");
        assert_eq!((s.frames, s.failures, s.failure_pct, s.sr50, s.p20), (4, 2, 50.0, 0.25, 0.5));
        assert!((s.auc - (20.0 + 7.0) / (4.0 * 21.0)).abs() < 1e-15); // above 20 thresholds, and 7
        assert_eq!(s.centre_error, f64::INFINITY);
        let (s, _) = score(&boxes[..3], &truth[..3]).expect("lengths agree");
        assert!((s.centre_error - 55.0 / 3.0).abs() < 1e-12);
        assert!(score(&boxes, &truth[1..]).is_err() && score(&[None], &[None]).is_err());
        assert_eq!(frames_per_second(&[9.0, 0.01, 0.03]), Some(50.0));
        assert_eq!((frames_per_second(&[1.0]), frames_per_second(&[])), (None, None));
    }

    #[test]
    fn the_mean_counts_sequences_alike() {
        let part = |auc, frames, fps| Score {
            frames,
            auc,
            p20: 0.5,
            centre_error: 1.0,
            centre_error_sd: 0.0,
            failures: 1,
            failure_pct: 1.0,
            sr50: 1.0,
            fps,
            values: fps,
            read_pct: None,
            mask_iou: fps,
            mask_box_iou: None,
        };
        let mean = Score::mean([part(0.2, 10, Some(30.0)), part(0.6, 90, None)].iter()).expect("two");
        assert!((mean.auc - 0.4).abs() < 1e-15);
        assert_eq!((mean.frames, mean.failures, mean.fps, mean.mask_iou), (100, 2, Some(30.0), Some(30.0)));
        assert_eq!(Score::mean([].into_iter()), None);
    }
}
