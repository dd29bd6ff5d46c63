//! What a run prints at its end.

use std::path::{Path, PathBuf};
use std::time::Duration;

use foveate::report::Summary;
use foveate::report::run::RunSummary;
use foveate::text::counted;
use foveate::video::without_password;

/// The end of a run.
pub struct Ending<'a> {
    pub source: &'a Path,
    pub out: &'a Path,
    pub seed: u64,
    pub json: bool,
    /// The detector of many targets, and whether the program runs it: then its time is known. `None` of one target.
    pub detector: Option<(String, bool)>,
    pub summary: &'a RunSummary,
    /// The files, where they are now; none if nothing was tracked.
    pub files: &'a [PathBuf],
    /// From the first frame to the last file.
    pub total: Duration,
    /// Warnings for the readers of the results.
    pub warnings: Vec<String>,
    pub error: Option<String>,
}

impl Ending<'_> {
    /// Prints it.
    pub fn tell(&self) {
        match (&self.detector, self.json) {
            (None, true) => say!("{}", self.one().to_json()),
            (Some((detector, _)), true) => say!("{:#}", self.many(detector)),
            (_, false) if self.files.is_empty() => {}
            (detector, false) => {
                match detector {
                    None => self.tell_one(),
                    Some((detector, timed)) => self.tell_many(detector, *timed),
                }
                self.warnings.iter().for_each(|warning| say!("Warning: {warning}"));
                let names = self.files.iter().filter_map(|file| file.file_name());
                let names: Vec<String> = names.map(|name| name.to_string_lossy().into()).collect();
                say!("{}: {}", self.out.display(), names.join(", "));
            }
        }
    }

    fn seconds(&self) -> (f64, f64) {
        (self.summary.spent.as_secs_f64(), self.total.as_secs_f64())
    }

    fn rate(&self, seconds: f64) -> f64 {
        Summary::rate(self.summary.frames, seconds)
    }

    fn one(&self) -> Summary {
        let (s, (seconds, total)) = (self.summary, self.seconds());
        Summary {
            source: without_password(&self.source.to_string_lossy()).into_owned(),
            frames: s.frames,
            seconds,
            fps: self.rate(seconds),
            total_seconds: total,
            total_fps: self.rate(total),
            occluded_frames: s.occluded,
            lost_frames: s.lost,
            outside_frames: s.outside,
            bbox: s.last,
            class: s.class,
            class_name: s.class_name.clone(),
            seed: self.seed,
            outputs: self.files.to_vec(),
            damaged_frames: s.damaged,
            warnings: self.warnings.clone(),
            error: self.error.clone(),
        }
    }

    fn tell_one(&self) {
        let (s, (seconds, total)) = (self.summary, self.seconds());
        say!(
            "{} tracked, occluded in {}, lost in {}; {} a second in the tracker, {:.0} end to end.",
            counted(s.frames, "frame"),
            s.occluded,
            s.lost,
            counted(self.rate(seconds).round() as usize, "frame"),
            self.rate(total)
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

    /// Time spent in the trackers, in the detector, and in all, seconds.
    fn shares(&self) -> [f64; 3] {
        let ((spent, total), detecting) = (self.seconds(), self.summary.detecting.as_secs_f64());
        [(spent - detecting).max(0.0), detecting, total]
    }

    fn many(&self, detector: &str) -> serde_json::Value {
        let (s, [tracking, detecting, total]) = (self.summary, self.shares());
        // A name need not be Unicode.
        let outputs: Vec<_> = self.files.iter().map(|file| file.to_string_lossy()).collect();
        serde_json::json!({
            "source": without_password(&self.source.to_string_lossy()), "frames": s.frames, "targets": s.initiated, "reidentified": s.reidentified,
            "cuts": s.cuts, "most_at_a_time": s.most, "detector": detector, "tracking_seconds": tracking,
            "detecting_seconds": detecting, "total_seconds": total, "total_fps": self.rate(total), "seed": self.seed,
            "outputs": outputs, "damaged_frames": s.damaged, "warnings": self.warnings, "error": self.error,
        })
    }

    fn tell_many(&self, detector: &str, timed: bool) {
        let (s, [tracking, detecting, total]) = (self.summary, self.shares());
        let detected =
            if timed { format!(", {:.0} with detection", self.rate(tracking + detecting)) } else { String::new() };
        say!(
            "{}, {}, at most {} at a time, {} re-identified, {}; {} a second in the trackers{detected}, {:.0} end to end.",
            counted(s.frames, "frame"),
            counted(s.initiated, "target"),
            s.most,
            s.reidentified,
            counted(s.cuts, "cut"),
            counted(self.rate(tracking).round() as usize, "frame"),
            self.rate(total)
        );
        say!("Detector: {detector}.");
    }
}
