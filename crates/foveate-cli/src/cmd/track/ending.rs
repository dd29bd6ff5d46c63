//! The output of a run at its end.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use foveate::BBox;
use foveate::report::run::RunSummary;
use foveate::text::counted;
use foveate::video::without_password;
use serde::Serialize;
use serde_json::{Value, json};

/// The end of a run.
pub(super) struct Ending<'a> {
    pub source: &'a Path,
    pub out: &'a Path,
    pub seed: u64,
    pub json: bool,
    /// The detector of many targets, and whether the program runs it: its time is then known. `None` for one target.
    pub detector: Option<(String, bool)>,
    pub summary: &'a RunSummary,
    /// The output files at their final paths; empty if nothing was tracked.
    pub files: &'a [PathBuf],
    /// From the first frame to the last file.
    pub total: Duration,
    /// Warnings for the readers of the results.
    pub warnings: Vec<String>,
    pub error: Option<String>,
}

/// The JSON summary of one target, in field order. Box coordinates count from 0.
#[derive(Serialize)]
struct One<'a> {
    source: Cow<'a, str>,
    frames: usize,
    seconds: f64,
    fps: f64,
    total_seconds: f64,
    total_fps: f64,
    occluded_frames: usize,
    lost_frames: usize,
    outside_frames: usize,
    bbox: Option<BBox>,
    #[serde(skip_serializing_if = "Option::is_none")]
    class: Option<(usize, f64)>,
    #[serde(skip_serializing_if = "Option::is_none")]
    class_name: Option<&'a str>,
    seed: u64,
    outputs: Vec<Cow<'a, str>>,
    damaged_frames: u64,
    warnings: &'a [String],
    error: Option<&'a str>,
}

impl Ending<'_> {
    /// Prints the output.
    pub(super) fn tell(&self) {
        // A file name need not be Unicode.
        let outputs: Vec<_> = self.files.iter().map(|file| file.to_string_lossy()).collect();
        let source = self.source.to_string_lossy();
        let source = without_password(&source);
        match &self.detector {
            None if self.json => {
                let text = serde_json::to_string_pretty(&self.one(source, outputs));
                say!("{}", text.expect("plain data is JSON"));
            }
            Some((detector, _)) if self.json => say!("{:#}", self.many(detector, &source, &outputs)),
            _ if self.files.is_empty() => {}
            detector => {
                match detector {
                    None => self.tell_one(),
                    Some((detector, timed)) => self.tell_many(detector, *timed),
                }
                self.warnings.iter().for_each(|warning| say!("Warning: {warning}"));
                let names = self.files.iter().filter_map(|file| file.file_name());
                let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
                say!("{}: {}", self.out.display(), names.join(", "));
            }
        }
    }

    /// Returns the time spent in trackers and detector, in the detector, and in total, seconds.
    fn seconds(&self) -> [f64; 3] {
        [self.summary.spent, self.summary.detecting, self.total].map(|time| time.as_secs_f64())
    }

    fn one<'a>(&'a self, source: Cow<'a, str>, outputs: Vec<Cow<'a, str>>) -> One<'a> {
        let (s, [seconds, _, total]) = (self.summary, self.seconds());
        One {
            source,
            frames: s.frames,
            seconds,
            fps: s.fps(seconds),
            total_seconds: total,
            total_fps: s.fps(total),
            occluded_frames: s.occluded,
            lost_frames: s.lost,
            outside_frames: s.outside,
            bbox: s.last,
            class: s.class,
            class_name: s.class_name.as_deref(),
            seed: self.seed,
            outputs,
            damaged_frames: s.damaged,
            warnings: &self.warnings,
            error: self.error.as_deref(),
        }
    }

    fn tell_one(&self) {
        let (s, [seconds, _, total]) = (self.summary, self.seconds());
        say!(
            "{} tracked, occluded in {}, lost in {}; {} a second in the tracker, {:.0} end to end.",
            counted(s.frames, "frame"),
            s.occluded,
            s.lost,
            counted(s.fps(seconds).round() as usize, "frame"),
            s.fps(total)
        );
        match s.last {
            Some(b) => {
                say!("Last box: {:.1},{:.1},{:.1},{:.1} (x,y,w,h, counted from 1).", b.x + 1.0, b.y + 1.0, b.w, b.h);
            }
            None => say!("Last box: outside the picture, as in {}.", counted(s.outside, "frame")),
        }
        if let Some((class, p)) = s.class {
            let name = s.class_name.clone().unwrap_or_else(|| format!("class {class}"));
            say!("Recognised as {name}, with probability {p:.3}.");
        }
    }

    fn many(&self, detector: &str, source: &str, outputs: &[Cow<'_, str>]) -> Value {
        let (s, [spent, detecting, total]) = (self.summary, self.seconds());
        json!({
            "source": source, "frames": s.frames, "targets": s.initiated, "reidentified": s.reidentified, "cuts": s.cuts,
            "most_at_a_time": s.most, "detector": detector, "tracking_seconds": (spent - detecting).max(0.0),
            "detecting_seconds": detecting, "total_seconds": total, "total_fps": s.fps(total), "occluded_frames": s.occluded,
            "lost_frames": s.lost, "seed": self.seed, "outputs": outputs,
            "damaged_frames": s.damaged, "warnings": self.warnings, "error": self.error,
        })
    }

    fn tell_many(&self, detector: &str, timed: bool) {
        let (s, [spent, detecting, total]) = (self.summary, self.seconds());
        let tracking = (spent - detecting).max(0.0);
        let detected =
            if timed { format!(", {:.0} with detection", s.fps(tracking + detecting)) } else { String::new() };
        say!(
            "{}, {}, at most {} at a time, {} re-identified, {}; {} a second in the trackers{detected}, {:.0} end to end.",
            counted(s.frames, "frame"),
            counted(s.initiated, "target"),
            s.most,
            s.reidentified,
            counted(s.cuts, "cut"),
            counted(s.fps(tracking).round() as usize, "frame"),
            s.fps(total)
        );
        say!("Detector: {detector}.");
    }
}
