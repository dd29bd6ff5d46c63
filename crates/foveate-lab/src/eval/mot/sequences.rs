//! The ground truth of many videos, found in folders, and a tracker's results on them.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Score, Tracks, score};
use crate::eval::sequence::by_name;
use foveate_base::text::counted;
use foveate_base::{Error, Result};
use foveate_video::mot::sequence_length;

/// A video's true tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// The name of its folder, or of its file without `.txt`.
    pub name: String,
    /// The file of the truth.
    pub truth_file: PathBuf,
    /// The truth.
    pub truth: Tracks,
    /// The number of frames from `seqinfo.ini`, if present.
    pub frames: Option<usize>,
}

/// A tracker's score on one sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the sequence.
    pub sequence: String,
    /// The scores.
    #[serde(flatten)]
    pub score: Score,
}

/// A tracker's scores on many sequences.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Name of the tracker: that of its folder or file.
    pub tracker: String,
    /// One row for each sequence with a result.
    pub rows: Vec<Row>,
    /// Sequences without a result; they do not count.
    pub missing: Vec<String>,
}

impl Evaluation {
    /// Pools all sequences.
    pub fn pooled(&self) -> Score {
        Score::pooled(self.rows.iter().map(|row| &row.score))
    }
}

/// Finds all sequences in `places`, by name. A place is a sequence in MOTChallenge's layout (`gt/gt.txt`, `seqinfo.ini`), a folder of
/// sequences, or a text file of true tracks.
///
/// # Errors
/// A place cannot be read or holds no sequence, a file is damaged or goes beyond `seqLength`, or two sequences share a name.
pub fn find_sequences(places: &[PathBuf]) -> Result<Vec<Sequence>> {
    let mut found = Vec::new();
    for place in places {
        let before = found.len();
        if place.is_file() {
            found.push(of_file(place)?);
        } else if place.join("gt/gt.txt").is_file() {
            found.push(of_folder(place)?);
        } else {
            let unread = || Error::io(place, "cannot read this folder");
            for inner in std::fs::read_dir(place).map_err(unread())? {
                let inner = inner.map_err(unread())?.path();
                if inner.join("gt/gt.txt").is_file() {
                    found.push(of_folder(&inner)?);
                }
            }
        }
        if found.len() == before {
            let problem = "no sequence here: expected gt/gt.txt, or folders that have it";
            return Err(Error::malformed(place, problem));
        }
    }
    by_name(found, |s| (&s.name, &s.truth_file))
}

fn of_file(path: &Path) -> Result<Sequence> {
    let whole = std::path::absolute(path).map_err(Error::io(path, "cannot find"))?;
    if whole.ends_with("gt/gt.txt")
        && let Some(folder) = whole.parent().and_then(Path::parent)
    {
        return of_folder(folder);
    }
    Ok(Sequence { name: stem(&whole), truth_file: path.into(), truth: Tracks::read(path)?, frames: None })
}

fn of_folder(folder: &Path) -> Result<Sequence> {
    let whole = std::path::absolute(folder).map_err(Error::io(folder, "cannot find"))?;
    let name = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let truth_file = folder.join("gt/gt.txt");
    let truth = Tracks::read(&truth_file)?;
    let frames = sequence_length(folder)?;
    within(&truth, frames, &truth_file)?;
    Ok(Sequence { name, truth_file, truth, frames })
}

/// Scores a tracker: `<sequence>.txt`, `data/<sequence>.txt` (TrackEval's layout) or `<sequence>/tracks.txt` in a
/// folder; or one file for a single sequence.
///
/// # Errors
/// There is no result for any of the sequences; a file is damaged, goes beyond `seqLength`, or cannot be scored ([`score`]).
pub fn score_results(sequences: &[Sequence], place: &Path) -> Result<Evaluation> {
    let whole = std::path::absolute(place).map_err(Error::io(place, "cannot find"))?;
    let tracker = if place.is_file() { stem(&whole) } else { file_name(&whole) };
    let mut evaluation = Evaluation { tracker, rows: Vec::new(), missing: Vec::new() };
    if place.is_file() && sequences.len() > 1 {
        let problem = format!("one file for {} sequences; give a folder with SEQUENCE.txt in it", sequences.len());
        return Err(Error::malformed(place, problem));
    }
    for sequence in sequences {
        let file = format!("{}.txt", sequence.name);
        let places = [
            place.into(),
            place.join(&file),
            place.join("data").join(&file),
            place.join(&sequence.name).join("tracks.txt"),
        ];
        let Some(path) = places.iter().find(|path| path.is_file()) else {
            evaluation.missing.push(sequence.name.clone());
            continue;
        };
        let results = Tracks::read(path)?;
        within(&results, sequence.frames, path)?;
        let mut score = score(&sequence.truth, &results).map_err(|e| {
            let truth = sequence.truth_file.display();
            Error::malformed(path, format!("cannot be scored against {truth}: {e}"))
        })?;
        score.frames = sequence.frames.unwrap_or(score.frames);
        evaluation.rows.push(Row { sequence: sequence.name.clone(), score });
    }
    if evaluation.rows.is_empty() {
        let first = sequences.first().map_or("SEQUENCE", |s| s.name.as_str());
        return Err(Error::malformed(place, format!("no result here: expected files such as {first}.txt")));
    }
    Ok(evaluation)
}

fn within(tracks: &Tracks, frames: Option<usize>, path: &Path) -> Result<()> {
    match frames {
        Some(frames) if tracks.frames() > frames => {
            let found = tracks.frames();
            let frames = counted(frames, "frame");
            Err(Error::malformed(path, format!("has boxes in frame {found}, but seqinfo.ini says {frames}")))
        }
        _ => Ok(()),
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
