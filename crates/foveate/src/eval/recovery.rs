//! Targets that vanish and come back: are they found again, how soon, and is anything else taken for them?

use serde::{Deserialize, Serialize};

use super::experiment::quantile;
use super::table::aligned;
use super::trust::{EPISODE, Judged};
use crate::scene::hide::{Hide, WAYS, Way};

/// Frames after the return within which a target should be found.
pub const SOON: usize = 10;
/// Frames that are followed after the return.
pub const AFTER: usize = 45;
/// An IoU of at least this is on the target.
pub const FOUND: f64 = 0.3;

/// What became of one target that vanished.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Name of the sequence.
    pub sequence: String,
    /// The tracker's seed, and that of the cut.
    pub seed: u64,
    /// When and how.
    pub hide: Hide,
    /// Whether the tracker was on the target in the frame before; a case counts only then.
    pub held: bool,
    /// Frames until it was said to be out; none if that was not before the return.
    pub noticed: Option<usize>,
    /// Frames from the return until the box was on it; none if it never was.
    pub on: Option<usize>,
    /// Frames from the return until the box was on it and that was said.
    pub found: Option<usize>,
    /// Longest run of frames, after the loss was noticed, in which something else was said to be it.
    pub mistaken: usize,
}

impl Case {
    /// From a track of the clip (from the second frame on).
    pub fn of(sequence: &str, seed: u64, hide: Hide, track: &[Judged]) -> Self {
        // Frame t of the clip is track[t − 1].
        let at = |t: usize| track.get(t.wrapping_sub(1));
        let after = &track[(hide.until - 1).min(track.len())..];
        let out = (hide.from..track.len() + 1).find(|t| at(*t).is_some_and(|j| j.standing.is_out()));
        let rest = out.map_or(&[][..], |t| &track[t - 1..]);
        let wrong = rest.chunk_by(|a, b| mistaken(a) == mistaken(b)).filter(|run| mistaken(&run[0]));
        Self {
            sequence: sequence.into(),
            seed,
            hide,
            held: at(hide.from - 1).is_some_and(|j| j.iou >= FOUND),
            noticed: out.filter(|t| *t < hide.until).map(|t| t - hide.from),
            on: after.iter().position(|j| j.iou >= FOUND),
            found: after.iter().position(|j| j.iou >= FOUND && !j.standing.is_out()),
            mistaken: wrong.map(<[Judged]>::len).max().unwrap_or(0),
        }
    }
    /// Whether something else was taken for the target.
    pub fn is_false(&self) -> bool {
        self.mistaken >= EPISODE
    }
}

fn mistaken(j: &Judged) -> bool {
    j.lost() && !j.standing.is_out()
}

/// The figures of many cases.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// How they vanished; none of all together.
    pub way: Option<Way>,
    /// Cases that count: the tracker held the target before.
    pub cases: usize,
    /// Cases in which it did not.
    pub not_held: usize,
    /// Share whose loss was noticed before the return.
    pub noticed: f64,
    /// Share with the box on the target within ten frames, said or not.
    pub on: f64,
    /// Share found within ten frames, and said to be.
    pub soon: f64,
    /// Share found within 45.
    pub ever: f64,
    /// Median frames to being found, of those found.
    pub median: Option<f64>,
    /// Share in which something else was said to be the target, for five frames or more after the loss was noticed.
    pub mistaken: f64,
}

impl Line {
    /// Sums up.
    pub fn of(way: Option<Way>, cases: &[&Case]) -> Self {
        let all: Vec<&&Case> = cases.iter().filter(|c| way.is_none_or(|way| c.hide.way == way)).collect();
        let held: Vec<&&&Case> = all.iter().filter(|c| c.held).collect();
        let share =
            |such: &dyn Fn(&Case) -> bool| held.iter().filter(|c| such(c)).count() as f64 / held.len().max(1) as f64;
        let found: Vec<f64> = held.iter().filter_map(|c| c.found).map(|f| f as f64).collect();
        Self {
            way,
            cases: held.len(),
            not_held: all.len() - held.len(),
            noticed: share(&|c| c.noticed.is_some()),
            on: share(&|c| c.on.is_some_and(|f| f <= SOON)),
            soon: share(&|c| c.found.is_some_and(|f| f <= SOON)),
            ever: share(&|c| c.found.is_some()),
            median: (!found.is_empty()).then(|| quantile(&found, 0.5)),
            mistaken: share(&Case::is_false),
        }
    }
}

/// By way, and of all.
pub fn lines(cases: &[&Case]) -> Vec<Line> {
    WAYS.into_iter().map(Some).chain([None]).map(|way| Line::of(way, cases)).collect()
}

/// Tables of the ways, and of the sequences.
pub fn text(cases: &[Case]) -> String {
    let heads =
        ["", "cases", "not held", "noticed", "on in 10", "found in 10", "found in 45", "median frames", "mistaken"];
    let cells = |name: String, line: &Line| {
        let percent = |v: f64| format!("{:.1} %", 100.0 * v);
        let mut cells = vec![name, line.cases.to_string(), line.not_held.to_string()];
        cells.extend([line.noticed, line.on, line.soon, line.ever].map(percent));
        cells.extend([line.median.map_or("-".into(), |m| format!("{m:.0}")), percent(line.mistaken)]);
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
        "A case counts where the tracker held the target (IoU at least 0.3) in the frame before it vanished.\n\
         noticed: said to be out before the return. on: the box is on the target (IoU at least 0.3) within 10 frames of the\n\
         return; found: and that is said. mistaken: after the loss was noticed, tracking or found was said for 5 frames in a\n\
         row or more with an IoU below 0.1, or while the target was out of sight.\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Cues, Standing};

    #[test]
    fn cases_by_hand() {
        let hide = Hide { way: Way::Away, from: 20, until: 60, aside: (0, 0) };
        let judged = |t: usize, said_again: usize| {
            let (iou, standing) = match t {
                0..20 => (0.8, Standing::Tracking),
                20..23 => (0.0, Standing::Tracking),
                _ if t < said_again => (if t >= 64 { 0.6 } else { 0.0 }, Standing::Lost),
                _ => (if t >= 64 { 0.6 } else { 0.0 }, Standing::Found),
            };
            Judged { p_lost: 0.0, standing, cues: Cues::default(), iou, off: None, covariance: [1.0, 0.0, 1.0] }
        };
        let case = |said: usize| Case::of("A", 1, hide, &(1..100).map(|t| judged(t, said)).collect::<Vec<_>>());
        let good = case(67);
        assert_eq!((good.held, good.noticed, good.on, good.found), (true, Some(3), Some(4), Some(7)));
        assert_eq!((good.mistaken, good.is_false()), (0, false));
        let early = case(50);
        assert_eq!((early.found, early.mistaken, early.is_false()), (Some(4), 14, true));
        let late = case(80);
        let line = Line::of(None, &[&good, &early, &late]);
        assert_eq!((line.cases, line.not_held, line.median), (3, 0, Some(7.0)));
        assert!((line.soon - 2.0 / 3.0).abs() < 1e-12 && (line.mistaken - 1.0 / 3.0).abs() < 1e-12 && line.ever == 1.0);
        assert_eq!(Line::of(Some(Way::Behind), &[&good]).cases, 0);
        assert!(text(&[good, early, late]).contains("camera away and back"));
    }
}
