//! Re-detection after an inserted occlusion: the time until the target is re-acquired and until that is reported, and how often the tracker
//! follows another object.

use serde::{Deserialize, Serialize};

use foveate::lab::eval::confidence::{EPISODE, Judged};
use foveate::lab::eval::experiment::quantile;
use foveate::lab::eval::table::aligned;
use foveate::lab::hide::{Hide, WAYS, Way};

/// Number of frames after the return within which a target should be re-acquired.
pub(crate) const SOON: usize = 10;
/// Number of frames that are followed after the return.
pub(crate) const AFTER: usize = 45;
/// Minimum IoU of a box on the target.
pub(crate) const ON_TARGET: f64 = 0.3;

/// The outcome for one target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Case {
    /// Name of the sequence.
    pub sequence: String,
    /// The seed of the tracker and of the occlusion.
    pub seed: u64,
    /// Time and kind of the occlusion.
    pub hide: Hide,
    /// Whether the tracker was on the target in the frame before; otherwise the case does not count.
    pub tracked: bool,
    /// Frames until the loss was reported; `None` if it was not reported before the return.
    pub loss_reported: Option<usize>,
    /// Frames from the return until the box was on the target; `None` if it never was.
    pub reacquired: Option<usize>,
    /// Frames from the return until the box was on the target and reported so.
    pub reported: Option<usize>,
    /// Longest run of frames, after the loss was reported, in which another object was reported as the target.
    pub wrong: usize,
}

impl Case {
    /// Computes the case from a track of the clip (from the second frame on).
    pub(crate) fn of(sequence: &str, seed: u64, hide: Hide, track: &[Judged]) -> Self {
        // Frame t of the clip is track[t − 1].
        let at = |t: usize| track.get(t.wrapping_sub(1));
        let after = &track[(hide.until - 1).min(track.len())..];
        let out = (hide.from..track.len() + 1).find(|t| at(*t).is_some_and(|j| !j.status.is_usable()));
        let rest = out.map_or(&[][..], |t| &track[t - 1..]);
        let runs = rest.chunk_by(|a, b| wrong(a) == wrong(b)).filter(|run| wrong(&run[0]));
        Self {
            sequence: sequence.into(),
            seed,
            hide,
            tracked: at(hide.from - 1).is_some_and(|j| j.iou >= ON_TARGET),
            loss_reported: out.filter(|t| *t < hide.until).map(|t| t - hide.from),
            reacquired: after.iter().position(|j| j.iou >= ON_TARGET),
            reported: after.iter().position(|j| j.iou >= ON_TARGET && j.status.is_usable()),
            wrong: runs.map(<[Judged]>::len).max().unwrap_or(0),
        }
    }
    /// Returns whether another object was reported as the target.
    pub(crate) fn is_false(&self) -> bool {
        self.wrong >= EPISODE
    }
}

fn wrong(j: &Judged) -> bool {
    j.lost() && j.status.is_usable()
}

/// The statistics of many cases.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Line {
    /// The kind of occlusion; `None` for all together.
    pub way: Option<Way>,
    /// Cases that count: the target was tracked before.
    pub cases: usize,
    /// Cases in which the target was not tracked before.
    pub not_tracked: usize,
    /// Fraction of cases with the loss reported before the return.
    pub loss_reported: f64,
    /// Fraction re-acquired within ten frames, reported or not.
    pub reacquired: f64,
    /// Fraction re-acquired and reported within ten frames.
    pub reported: f64,
    /// Fraction re-acquired and reported within 45 frames.
    pub reported_ever: f64,
    /// Median number of frames to that report, of the reported cases.
    pub median: Option<f64>,
    /// Fraction in which another object was reported as the target, for five frames or more after the loss was reported.
    pub wrong: f64,
}

impl Line {
    /// Summarises the cases.
    pub(crate) fn of(way: Option<Way>, cases: &[&Case]) -> Self {
        let all: Vec<&&Case> = cases.iter().filter(|c| way.is_none_or(|way| c.hide.way == way)).collect();
        let tracked: Vec<&&&Case> = all.iter().filter(|c| c.tracked).collect();
        let share = |such: &dyn Fn(&Case) -> bool| {
            tracked.iter().filter(|c| such(c)).count() as f64 / tracked.len().max(1) as f64
        };
        let reported: Vec<f64> = tracked.iter().filter_map(|c| c.reported).map(|f| f as f64).collect();
        Self {
            way,
            cases: tracked.len(),
            not_tracked: all.len() - tracked.len(),
            loss_reported: share(&|c| c.loss_reported.is_some()),
            reacquired: share(&|c| c.reacquired.is_some_and(|f| f <= SOON)),
            reported: share(&|c| c.reported.is_some_and(|f| f <= SOON)),
            reported_ever: share(&|c| c.reported.is_some()),
            median: (!reported.is_empty()).then(|| quantile(&reported, 0.5)),
            wrong: share(&Case::is_false),
        }
    }
}

/// Returns a line for each kind of occlusion, and one for all.
pub(crate) fn lines(cases: &[&Case]) -> Vec<Line> {
    WAYS.into_iter().map(Some).chain([None]).map(|way| Line::of(way, cases)).collect()
}

/// Formats the tables by kind of occlusion and by sequence.
pub(crate) fn text(cases: &[Case]) -> String {
    let heads = [
        "",
        "cases",
        "not tracked",
        "loss reported",
        "re-acquired in 10",
        "reported in 10",
        "reported in 45",
        "median frames",
        "wrong object",
    ];
    let cells = |name: String, line: &Line| {
        let percent = |v: f64| format!("{:.1} %", 100.0 * v);
        let mut cells = vec![name, line.cases.to_string(), line.not_tracked.to_string()];
        cells.extend([line.loss_reported, line.reacquired, line.reported, line.reported_ever].map(percent));
        cells.extend([line.median.map_or("-".into(), |m| format!("{m:.0}")), percent(line.wrong)]);
        cells
    };
    let all: Vec<&Case> = cases.iter().collect();
    let name = |way: Option<Way>| match way {
        Some(Way::Behind) => "behind something",
        Some(Way::Away) => "camera away and back",
        Some(Way::Elsewhere) => "back elsewhere",
        None => "all",
    };
    let mut ways = vec![heads.map(String::from).to_vec()];
    ways.extend(lines(&all).iter().map(|line| cells(name(line.way).into(), line)));
    let mut names: Vec<&str> = cases.iter().map(|c| c.sequence.as_str()).collect();
    names.sort();
    names.dedup();
    let mut sequences = vec![heads.map(String::from).to_vec()];
    for name in names {
        let such: Vec<&Case> = cases.iter().filter(|c| c.sequence == name).collect();
        sequences.push(cells(name.into(), &Line::of(None, &such)));
    }
    format!(
        "{}\n{}\n{}",
        aligned(&ways),
        aligned(&sequences),
        "A case counts where the box was on the target (IoU at least 0.3) in the frame before the occlusion.\n\
         loss reported: status occluded or lost before the return. re-acquired in 10: the box is on the target within 10 frames of\n\
         the return; reported: and the status says so. wrong object: after the loss was reported, tracking or reacquired was\n\
         reported for 5 frames in a row or more while the target was lost (IoU below 0.1 or not visible).\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::control::{Cues, Status};

    #[test]
    fn cases_by_hand() {
        let hide = Hide { way: Way::Away, from: 20, until: 60, aside: (0, 0) };
        let judged = |t: usize, said_again: usize| {
            let (iou, status) = match t {
                0..20 => (0.8, Status::Tracking),
                20..23 => (0.0, Status::Tracking),
                _ if t < said_again => (if t >= 64 { 0.6 } else { 0.0 }, Status::Lost),
                _ => (if t >= 64 { 0.6 } else { 0.0 }, Status::Reacquired),
            };
            Judged {
                p_lost: 0.0,
                status,
                cues: Cues::default(),
                iou,
                off: None,
                covariance: [1.0, 0.0, 1.0],
                place: Default::default(),
            }
        };
        let case = |said: usize| Case::of("A", 1, hide, &(1..100).map(|t| judged(t, said)).collect::<Vec<_>>());
        let good = case(67);
        assert_eq!(
            (good.tracked, good.loss_reported, good.reacquired, good.reported),
            (true, Some(3), Some(4), Some(7))
        );
        assert_eq!((good.wrong, good.is_false()), (0, false));
        let early = case(50);
        assert_eq!((early.reported, early.wrong, early.is_false()), (Some(4), 14, true));
        let late = case(80);
        let line = Line::of(None, &[&good, &early, &late]);
        assert_eq!((line.cases, line.not_tracked, line.median), (3, 0, Some(7.0)));
        assert!(
            (line.reported - 2.0 / 3.0).abs() < 1e-12
                && (line.wrong - 1.0 / 3.0).abs() < 1e-12
                && line.reported_ever == 1.0
        );
        assert_eq!(Line::of(Some(Way::Behind), &[&good]).cases, 0);
        assert!(text(&[good, early, late]).contains("camera away and back"));
    }
}
