//! Calibration of P(lost), delay and false alarms of the reported status, coverage of credible regions.
//!
//! A target is *lost* if its box has an IoU below [`LOST`] with it, or it is not visible. The tracker *reports* a loss if its status is
//! occluded or lost.

use serde::{Deserialize, Serialize};

use super::catalogue::Origin;
use super::experiment::quantile;
use super::reliability::{Bin, reliability};
use super::table::aligned;
use foveate_base::Result;
use foveate_core::Seen;
use foveate_core::control::{ConfidenceModel, Cues, LossMonitor, PlaceEvidence, Status};
use foveate_core::geometry::BBox;
use foveate_core::seen::credible;
use foveate_report::Observer;
use foveate_video::Frame;

pub use foveate_core::control::LOST;
/// Minimum length of a loss that counts as an episode, frames.
pub const EPISODE: usize = 5;
/// Number of bins of the reliability curve.
const BINS: usize = 10;
/// False alarms per 1000 frames on the target at which [`ConfidenceScore::reported_at`] is measured.
pub const ALARMS: usize = 40;
/// Probabilities of the evaluated credible regions.
pub const REGIONS: [f64; 2] = [0.5, 0.9];

/// A tracker's report in one frame, beside the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// The reported P(lost).
    pub p_lost: f64,
    /// The reported status.
    pub status: Status,
    /// The features that P(lost) is computed from.
    pub cues: Cues,
    /// IoU with the target; 0 if it is not visible.
    pub iou: f64,
    /// The true centre minus the estimate, in template units; `None` if the target is not visible.
    pub off: Option<[f64; 2]>,
    /// The reported covariance of the place, in template units: xx, xy, yy.
    pub covariance: [f64; 3],
    /// Its inputs.
    pub place: PlaceEvidence,
}

/// One tracker on one video.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// The video's name.
    pub video: String,
    /// Its origin: tracks of one half, or of one source, are left out together.
    pub origin: Origin,
    /// Whether an occlusion was inserted.
    pub occluded: bool,
    /// Reports from the second frame on.
    pub frames: Vec<Judged>,
}

impl Judged {
    /// Compares an estimate with the truth.
    pub fn of(seen: &Seen<'_>, truth: Option<BBox>) -> Self {
        let (unit, c) = (seen.unit(), &seen.covariance);
        let off = truth.map(|truth| {
            let (there, here) = (truth.centre(), seen.bbox.centre());
            [(there.0 - here.0) / unit, (there.1 - here.1) / unit]
        });
        let area = unit * unit;
        Self {
            p_lost: seen.p_lost,
            status: seen.status,
            cues: seen.cues,
            iou: truth.map_or(0.0, |truth| seen.bbox.iou(&truth)),
            off,
            covariance: [c[0][0] / area, c[0][1] / area, c[1][1] / area],
            place: seen.place,
        }
    }
    /// Returns whether the target is lost.
    pub fn lost(&self) -> bool {
        self.iou < LOST
    }
    /// Returns the same frame with the covariance of the place by another model.
    #[must_use]
    pub fn located(&self, model: &ConfidenceModel) -> Self {
        let area = (self.place.unit * self.place.unit).max(1e-12);
        let covariance = model.localisation.place(model.localisation_noise, &self.place).map(|c| c / area);
        Self { covariance, ..*self }
    }
    /// Returns the squared Mahalanobis distance of the truth, and the determinant of the covariance.
    pub(super) fn squares(&self) -> Option<(f64, f64)> {
        let ([dx, dy], [a, b, d]) = (self.off?, self.covariance);
        // At least a millionth of a unit: a belief of one particle has no covariance.
        let (a, d) = (a + 1e-12, d + 1e-12);
        let determinant = (a * d - b * b).max(1e-24);
        Some(((d * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant, determinant))
    }
}

/// Records every frame of a run beside the truth.
#[derive(Debug)]
pub struct Recorder<'a> {
    truth: &'a [Option<BBox>],
    /// Reports from the second frame on.
    pub frames: Vec<Judged>,
    /// Number of values read in all frames, and the sum of their fractions of a picture.
    read: [f64; 2],
}

impl<'a> Recorder<'a> {
    /// Creates a recorder for a video with this truth.
    pub fn of(truth: &'a [Option<BBox>]) -> Self {
        Self { truth, frames: vec![], read: [0.0; 2] }
    }
    /// Returns the mean number of values read per frame, and its fraction of a picture; `None` before the first frame.
    pub fn read(&self) -> Option<[f64; 2]> {
        let n = self.frames.len();
        (n > 0).then(|| self.read.map(|sum| sum / n as f64))
    }
}

impl Observer for Recorder<'_> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first().filter(|seen| !seen.is_given()) else { return Ok(()) };
        let truth = self.truth.get(frame.index).copied().flatten();
        self.frames.push(Judged::of(seen, truth));
        self.read = [self.read[0] + seen.values as f64, self.read[1] + seen.share_read()];
        Ok(())
    }
}

/// The scores of many tracks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConfidenceScore {
    /// Number of frames.
    pub frames: usize,
    /// Number of frames in which the target was lost.
    pub lost: usize,
    /// By P(lost), ten bins of equal width: count, mean P(lost) and fraction lost.
    pub bins: Vec<Bin>,
    /// Expected calibration error: mean distance between P(lost) and the fraction lost of a bin, weighted by count.
    pub ece: f64,
    /// Mean of (P(lost) − truth)².
    pub brier: f64,
    /// The Brier score of the base rate: of always reporting the fraction of lost frames.
    pub brier_of_base_rate: f64,
    /// The probability that a lost frame has a greater P(lost) than a frame on the target; `None` without both.
    pub roc: Option<f64>,
    /// Fraction of the lost frames that are reported as occluded or lost.
    pub reported: Option<f64>,
    /// Frames on the target that are reported as occluded or lost, per 1000 frames on it.
    pub false_alarms: Option<f64>,
    /// Fraction of the lost frames with P(lost) above a threshold that [`ALARMS`] of 1000 frames on the target exceed.
    pub reported_at: Option<f64>,
    /// Number of losses of five frames or more.
    pub episodes: usize,
    /// Number of these that were reported before they ended.
    pub detected: usize,
    /// Frames from a loss to its report, for detected losses: median and 90 % quantile.
    pub delay: Option<[f64; 2]>,
    /// Fraction of frames on the target with the truth in the 50 % and the 90 % region.
    pub coverage: Option<[f64; 2]>,
}

impl ConfidenceScore {
    /// Scores tracks, each in the order of its frames.
    pub fn of(tracks: &[&[Judged]]) -> Self {
        let all: Vec<&Judged> = tracks.iter().copied().flatten().collect();
        let (on, off): (Vec<&Judged>, Vec<&Judged>) = all.iter().partition(|j| !j.lost());
        let share = |part: usize, of: usize| (of > 0).then(|| part as f64 / of as f64);
        let out = |such: &[&Judged]| such.iter().filter(|j| !j.status.is_usable()).count();
        let pairs: Vec<(f64, bool)> = all.iter().map(|j| (j.p_lost, j.lost())).collect();
        let (bins, ece) = reliability(&pairs, BINS);
        let n = all.len().max(1) as f64;
        let rate = off.len() as f64 / n;
        let delays: Vec<Option<usize>> = tracks.iter().flat_map(|track| delays(track)).collect();
        let detected: Vec<f64> = delays.iter().flatten().map(|d| *d as f64).collect();
        let coverage = (!on.is_empty()).then(|| REGIONS.map(|p| coverage(on.iter().copied().copied(), p)));
        Self {
            frames: all.len(),
            lost: off.len(),
            bins,
            ece,
            brier: pairs.iter().map(|(p, lost)| (p - f64::from(u8::from(*lost))).powi(2)).sum::<f64>() / n,
            brier_of_base_rate: rate * (1.0 - rate),
            roc: roc(&pairs),
            reported: share(out(&off), off.len()),
            false_alarms: share(out(&on), on.len()).map(|s| 1000.0 * s),
            reported_at: reported_at(&on, &off),
            episodes: delays.len(),
            detected: detected.len(),
            delay: (!detected.is_empty()).then(|| [0.5, 0.9].map(|q| quantile(&detected, q))),
            coverage,
        }
    }
    /// Returns the fraction of lost frames among those with P(lost) below 0.1; `None` without such a frame.
    pub fn lost_below_tenth(&self) -> Option<f64> {
        self.bins.first().filter(|bin| bin.count > 0).map(|bin| bin.accuracy)
    }
    /// Returns a track with the reports of another model, for unchanged boxes and cues: different searches are not simulated.
    pub fn rejudged(track: &[Judged], model: &ConfidenceModel) -> Vec<Judged> {
        let mut monitor = LossMonitor::new(model.clone());
        let again = |j: &Judged| {
            let confidence = monitor.rejudge(&j.cues);
            Judged { p_lost: confidence.p_lost, status: confidence.status, ..j.located(model) }
        };
        track.iter().map(again).collect()
    }
}

/// Computes the fraction of lost frames with P(lost) above the smallest threshold that at most [`ALARMS`] of 1000 frames on the target
/// exceed; `None` without both.
fn reported_at(on: &[&Judged], off: &[&Judged]) -> Option<f64> {
    let mut p: Vec<f64> = on.iter().map(|j| j.p_lost).collect();
    p.sort_by(|a, b| b.total_cmp(a));
    let threshold = *p.get(p.len() * ALARMS / 1000)?;
    (!off.is_empty()).then(|| off.iter().filter(|j| j.p_lost > threshold).count() as f64 / off.len() as f64)
}

/// Computes the area under the ROC curve, by ranks; ties count half.
fn roc(pairs: &[(f64, bool)]) -> Option<f64> {
    let mut sorted = pairs.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let lost = sorted.iter().filter(|p| p.1).count() as f64;
    let on = sorted.len() as f64 - lost;
    let (mut below, mut won) = (0.0, 0.0);
    for tie in sorted.chunk_by(|a, b| a.0 == b.0) {
        let such = tie.iter().filter(|p| p.1).count() as f64;
        let others = tie.len() as f64 - such;
        won += such * (below + 0.5 * others);
        below += others;
    }
    (lost > 0.0 && on > 0.0).then(|| won / (lost * on))
}

/// Returns the frames until each episode of a track was reported; `None` if it ended before.
fn delays(track: &[Judged]) -> Vec<Option<usize>> {
    let runs = track.chunk_by(|a, b| a.lost() == b.lost()).filter(|run| run[0].lost() && run.len() >= EPISODE);
    runs.map(|run| run.iter().position(|j| !j.status.is_usable())).collect()
}

/// Returns the fraction of frames with the truth in the credible ellipse of probability p.
pub(super) fn coverage(frames: impl Iterator<Item = Judged>, p: f64) -> f64 {
    let (mut inside, mut all) = (0.0, 0.0);
    for (squares, _) in frames.filter_map(|j| j.squares()) {
        inside += f64::from(u8::from(squares <= credible(p)));
        all += 1.0;
    }
    inside / f64::max(all, 1.0)
}

/// Formats the scores as text.
pub fn text(score: &ConfidenceScore) -> String {
    let s = score;
    let or = |v: Option<String>| v.unwrap_or_else(|| "-".into());
    let known = |v: String| if s.frames > 0 { v } else { "-".into() };
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    let rows = [
        ("frames, lost", format!("{}, {}", s.frames, s.lost)),
        ("calibration error of P(lost)", known(format!("{:.4}", s.ece))),
        ("Brier score (of the base rate)", known(format!("{:.4} ({:.4})", s.brier, s.brier_of_base_rate))),
        ("area under ROC", or(s.roc.map(|r| format!("{r:.3}")))),
        ("lost where P(lost) is below 10 %", or(s.lost_below_tenth().map(percent))),
        ("lost frames reported", or(s.reported.map(percent))),
        ("false alarms per 1000 frames", or(s.false_alarms.map(|f| format!("{f:.1}")))),
        ("lost frames reported at 40 false alarms per 1000, by P(lost)", or(s.reported_at.map(percent))),
        ("losses detected", format!("{} of {}", s.detected, s.episodes)),
        ("detection delay in frames, median, 90 %", or(s.delay.map(|d| format!("{:.0}, {:.0}", d[0], d[1])))),
        ("truth in 50 / 90 % region", or(s.coverage.map(|c| c.map(percent).join(" / ")))),
    ];
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(name, value)| vec![name.to_string(), value]).collect();
    let mut bins = vec![["P(lost)", "frames", "mean", "lost"].map(String::from).to_vec()];
    for (i, b) in s.bins.iter().enumerate().filter(|(_, b)| b.count > 0) {
        let (low, high) = (i as f64 / BINS as f64, (i + 1) as f64 / BINS as f64);
        let mean = format!("{:.3}", b.confidence);
        bins.push(vec![format!("{low:.1} to {high:.1}"), b.count.to_string(), mean, percent(b.accuracy)]);
    }
    format!("{}\n{}", aligned(&rows), aligned(&bins))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    fn judged(p_lost: f64, iou: f64, status: Status) -> Judged {
        Judged {
            p_lost,
            status,
            cues: Cues::default(),
            iou,
            off: Some([0.0, 0.0]),
            covariance: [1.0, 0.0, 1.0],
            place: PlaceEvidence { unit: 1.0, ..PlaceEvidence::default() },
        }
    }

    #[test]
    fn a_track_by_hand() {
        let (tracking, out) = (Status::Tracking, Status::Occluded);
        let mut track = vec![judged(0.05, 0.8, tracking); 10];
        track[3].status = out;
        track.extend([judged(0.05, 0.0, tracking); 2]);
        track.extend([judged(0.95, 0.0, out); 4]);
        track.extend([judged(0.05, 0.5, tracking); 4]);
        track.extend([judged(0.95, 0.0, tracking); 4]); // too short for an episode
        let s = ConfidenceScore::of(&[&track]);
        assert_eq!((s.frames, s.lost, s.episodes, s.detected), (24, 10, 1, 1));
        assert_eq!((s.delay, s.reported), (Some([2.0, 2.0]), Some(0.4)));
        assert!((s.false_alarms.expect("on the target") - 1000.0 / 14.0).abs() < 1e-9);
        // 16 frames at 0.05, of which 2 are lost; 8 at 0.95, all lost.
        assert!((s.ece - (16.0 * (0.125 - 0.05) + 8.0 * 0.05) / 24.0).abs() < 1e-12);
        assert!((s.brier - (22.0 * 0.05f64.powi(2) + 2.0 * 0.95f64.powi(2)) / 24.0).abs() < 1e-12);
        // At most 0 of 14 frames on the target may exceed the threshold, so it is 0.05; 8 of 10 lost frames do.
        assert_eq!(s.reported_at, Some(0.8));
        // Of 140 pairs, 112 in order and 28 tied.
        assert!((s.roc.expect("both") - (112.0 + 14.0) / 140.0).abs() < 1e-12);
        assert!(text(&s).contains("1 of 1") && ConfidenceScore::of(&[]).roc.is_none());
        assert!(!text(&ConfidenceScore::of(&[])).contains("0.0"), "no frame tells nothing");
    }

    /// 4000 errors of the distribution whose regions are reported: the fraction within the 90 % region has a standard deviation of 0.005; a
    /// correct program exceeds five of them once in a million.
    #[test]
    fn regions_of_correct_beliefs_have_their_coverage() {
        let mut rng = Streams::new(11, 0).rng(0);
        let mut frame = |_| {
            let (r, turn) = (credible(rng.random::<f64>()).sqrt(), std::f64::consts::TAU * rng.random::<f64>());
            let (a, b) = (r * turn.cos(), r * turn.sin());
            // x = 0.2 a, y = 0.1 a + 0.3 b; the covariance of a and b is 1.
            let off = Some([0.2 * a, 0.1 * a + 0.3 * b]);
            Judged { off, covariance: [0.04, 0.02, 0.1], ..judged(0.0, 1.0, Status::Tracking) }
        };
        let frames: Vec<Judged> = (0..4000).map(&mut frame).collect();
        let [half, most] = ConfidenceScore::of(&[&frames]).coverage.expect("frames");
        assert!((half - 0.5).abs() < 0.04 && (most - 0.9).abs() < 0.025, "{half} {most}");
    }
}
