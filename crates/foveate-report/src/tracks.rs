//! tracks.txt, tracks.csv and targets.csv: many targets as plain numbers.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use crate::Observer;
use crate::columns::{TARGETS, TRACKS};
use crate::csv::{Csv, Rows};
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_core::Seen;
use foveate_core::geometry::BBox;
use foveate_core::multi::Phase;
use foveate_video::Frame;

/// tracks.txt in MOTChallenge's format: [`crate::columns::TRACKS_TXT`], frames and pixels counted from 1. Lost targets are left out,
/// because their boxes are guesses.
#[derive(Debug)]
pub struct MotFile {
    file: Sink,
    line: String,
}

impl MotFile {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self::to(Sink::create(path)?))
    }

    /// Writes the tracks to `file`.
    pub fn to(file: Sink) -> Self {
        Self { file, line: String::new() }
    }
}

impl Observer for MotFile {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.line.clear();
        for target in targets.iter().filter(|target| target.is_usable()) {
            mot_line(&mut self.line, frame, target.id, &target.bbox, (1.0 - target.consistency.deficit).max(0.0));
        }
        self.file.write(self.line.as_bytes())?;
        self.file.flush()
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

/// Writes a line of MOTChallenge's text.
pub(super) fn mot_line(text: &mut String, frame: &Frame, id: u64, b: &BBox, confidence: f64) {
    let (n, x, y) = (frame.index + 1, b.x + 1.0, b.y + 1.0);
    let _ = writeln!(text, "{n},{id},{x:.3},{y:.3},{:.3},{:.3},{confidence:.3},-1,-1,-1", b.w, b.h);
}

/// tracks.csv: every active target in every frame, including lost ones, with the columns [`TRACKS`].
#[derive(Debug)]
pub struct TracksTable {
    file: Csv,
    /// The number of each target's first frame, which a tracker does not know if frames were dropped.
    first: BTreeMap<u64, usize>,
}

impl TracksTable {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Csv::create(path, TRACKS)?, first: BTreeMap::new() })
    }

    /// Writes the table to `file`; the header comes with the first row.
    pub fn to(file: Sink) -> Self {
        Self { file: Csv::to(file, TRACKS), first: BTreeMap::new() }
    }
}

impl Observer for TracksTable {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Self { file, first } = self;
        file.write(|row| {
            for target in targets {
                let first = *first.entry(target.id).or_insert(frame.index + 1);
                let (b, c) = (target.bbox, &target.covariance);
                row.put(frame.index + 1);
                row.put(frame.time);
                row.put(target.id);
                row.put(target.phase.name());
                row.put_all(&[b.x, b.y, b.w, b.h]);
                row.put_all(&target.state.to_array());
                row.put_all(&[
                    c[0][0].sqrt(),
                    c[1][1].sqrt(),
                    target.consistency.deficit,
                    target.p_lost,
                    target.visible,
                ]);
                row.put(target.waited);
                row.put(u8::from(target.detection.is_some()));
                put_number(row, target.detection_index);
                put_number(row, target.detected_class);
                row.put_all(&[target.gaze.u, target.gaze.v]);
                row.put(first);
                put_class(row, target.class);
                row.end();
            }
        })
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

/// Adds a number, or an empty cell.
fn put_number(row: &mut Rows, number: Option<usize>) {
    match number {
        Some(number) => row.put(number),
        None => row.put(""),
    }
}

/// Adds class and probability; empty cells without a recogniser.
fn put_class(row: &mut Rows, class: Option<(usize, f64)>) {
    if let Some((class, p)) = class {
        row.put(class);
        row.put(p);
    }
}

/// The row of a target in targets.csv.
#[derive(Clone, Debug, Default)]
struct Track {
    first: usize,
    last: usize,
    frames: usize,
    occluded: usize,
    lost: usize,
    detected: usize,
    reidentified: usize,
    class: Option<(usize, f64)>,
}

/// targets.csv: one line per target, with the columns [`TARGETS`].
#[derive(Debug)]
pub struct TargetsTable {
    file: Csv,
    tracks: BTreeMap<u64, Track>,
}

impl TargetsTable {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Csv::create(path, TARGETS)?, tracks: BTreeMap::new() })
    }
}

impl Observer for TargetsTable {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        for target in targets {
            let number = frame.index + 1;
            let track = self.tracks.entry(target.id).or_insert_with(|| Track { first: number, ..Track::default() });
            track.last = number;
            track.frames += 1;
            track.occluded += usize::from(target.phase == Phase::Occluded);
            track.lost += usize::from(target.phase == Phase::Lost);
            track.detected += usize::from(target.detection.is_some());
            track.reidentified += usize::from(target.phase == Phase::ReIdentified);
            track.class = target.class.or(track.class);
        }
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        let tracks = std::mem::take(&mut self.tracks);
        if !tracks.is_empty() {
            self.file.write(|row| {
                for (id, t) in &tracks {
                    row.put(id);
                    for number in [t.first, t.last, t.frames, t.occluded, t.lost, t.detected, t.reidentified] {
                        row.put(number);
                    }
                    put_class(row, t.class);
                    row.end();
                }
            })?;
        }
        self.file.finish()
    }
}
