//! The output files of a run.

use std::path::Path;

use super::tolerant::FailedOutputs;
use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::regret::RegretFiles;
use foveate::lab::measure::FILES;
use foveate::report::{
    Boxes, Film, MotFile, Observer, Report, RunInfo, SurfacePicture, Table, TargetsTable, Trace, TracksTable,
};
use foveate::sink::Sink;
use foveate::video::{SourceInfo, without_password};

/// The files of a run besides boxes.txt and track.csv (one target), or tracks.txt, tracks.csv and targets.csv (many targets).
#[derive(Clone, Copy, Default)]
pub(crate) struct Outputs {
    /// Whether there are many targets.
    pub many: bool,
    pub video: bool,
    pub report: bool,
    /// surface.png, which is written only if the gaze policy has a surface.
    pub surface: bool,
    pub trace: bool,
    pub regret: bool,
    /// The files of `foveate measure`, which [`super::measured::Measured`] writes.
    pub measure: bool,
    /// Whether the source is endless: tables then grow in place, and report, trace and regret hold only the first frames.
    pub endless: bool,
}

/// Number of frames in the report, trace and regret of an endless run.
const FIRST: usize = 10_000;

impl Outputs {
    /// Returns the names of the files.
    pub(crate) fn names(self) -> Vec<&'static str> {
        let all: [(bool, &[&str]); 8] = [
            (!self.many, &["boxes.txt", "track.csv"]),
            (self.many, &["tracks.txt", "tracks.csv", "targets.csv"]),
            (self.trace, &["trace.jsonl"]),
            (self.video, &["annotated.mp4"]),
            (self.report, &["report.html"]),
            (self.surface, &["surface.png"]),
            (self.regret, &["regret.csv", "regret.svg"]),
            (self.measure, &FILES),
        ];
        all.into_iter().filter(|(asked, _)| *asked).flat_map(|(_, files)| files).copied().collect()
    }

    /// Returns the observers that write these files into a folder. If one fails during the run, its files are listed in `failed`.
    pub(crate) fn observers(
        self,
        folder: &Path,
        info: &RunInfo,
        failed: &FailedOutputs,
    ) -> Result<Vec<Box<dyn Observer>>> {
        let at = |name: &str| folder.join(name);
        // A file of lines gets its final name when it is complete, or immediately in an endless run.
        let sink = |name: &str| if self.endless { Sink::grow(at(name)) } else { Sink::create(at(name)) };
        let most = if self.endless { FIRST } else { usize::MAX };
        let all = |files, observer: Box<dyn Observer>| failed.tolerate(files, observer, usize::MAX);
        let first = |files, observer: Box<dyn Observer>| failed.tolerate(files, observer, most);
        let mut observers = if self.many {
            vec![
                all(&["tracks.txt"], Box::new(MotFile::to(sink("tracks.txt")?))),
                all(&["tracks.csv"], Box::new(TracksTable::to(sink("tracks.csv")?))),
                all(&["targets.csv"], Box::new(TargetsTable::create(at("targets.csv"))?)),
            ]
        } else {
            vec![
                all(&["boxes.txt"], Box::new(Boxes::to(sink("boxes.txt")?))),
                all(&["track.csv"], Box::new(Table::to(sink("track.csv")?))),
            ]
        };
        if self.trace {
            observers.push(first(&["trace.jsonl"], Box::new(Trace::create(at("trace.jsonl"))?)));
        }
        if self.video {
            let path = at("annotated.mp4");
            let film = if self.many { Film::of_many(path, info) } else { Film::create(path, info) };
            observers.push(first(&["annotated.mp4"], Box::new(film?)));
        }
        if self.report {
            observers.push(first(&["report.html"], Box::new(Report::create(at("report.html"), info.clone())?)));
        }
        if self.surface {
            observers.push(first(&["surface.png"], Box::new(SurfacePicture::create(at("surface.png"), info.clone())?)));
        }
        if self.regret {
            let files = RegretFiles::create(folder, info.shadow.clone())?;
            observers.push(first(&["regret.csv", "regret.svg"], Box::new(files)));
        }
        Ok(observers)
    }
}

/// Returns the data of a run that are known before it begins.
pub(crate) fn run_info(
    source: &str,
    info: &SourceInfo,
    config_name: &str,
    blueprint: &Blueprint,
    seed: u64,
) -> RunInfo {
    let (bit_rate, command) = (bit_rate(Path::new(source), info), crate::invocation::command());
    RunInfo {
        bit_rate,
        command,
        ..RunInfo::of(without_password(source).into_owned(), info, config_name.to_owned(), blueprint, seed)
    }
}

/// Returns the bit rate of a video file including its sound, bits per second.
pub(crate) fn bit_rate(source: &Path, info: &SourceInfo) -> Option<f64> {
    let file = std::fs::metadata(source).ok().filter(std::fs::Metadata::is_file)?;
    let frames = info.frames.filter(|n| *n > 1)?;
    Some(8.0 * file.len() as f64 * info.rate / frames as f64).filter(|rate| rate.is_finite())
}
