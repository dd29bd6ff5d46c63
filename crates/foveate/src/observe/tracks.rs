//! tracks.txt, tracks.csv and targets.csv: many targets as plain numbers.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use super::many::{ManyObserver, Phase, Seen};
use super::sink::Sink;
use crate::Result;
use crate::scene::Frame;

/// tracks.txt as MOTChallenge has it: `frame,id,x,y,w,h,conf,-1,-1,-1` a line, frames and pixels counted from 1. Boxes of
/// targets believed lost are guesses and left out; `conf` is 1 − doubt, at least 0.
#[derive(Debug)]
pub struct MotFile {
    file: Sink,
    line: String,
}

impl MotFile {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Sink::create(path)?, line: String::new() })
    }
}

impl ManyObserver for MotFile {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        self.line.clear();
        for seen in targets.iter().filter(|seen| seen.sure()) {
            let (b, sure) = (seen.bbox, (1.0 - seen.doubt).max(0.0));
            let (n, id, x, y) = (frame.index + 1, seen.id, b.x + 1.0, b.y + 1.0);
            let _ = writeln!(self.line, "{n},{id},{x:.3},{y:.3},{:.3},{:.3},{sure:.3},-1,-1,-1", b.w, b.h);
        }
        self.file.write(self.line.as_bytes())?;
        self.file.flush()
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

/// tracks.csv: a line a living target a frame, also where it is believed lost. Columns, by name in the first line:
///
/// - `frame` counted from 1, `time` in seconds, `id`; `phase`: born, found, followed, hidden or lost;
/// - `left,top,width,height`: the box, counted from 0, in pixels; `x … angle`: the state; `sd_x,sd_y` in pixels;
/// - `lost`: 1 if believed lost, else 0; `doubt`; `visible`: share not covered by other targets; `detected`: 1 if a detection was
///   taken to be it, else 0; `gaze_u,gaze_v`; `class`, counted from 0, and `class_probability`, empty without a recogniser;
/// - `born`: the frame it was first seen in, counted from 1.
#[derive(Debug)]
pub struct TracksTable {
    file: Sink,
    line: String,
}

const COLUMNS: &str = "frame,time,id,phase,left,top,width,height,x,y,vx,vy,log_scale,angle,sd_x,sd_y,lost,doubt,visible,detected,\
                       gaze_u,gaze_v,class,class_probability,born\n";

impl TracksTable {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let mut file = Sink::create(path)?;
        file.write(COLUMNS.as_bytes())?;
        Ok(Self { file, line: String::new() })
    }
}

impl ManyObserver for TracksTable {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        self.line.clear();
        for s in targets {
            let _ = write!(self.line, "{},{},{},{}", frame.index + 1, frame.time, s.id, name(s.phase));
            let (b, c) = (s.bbox, &s.covariance);
            let flag = |yes: bool| f64::from(u8::from(yes));
            let before = [b.x, b.y, b.w, b.h];
            let after = [
                c[0][0].sqrt(),
                c[1][1].sqrt(),
                flag(s.phase == Phase::Lost),
                s.doubt,
                s.visible,
                flag(s.detection.is_some()),
                s.gaze.u,
                s.gaze.v,
            ];
            for number in before.iter().chain(&s.state.to_array()).chain(&after) {
                let _ = write!(self.line, ",{number}");
            }
            let _ = match s.class {
                Some((class, p)) => write!(self.line, ",{class},{p}"),
                None => write!(self.line, ",,"),
            };
            let _ = writeln!(self.line, ",{}", s.born + 1);
        }
        self.file.write(self.line.as_bytes())?;
        self.file.flush()
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Born => "born",
        Phase::Found => "found",
        Phase::Followed => "followed",
        Phase::Hidden => "hidden",
        Phase::Lost => "lost",
    }
}

/// One target's life.
#[derive(Clone, Debug, Default)]
struct Life {
    first: usize,
    last: usize,
    frames: usize,
    lost: usize,
    hidden: usize,
    found: usize,
    detected: usize,
    class: Option<(usize, f64)>,
}

/// targets.csv: a line a target. Columns, by name in the first line: `id`; `first,last`: the frames of its life, counted from 1;
/// `frames` it was alive in; of these `lost`, `hidden` and `detected`; `found`: how often it came back; `class` and
/// `class_probability` at the end.
#[derive(Debug)]
pub struct TargetsTable {
    file: Sink,
    lives: BTreeMap<u64, Life>,
    finished: bool,
}

impl TargetsTable {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Sink::create(path)?, lives: BTreeMap::new(), finished: false })
    }
}

impl ManyObserver for TargetsTable {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        for seen in targets {
            let life = self.lives.entry(seen.id).or_insert_with(|| Life { first: frame.index + 1, ..Life::default() });
            life.last = frame.index + 1;
            life.frames += 1;
            life.lost += usize::from(seen.phase == Phase::Lost);
            life.hidden += usize::from(seen.phase == Phase::Hidden);
            life.found += usize::from(seen.phase == Phase::Found);
            life.detected += usize::from(seen.detection.is_some());
            life.class = seen.class.or(life.class);
        }
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        if std::mem::replace(&mut self.finished, true) {
            return Ok(());
        }
        let mut text = String::from("id,first,last,frames,lost,hidden,detected,found,class,class_probability\n");
        for (id, l) in &self.lives {
            let (first, last, frames) = (l.first, l.last, l.frames);
            let _ = write!(text, "{id},{first},{last},{frames},{},{},{},{}", l.lost, l.hidden, l.detected, l.found);
            let _ = match l.class {
                Some((class, p)) => writeln!(text, ",{class},{p}"),
                None => writeln!(text, ",,"),
            };
        }
        self.file.write(text.as_bytes())?;
        self.file.finish()
    }
}
