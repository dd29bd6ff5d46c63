//! A tracker on many sequences: scored from its files, or run.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::catalogue::Origin;
use super::curves::Drawn;
use super::masks::Masks;
use super::metrics::{self, Score, frames_per_second};
use super::sequence::list;
use super::{Curves, Sequence};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::BBox;
use foveate_video::annotation::{format_boxes, read_boxes, read_numbers};

/// A tracker's output on a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackRun {
    /// The box in each frame, including the first, 0-based.
    pub boxes: Vec<BBox>,
    /// Seconds for each frame, including the start; empty if not measured.
    pub seconds: Vec<f64>,
    /// Number of values read from a picture and their fraction of all values, means over frames; `None` if not counted.
    pub read: Option<[f64; 2]>,
}

/// A tracker's score on one sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the sequence.
    pub sequence: String,
    /// The source, half and kind of the sequence.
    #[serde(skip)]
    pub origin: Origin,
    /// The seed of the run, if it was run here.
    pub seed: Option<u64>,
    /// The scores.
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
    /// One row for each sequence and seed.
    pub rows: Vec<Row>,
    /// Sequences without a result; they do not count.
    pub missing: Vec<String>,
}

/// A mean over sequences, and its spread over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean over seeds.
    pub mean: f64,
    /// Standard deviation over seeds (n − 1 in the denominator); `None` with one seed.
    pub sd: Option<f64>,
}

impl Evaluation {
    /// Returns the mean scores over all sequences and seeds; `None` without a row.
    pub fn mean(&self) -> Option<Score> {
        Score::mean(self.rows.iter().map(|row| &row.score))
    }
    /// Returns the mean curves over all sequences and seeds.
    pub fn curves(&self) -> Curves {
        Curves::mean(self.rows.iter().map(|row| &row.curves))
    }
    /// Returns the rows of each seed.
    fn by_seed(&self) -> Vec<Vec<&Row>> {
        let seeds: BTreeSet<_> = self.rows.iter().map(|row| row.seed).collect();
        seeds.into_iter().map(|seed| self.rows.iter().filter(|row| row.seed == seed).collect()).collect()
    }
    /// Returns the data of the plot: the mean curves, and their band over seeds.
    pub fn drawn(&self) -> Drawn<'_> {
        let seeds: Vec<Curves> =
            self.by_seed().iter().map(|rows| Curves::mean(rows.iter().map(|row| &row.curves))).collect();
        Drawn { name: &self.tracker, mean: self.curves(), band: Curves::band(&seeds) }
    }
    /// Returns the mean of a score over sequences: its mean and spread over seeds.
    pub fn spread(&self, figure: impl Fn(&Score) -> f64) -> Option<Spread> {
        let mean_of = |rows: &Vec<&Row>| rows.iter().map(|row| figure(&row.score)).sum::<f64>() / rows.len() as f64;
        let means: Vec<f64> = self.by_seed().iter().map(mean_of).collect();
        let n = means.len() as f64;
        let (mean, sd) = metrics::mean_sd(&means);
        (n > 0.0).then(|| Spread { mean, sd: (n > 1.0).then(|| sd * (n / (n - 1.0)).sqrt()) })
    }
    /// Returns the mean over seeds of one sequence's scores; `None` if it is missing.
    pub fn of_sequence(&self, name: &str) -> Option<Score> {
        Score::mean(self.rows.iter().filter(|row| row.sequence == name).map(|row| &row.score))
    }
}

/// Scores a folder: a tracker's results, or folders of trackers, which are returned best first (by AUC).
///
/// A tracker's results are `<sequence>.txt` (or `<sequence>/boxes.txt`, as tracking writes it) with one box `x,y,w,h` per frame, 1-based,
/// including the first frame. Optional files are `<sequence>_time.txt` (beside it or in `times/`) with the seconds of each frame, and
/// `<sequence>_read.txt` with the values read per frame and their fraction of a picture. Results of several seeds are in folders `seed-S`,
/// as [`run_all`] writes them.
///
/// # Errors
/// There is no result for any of the sequences, or a file is damaged or does not have one line per frame.
pub fn score_folder(sequences: &[Sequence], folder: &Path) -> Result<Vec<Evaluation>> {
    if let Some(one) = score_tracker(sequences, folder)? {
        return Ok(vec![one]);
    }
    let mut all = Vec::new();
    for (_, inner) in folders(folder)? {
        all.extend(score_tracker(sequences, &inner)?);
    }
    if all.is_empty() {
        let first = sequences.first().map_or("SEQUENCE", |s| s.name.as_str());
        let problem = format!("no result here: expected files such as {first}.txt, or folders that have them");
        return Err(Error::malformed(folder, problem));
    }
    let auc = |e: &Evaluation| e.mean().map_or(0.0, |s| s.auc);
    all.sort_by(|a, b| auc(b).total_cmp(&auc(a)));
    Ok(all)
}

/// Scores one tracker's results, of one pass or of several seeds; `None` if there are none.
fn score_tracker(sequences: &[Sequence], folder: &Path) -> Result<Option<Evaluation>> {
    let whole = std::path::absolute(folder).map_err(Error::io(folder, "cannot find"))?;
    let tracker = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut rows = score_files(sequences, folder, None)?;
    if rows.is_empty() {
        for (name, inner) in folders(folder)? {
            if let Some(seed) = name.strip_prefix("seed-").and_then(|seed| seed.parse().ok()) {
                rows.extend(score_files(sequences, &inner, Some(seed))?);
            }
        }
    }
    let seeds: BTreeSet<Option<u64>> = rows.iter().map(|row| row.seed).collect();
    let mut missing = vec![];
    for name in sequences.iter().map(|s| &s.name) {
        let found = |seed: &Option<u64>| rows.iter().any(|row| row.sequence == *name && row.seed == *seed);
        let without: Vec<String> = seeds.iter().filter(|seed| !found(seed)).flatten().map(u64::to_string).collect();
        match without.len() {
            0 if seeds.iter().any(found) => (),
            n if n < seeds.len() && n > 0 => missing.push(format!("{name} with seed {}", without.join(", "))),
            _ => missing.push(name.clone()),
        }
    }
    Ok((!rows.is_empty()).then_some(Evaluation { tracker, rows, missing }))
}

/// Returns a row for each sequence that has a file in this folder.
fn score_files(sequences: &[Sequence], folder: &Path, seed: Option<u64>) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for sequence in sequences {
        let [boxes, time, read] = files_of(&sequence.name, None);
        let places = [folder.join(boxes), folder.join(&sequence.name).join("boxes.txt")];
        let Some(path) = places.iter().find(|path| path.is_file()) else { continue };
        let in_file = |e: Error| Error::malformed(path, e.to_string());
        let boxes = read_boxes(path)?;
        let (mut score, curves) = metrics::score(&boxes, &sequence.truth).map_err(in_file)?;
        score = score.with_masks(Masks::judge(sequence, &boxes)?);
        let times = [folder.join(&time), folder.join("times").join(&time)];
        if let Some(path) = times.iter().find(|path| path.is_file()) {
            score.fps = frames_per_second(&read_numbers(path)?);
        }
        let read = folder.join(read);
        if read.is_file() {
            let [values, share] = read_numbers(&read)?[..] else {
                return Err(Error::malformed(
                    &read,
                    "expected two numbers: values read a frame, and their share of a picture",
                ));
            };
            score = score.counting(Some([values, share]));
        }
        rows.push(Row { sequence: sequence.name.clone(), origin: sequence.origin.clone(), seed, score, curves });
    }
    Ok(rows)
}

/// Returns the files of a run in a tracker's folder, by the name of the sequence: its boxes, the seconds of each frame, the values read.
/// Files of several seeds are in separate folders.
fn files_of(sequence: &str, seed: Option<u64>) -> [String; 3] {
    let folder = seed.map_or(String::new(), |seed| format!("seed-{seed}/"));
    ["", "_time", "_read"].map(|what| format!("{folder}{sequence}{what}.txt"))
}

/// Returns the files that [`run_all`] may write, below `folder`.
pub fn track_files(folder: &str, sequences: &[Sequence], seeds: &[u64]) -> Vec<String> {
    let seeds = seeds.iter().map(|seed| (seeds.len() > 1).then_some(*seed));
    let files = seeds.flat_map(|seed| sequences.iter().flat_map(move |sequence| files_of(&sequence.name, seed)));
    files.map(|file| format!("{folder}/{file}")).collect()
}

/// Returns the folders in a folder, with their names, sorted.
fn folders(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(list(folder)?.into_iter().filter(|path| path.is_dir()).map(|path| (name(&path), path)).collect())
}

/// Runs a tracker over all sequences with each seed, writes its results to `out` in the format of [`score_folder`] (in a folder `seed-S`
/// per seed if there are several), and scores them. Calls `each` with each row.
///
/// # Errors
/// An error of the tracker, with the sequence's name; it does not have one box per frame; a file cannot be written.
pub fn run_all(
    tracker: &str,
    sequences: &[Sequence],
    seeds: &[u64],
    out: Option<&Path>,
    run_tracker: &dyn Fn(&Sequence, u64) -> Result<TrackRun>,
    each: &mut dyn FnMut(&Row),
) -> Result<Evaluation> {
    let mut evaluation = Evaluation { tracker: tracker.into(), rows: Vec::new(), missing: Vec::new() };
    for &seed in seeds {
        for sequence in sequences {
            let run = run_tracker(sequence, seed)?;
            if let Some(out) = out {
                keep(&run, files_of(&sequence.name, (seeds.len() > 1).then_some(seed)).map(|file| out.join(file)))?;
            }
            let boxes: Vec<_> = run.boxes.iter().copied().map(Some).collect();
            let at_sequence = |e: Error| Error::Invalid(format!("{}: {e}", sequence.images.display()));
            let (mut score, curves) = metrics::score(&boxes, &sequence.truth).map_err(at_sequence)?;
            score.fps = frames_per_second(&run.seconds);
            let score = score.counting(run.read).with_masks(Masks::judge(sequence, &boxes)?);
            let (name, origin) = (sequence.name.clone(), sequence.origin.clone());
            let row = Row { sequence: name, origin, seed: Some(seed), score, curves };
            each(&row);
            evaluation.rows.push(row);
        }
    }
    Ok(evaluation)
}

fn keep(run: &TrackRun, [boxes, time, read]: [PathBuf; 3]) -> Result<()> {
    let folder = files::folder_of(&boxes);
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot create"))?;
    files::write_inside(&boxes, format_boxes(&run.boxes).as_bytes())?;
    if let Some([values, share]) = run.read {
        files::write_inside(read, format!("{values}\n{share}\n").as_bytes())?;
    }
    let seconds: String = run.seconds.iter().map(|s| format!("{s:.8}\n")).collect();
    files::write_inside(time, seconds.as_bytes())
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
            Ok(TrackRun {
                boxes: vec![at(0.0), at(1.0 + off), at(2.0 + off)],
                seconds: vec![1.0, 0.01, 0.03],
                read: None,
            })
        };
        let out = dir.path().join("ours");
        let mut reported = 0;
        let ran = run_all("ours", &sequences, &[1], Some(&out), &runner, &mut |_| reported += 1).expect("a run");
        let read = score_folder(&sequences, &out).expect("results").remove(0);
        assert_eq!((reported, read.tracker.as_str()), (2, "ours"));
        for (ran, read) in ran.rows.iter().zip(&read.rows) {
            assert_eq!((&ran.score, &ran.curves, ran.seed), (&read.score, &read.curves, Some(1)));
            assert_eq!(read.score.fps, Some(50.0));
        }

        let ran = run_all("ours", &sequences, &[1, 2, 3], Some(&out), &runner, &mut |_| ()).expect("three runs");
        assert!(out.join("seed-3/B_time.txt").is_file());
        // Mean errors over 3 frames: A 1/6 each; B 2/3 * (1.25, 2.25, 3.25), so the means are 1/2, 5/6, 7/6.
        let spread = ran.spread(|s| s.centre_error).expect("rows");
        assert!((spread.mean - 5.0 / 6.0).abs() < 1e-12 && (spread.sd.expect("three seeds") - 1.0 / 3.0).abs() < 1e-12);
        assert!(table::text(std::slice::from_ref(&ran)).contains("ours over seeds: AUC"));
        assert!(
            ran.drawn().band.is_some() && score_folder(&sequences, &out).expect("results")[0].drawn().band.is_none()
        );
        let alone = dir.path().join("alone/ours");
        run_all("ours", &sequences, &[1, 2, 3], Some(&alone), &runner, &mut |_| ()).expect("three runs");
        for folder in [alone.clone(), dir.path().join("alone")] {
            let read = score_folder(&sequences, &folder).expect("seeds");
            assert_eq!((read.len(), read[0].rows.len(), &read[0].rows[5].curves), (1, 6, &ran.rows[5].curves));
            assert_eq!(read[0].drawn(), ran.drawn());
        }
    }

    #[test]
    fn values_are_shown_where_they_say_something() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let sequences = two(dir.path());
        let text = |read| {
            let runner = |_: &Sequence, _| Ok(TrackRun { boxes: vec![at(0.0); 3], seconds: vec![], read });
            table::text(&[run_all("ours", &sequences, &[1], None, &runner, &mut |_| ()).expect("a run")])
        };
        let sensor = text(Some([244.0, 0.002]));
        for words in ["failure %  values  read %", "244    0.20", "values, read %: pixel values read a frame"] {
            assert!(sensor.contains(words), "{words}\n{sensor}");
        }
        for read in [None, Some([90_000.0, 1.0])] {
            let whole = text(read);
            assert!(!whole.contains("values") && !whole.contains("fps"), "{whole}");
            assert!(whole.contains("AUC: area under the success curve"), "{whole}");
        }
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
        let both = ["good", "bad"].map(|t| score_folder(&sequences, &dir.path().join(t)).expect("results").remove(0));
        assert_eq!(score_folder(&sequences, dir.path()).expect("both at once, the best first"), both);
        let text = table::text(&both);
        for line in [
            "AUC / P@20           good            bad",
            "A           0.952 / 1.000  0.635 / 0.667",
            "B           0.952 / 1.000              -",
            "mean  frames    AUC   P@20  SR@0.5  error px  failures  failure %",
            "bad        3  0.635  0.667   0.667      29.7         1       33.3",
            "good against  sequences     AUC  better on  worse on",
            "bad                   1  +0.317          1         0",
            "bad has no result for B: its means leave them out",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        let json = table::json(&both);
        assert_eq!(
            (&json["trackers"][1]["missing"][0], &json["trackers"][1]["sequences"][0]["failures"]),
            (&"B".into(), &1.into())
        );
        assert!(table::text(&both[..1]).lines().any(|l| l.starts_with("mean of 2")));
        // A result that one seed of two lacks.
        for (seed, name) in [(1, "A"), (1, "B"), (2, "A")] {
            let folder = dir.path().join(format!("seeds/seed-{seed}"));
            std::fs::create_dir_all(&folder).expect("a folder");
            std::fs::write(folder.join(format!("{name}.txt")), format_boxes(&[at(0.0); 3])).expect("written");
        }
        let seeds = score_folder(&sequences, &dir.path().join("seeds")).expect("results");
        assert_eq!(seeds[0].missing, ["B with seed 2"]);

        std::fs::write(dir.path().join("bad/A.txt"), "1,2,3,4\n").expect("written");
        let problem = score_folder(&sequences, &dir.path().join("bad")).expect_err("too short").to_string();
        assert!(problem.contains("A.txt: 1 box for 3 frames of truth"), "{problem}");
        assert!(
            score_folder(&sequences, &dir.path().join("seqs")).expect_err("none").to_string().contains("such as A.txt")
        );
        let short = |_: &Sequence, _| Ok(TrackRun { boxes: vec![at(0.0)], seconds: vec![], read: None });
        assert!(run_all("x", &sequences, &[1], None, &short, &mut |_| ()).is_err());
    }
}
