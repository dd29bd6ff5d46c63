//! A tracker on many sequences: scored from its files, or run.

use std::path::Path;

use serde::Serialize;

use super::metrics::{self, Score, frames_per_second};
use super::{Curves, Sequence};
use crate::geometry::BBox;
use crate::scene::annotation::{format_boxes, read_boxes, read_numbers};
use crate::{Error, Result, files};

/// What a tracker did on a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackRun {
    /// Its box in each frame, the first one included, 0-based.
    pub boxes: Vec<BBox>,
    /// Seconds it took for each frame, the start included; empty if they were not measured.
    pub seconds: Vec<f64>,
}

/// A tracker's score on one sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the sequence.
    pub sequence: String,
    /// The seed it was run with, if it was run here.
    pub seed: Option<u64>,
    /// The figures.
    #[serde(flatten)]
    pub score: Score,
    /// The curves.
    #[serde(skip)]
    pub curves: Curves,
}

/// A tracker's scores on many sequences.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Name of the tracker.
    pub tracker: String,
    /// One for each sequence and seed.
    pub rows: Vec<Row>,
    /// Sequences it has no result for; they count nowhere.
    pub missing: Vec<String>,
}

/// A mean over sequences, and its spread over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean over seeds.
    pub mean: f64,
    /// Standard deviation over seeds (n − 1 in the denominator); none with one seed.
    pub sd: Option<f64>,
}

impl Evaluation {
    /// The mean figures over all sequences and seeds; `None` without a row.
    pub fn mean(&self) -> Option<Score> {
        Score::mean(self.rows.iter().map(|row| &row.score))
    }
    /// The mean curves over all sequences and seeds.
    pub fn curves(&self) -> Curves {
        Curves::mean(self.rows.iter().map(|row| &row.curves))
    }
    /// A figure's mean over sequences, seed by seed: its mean and spread over seeds.
    pub fn spread(&self, figure: impl Fn(&Score) -> f64) -> Option<Spread> {
        let mut seeds: Vec<_> = self.rows.iter().map(|row| row.seed).collect();
        seeds.sort();
        seeds.dedup();
        let mean_of = |seed| {
            let scores = self.rows.iter().filter(|row| row.seed == seed).map(|row| &row.score);
            let (sum, n) = scores.fold((0.0, 0.0), |(sum, n), score| (sum + figure(score), n + 1.0));
            sum / n
        };
        let means: Vec<f64> = seeds.into_iter().map(mean_of).collect();
        let n = means.len() as f64;
        let (mean, sd) = metrics::mean_sd(&means);
        (n > 0.0).then(|| Spread { mean, sd: (n > 1.0).then(|| sd * (n / (n - 1.0)).sqrt()) })
    }
    /// The mean over seeds of one sequence's figures; `None` where it is missing.
    pub fn of_sequence(&self, name: &str) -> Option<Score> {
        Score::mean(self.rows.iter().filter(|row| row.sequence == name).map(|row| &row.score))
    }
}

/// Scores a folder of results: `<sequence>.txt` (or `<sequence>/boxes.txt`, as tracking writes it) with one box
/// `x,y,w,h` a frame, 1-based, the first frame included; and, where there is one,
/// `<sequence>_time.txt` (beside it or in `times/`) with the seconds of each frame.
///
/// # Errors
/// The folder has no result for any of the sequences, or a file is damaged or has not one line a frame.
pub fn score_folder(sequences: &[Sequence], folder: &Path) -> Result<Evaluation> {
    let whole = std::path::absolute(folder).map_err(Error::io(folder, "cannot find"))?;
    let tracker = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut evaluation = Evaluation { tracker, rows: Vec::new(), missing: Vec::new() };
    for sequence in sequences {
        let places = [folder.join(format!("{}.txt", sequence.name)), folder.join(&sequence.name).join("boxes.txt")];
        let Some(path) = places.iter().find(|path| path.is_file()) else {
            evaluation.missing.push(sequence.name.clone());
            continue;
        };
        let boxes = read_boxes(path)?;
        let in_file = |e: Error| Error::malformed(path, e.to_string());
        let (mut score, curves) = metrics::score(&boxes, &sequence.truth).map_err(in_file)?;
        let time = format!("{}_time.txt", sequence.name);
        let times = [folder.join(&time), folder.join("times").join(&time)];
        if let Some(path) = times.iter().find(|path| path.is_file()) {
            score.fps = frames_per_second(&read_numbers(path)?);
        }
        evaluation.rows.push(Row { sequence: sequence.name.clone(), seed: None, score, curves });
    }
    if evaluation.rows.is_empty() {
        let first = sequences.first().map_or("SEQUENCE", |s| s.name.as_str());
        return Err(Error::malformed(folder, format!("no result here: expected files such as {first}.txt")));
    }
    Ok(evaluation)
}

/// Runs a tracker over all sequences with each seed, keeps its results in `out` in the form that
/// [`score_folder`] reads (in a folder `seed-S` each where there are several seeds), and scores them.
/// `told` hears of each row when it is made.
///
/// # Errors
/// Whatever the tracker says, naming the sequence; it has not one box a frame; a file cannot be written.
pub fn run_all(
    tracker: &str,
    sequences: &[Sequence],
    seeds: &[u64],
    out: Option<&Path>,
    run_tracker: &dyn Fn(&Sequence, u64) -> Result<TrackRun>,
    told: &mut dyn FnMut(&Row),
) -> Result<Evaluation> {
    let mut evaluation = Evaluation { tracker: tracker.into(), rows: Vec::new(), missing: Vec::new() };
    for &seed in seeds {
        for sequence in sequences {
            let run = run_tracker(sequence, seed)?;
            if let Some(out) = out {
                let folder = if seeds.len() > 1 { out.join(format!("seed-{seed}")) } else { out.to_path_buf() };
                keep(&run, &folder, &sequence.name)?;
            }
            let boxes: Vec<_> = run.boxes.iter().copied().map(Some).collect();
            let at_sequence = |e: Error| Error::Invalid(format!("{}: {e}", sequence.images.display()));
            let (mut score, curves) = metrics::score(&boxes, &sequence.truth).map_err(at_sequence)?;
            score.fps = frames_per_second(&run.seconds);
            let row = Row { sequence: sequence.name.clone(), seed: Some(seed), score, curves };
            told(&row);
            evaluation.rows.push(row);
        }
    }
    Ok(evaluation)
}

fn keep(run: &TrackRun, folder: &Path, name: &str) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot create"))?;
    files::write(folder.join(format!("{name}.txt")), format_boxes(&run.boxes).as_bytes())?;
    let seconds: String = run.seconds.iter().map(|s| format!("{s:.8}\n")).collect();
    files::write(folder.join(format!("{name}_time.txt")), seconds.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{find_sequences, table};

    fn at(x: f64) -> BBox {
        BBox { x, y: 5.0, w: 10.0, h: 10.0 }
    }
    /// Sequences A and B of three frames, in a folder; the target is at 0, 1, 2.
    fn two(folder: &Path) -> Vec<Sequence> {
        for name in ["A", "B"] {
            std::fs::create_dir_all(folder.join(name)).expect("a new folder");
            let text = format_boxes(&[at(0.0), at(1.0), at(2.0)]);
            std::fs::write(folder.join(name).join("groundtruth_rect.txt"), text).expect("written");
        }
        find_sequences(&[folder.into()]).expect("two sequences")
    }

    #[test]
    fn what_is_run_is_scored_as_its_files_are() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let sequences = two(&dir.path().join("seqs"));
        let runner = |s: &Sequence, seed: u64| {
            let off = if s.name == "A" { 0.25 } else { 0.25 + seed as f64 };
            Ok(TrackRun { boxes: vec![at(0.0), at(1.0 + off), at(2.0 + off)], seconds: vec![1.0, 0.01, 0.03] })
        };
        let out = dir.path().join("ours");
        let mut told = 0;
        let ran = run_all("ours", &sequences, &[1], Some(&out), &runner, &mut |_| told += 1).expect("a run");
        let read = score_folder(&sequences, &out).expect("results");
        assert_eq!((told, read.tracker.as_str()), (2, "ours"));
        for (ran, read) in ran.rows.iter().zip(&read.rows) {
            assert_eq!((&ran.score, &ran.curves, ran.seed), (&read.score, &read.curves, Some(1)));
            assert_eq!(read.score.fps, Some(50.0));
        }

        let ran = run_all("ours", &sequences, &[1, 2, 3], Some(&out), &runner, &mut |_| ()).expect("three runs");
        assert!(out.join("seed-3/B_time.txt").is_file());
        // Mean errors over 3 frames: A 1/6 each; B 2/3 * (1.25, 2.25, 3.25), so the means are 1/2, 5/6, 7/6.
        let spread = ran.spread(|s| s.centre_error).expect("rows");
        assert!((spread.mean - 5.0 / 6.0).abs() < 1e-12 && (spread.sd.expect("three seeds") - 1.0 / 3.0).abs() < 1e-12);
        assert!(table::text(&[ran]).contains("ours over seeds: AUC"));
    }

    #[test]
    fn trackers_stand_side_by_side_and_gaps_are_named() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let sequences = two(&dir.path().join("seqs"));
        for (tracker, name, x) in [("good", "A", 1.0), ("good", "B", 1.0), ("bad", "A", 90.0)] {
            std::fs::create_dir_all(dir.path().join(tracker)).expect("a new folder");
            let text = format_boxes(&[at(0.0), at(x), at(2.0)]);
            std::fs::write(dir.path().join(tracker).join(format!("{name}.txt")), text).expect("written");
        }
        let both = ["good", "bad"].map(|t| score_folder(&sequences, &dir.path().join(t)).expect("results"));
        let text = table::text(&both);
        for line in [
            "AUC / P@20           good            bad",
            "A           0.952 / 1.000  0.635 / 0.667",
            "B           0.952 / 1.000              -",
            "mean  frames    AUC   P@20  SR@0.5  error px  lost  lost %  fps",
            "bad        3  0.635  0.667   0.667      29.7     1    33.3    -",
            "bad has no result for B: its means leave them out",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        let json = table::json(&both);
        assert_eq!(
            (&json["trackers"][1]["missing"][0], &json["trackers"][1]["sequences"][0]["lost"]),
            (&"B".into(), &1.into())
        );
        assert!(table::text(&both[..1]).lines().any(|l| l.starts_with("mean of 2")));

        std::fs::write(dir.path().join("bad/A.txt"), "1,2,3,4\n").expect("written");
        let problem = score_folder(&sequences, &dir.path().join("bad")).expect_err("too short").to_string();
        assert!(problem.contains("A.txt: 1 boxes for 3 frames of truth"), "{problem}");
        assert!(score_folder(&sequences, dir.path()).expect_err("none").to_string().contains("such as A.txt"));
        let short = |_: &Sequence, _| Ok(TrackRun { boxes: vec![at(0.0)], seconds: vec![] });
        assert!(run_all("x", &sequences, &[1], None, &short, &mut |_| ()).is_err());
    }
}
