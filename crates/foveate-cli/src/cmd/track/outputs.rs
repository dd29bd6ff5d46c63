//! What a run of one target writes, and what it says at the end.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::spared::Lost;
use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::regret::RegretFiles;
use foveate::report::run::Outcome;
use foveate::report::{Boxes, Film, Limited, Observer, Report, RunInfo, Summary, SurfacePicture, Table, Trace};
use foveate::sink::Sink;
use foveate::text::counted;
use foveate::video::{SourceInfo, without_password};

/// What is written beside boxes.txt and track.csv.
#[derive(Clone, Copy)]
pub struct Outputs {
    pub video: bool,
    pub report: bool,
    /// surface.png; only where the gaze policy has something to show.
    pub surface: bool,
    pub trace: bool,
    pub regret: bool,
    /// Of a run without an end: tables grow in place, what else is kept is of its first frames.
    pub endless: bool,
}

/// So many frames of a run without an end are kept in report, trace and regret.
pub const FIRST: usize = 10_000;

/// All of a run, or the first frames of one without an end.
fn held(files: &'static [&'static str], observer: Box<dyn Observer>, endless: bool, lost: &Lost) -> Box<dyn Observer> {
    let most = if endless { FIRST } else { usize::MAX };
    Box::new(lost.spare(files, Limited::new(observer, most)))
}

/// Starts a file of lines: it has its name when it is whole, or at once in a run without an end.
pub fn sinks(endless: bool) -> fn(PathBuf) -> Result<Sink> {
    if endless { Sink::grow } else { Sink::create }
}

impl Outputs {
    /// The names of the files.
    pub fn names(self) -> Vec<&'static str> {
        let mut names = vec!["boxes.txt", "track.csv"];
        let all: [(bool, &[&str]); 5] = [
            (self.trace, &["trace.jsonl"]),
            (self.video, &["annotated.mp4"]),
            (self.report, &["report.html"]),
            (self.surface, &["surface.png"]),
            (self.regret, &["regret.csv", "regret.svg"]),
        ];
        all.into_iter().filter(|(asked, _)| *asked).for_each(|(_, files)| names.extend(files));
        names
    }

    /// The observers that write these files into a folder. Where one fails in mid-run, its files are listed as lost.
    pub fn observers(self, folder: &Path, info: &RunInfo, lost: &Lost) -> Result<Vec<Box<dyn Observer>>> {
        let at = |name: &str| folder.join(name);
        let sink = sinks(self.endless);
        let (boxes, table) = (Boxes::to(sink(at("boxes.txt"))?), Table::to(sink(at("track.csv"))?));
        let mut observers: Vec<Box<dyn Observer>> =
            vec![Box::new(lost.spare(&["boxes.txt"], boxes)), Box::new(lost.spare(&["track.csv"], table))];
        let held = |files, observer| held(files, observer, self.endless, lost);
        if self.trace {
            observers.push(held(&["trace.jsonl"], Box::new(Trace::create(at("trace.jsonl"))?)));
        }
        if self.video {
            observers.push(held(&["annotated.mp4"], Box::new(Film::create(at("annotated.mp4"), info)?)));
        }
        if self.report {
            observers.push(held(&["report.html"], Box::new(Report::create(at("report.html"), info.clone())?)));
        }
        if self.surface {
            observers.push(held(&["surface.png"], Box::new(SurfacePicture::create(at("surface.png"), info.clone())?)));
        }
        if self.regret {
            observers
                .push(held(&["regret.csv", "regret.svg"], Box::new(RegretFiles::create(folder, info.shadow.clone())?)));
        }
        Ok(observers)
    }
}

/// What is known of a run before it begins.
pub fn run_info(source: &str, info: &SourceInfo, config_name: &str, blueprint: &Blueprint, seed: u64) -> RunInfo {
    let (bit_rate, command) = (bit_rate(Path::new(source), info), crate::invocation::command());
    RunInfo {
        bit_rate,
        command,
        ..RunInfo::of(without_password(source).into_owned(), info, config_name.to_owned(), blueprint, seed)
    }
}

/// Bits a second of a video file, its sound included.
pub fn bit_rate(source: &Path, info: &SourceInfo) -> Option<f64> {
    let file = std::fs::metadata(source).ok().filter(std::fs::Metadata::is_file)?;
    let frames = info.frames.filter(|n| *n > 1)?;
    Some(8.0 * file.len() as f64 * info.rate / frames as f64).filter(|rate| rate.is_finite())
}

/// What a run of one target is told of at its end.
pub struct Told<'a> {
    pub source: &'a Path,
    pub out: &'a Path,
    pub seed: u64,
    pub json: bool,
    /// The files, where they are now; none where nothing was tracked.
    pub files: &'a [PathBuf],
    /// From the first frame to the last file.
    pub total: Duration,
    /// What the readers of the results should be warned of.
    pub warnings: Vec<String>,
    pub error: Option<String>,
}

/// Prints what became of a run.
pub fn tell(outcome: &Outcome, told: &Told<'_>) {
    let (frames, occluded, lost) = (outcome.frames.count, outcome.occluded, outcome.lost);
    let (seconds, total) = (outcome.frames.spent.as_secs_f64(), told.total.as_secs_f64());
    let (fps, total_fps) = (Summary::rate(frames, seconds), Summary::rate(frames, total));
    if told.json {
        let summary = Summary {
            source: without_password(&told.source.to_string_lossy()).into_owned(),
            frames,
            seconds,
            fps,
            total_seconds: total,
            total_fps,
            occluded_frames: occluded,
            lost_frames: lost,
            outside_frames: outcome.outside,
            bbox: outcome.last,
            class: outcome.class,
            class_name: outcome.class_name.clone(),
            seed: told.seed,
            outputs: told.files.to_vec(),
            damaged_frames: outcome.frames.damaged,
            warnings: told.warnings.clone(),
            error: told.error.clone(),
        };
        say!("{}", summary.to_json());
        return;
    }
    if told.files.is_empty() {
        return;
    }
    say!(
        "{} tracked, occluded in {occluded}, lost in {lost}; {} a second in the tracker, {total_fps:.0} end to end.",
        counted(frames, "frame"),
        counted(fps.round() as usize, "frame")
    );
    match outcome.last {
        Some(b) => say!("Last box: {:.1},{:.1},{:.1},{:.1} (x,y,w,h, counted from 1).", b.x + 1.0, b.y + 1.0, b.w, b.h),
        None => say!("Last box: outside the picture, as in {}.", counted(outcome.outside, "frame")),
    }
    if let Some((class, p)) = outcome.class {
        let name = outcome.class_name.clone().unwrap_or_else(|| format!("class {class}"));
        say!("Recognised as {name}, with probability {p:.3}.");
    }
    told.warnings.iter().for_each(|warning| say!("Warning: {warning}"));
    tell_files(told.out, told.files);
}

/// Prints the files of a run.
pub fn tell_files(out: &Path, files: &[PathBuf]) {
    let names: Vec<String> = files.iter().filter_map(|o| o.file_name()).map(|n| n.to_string_lossy().into()).collect();
    if !names.is_empty() {
        say!("{}: {}", out.display(), names.join(", "));
    }
}
