//! A video that is open: its frames, its track, its results.

use std::path::Path;
use std::sync::Arc;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_report::RunInfo;
use foveate_report::interactive::{Frames, Player, Reopen, Setup, Track, check_size, described, proposed};
use foveate_video::SourceInfo;
use serde_json::{Value, json};

use crate::live::Live;
use crate::log::{Lines, Log, NAMES};
use crate::save::Saving;
use crate::store::Video;

/// Frames of a report made for one message, at most.
const REPORTED: usize = 10;

/// Where frames come from.
#[derive(Clone)]
pub enum Source {
    Video(Video),
    Live(Live),
}

impl Source {
    fn frames(&self) -> Box<dyn Frames> {
        match self {
            Self::Video(video) => Box::new(Player::new(video.clone())),
            Self::Live(live) => Box::new(live.clone()),
        }
    }
}

pub struct Session {
    name: String,
    source: Source,
    info: SourceInfo,
    truth: Vec<Option<BBox>>,
    /// Frames that are looked at, but not tracked.
    frames: Box<dyn Frames>,
    track: Track,
    lines: Lines,
    saving: Option<Saving>,
}

impl Session {
    /// A video file or pictures.
    pub fn open(name: String, video: Video, truth: Vec<Option<BBox>>) -> Result<Self> {
        let info = video.source(0)?.info().clone();
        Self::new(name, Source::Video(video), info, truth)
    }

    /// Frames that will be pushed.
    pub fn live(name: String, width: usize, height: usize, rate: f64) -> Result<Self> {
        let info = SourceInfo { width, height, frames: None, rate, reader: "the browser".into() };
        Self::new(name, Source::Live(Live::new(width, height)), info, vec![])
    }

    fn new(name: String, source: Source, info: SourceInfo, truth: Vec<Option<BBox>>) -> Result<Self> {
        check_size(&info, Path::new(&name))?;
        let frames = source.frames();
        Ok(Self { name, source, info, truth, frames, track: Track::default(), lines: Lines::default(), saving: None })
    }

    pub fn about(&self) -> Value {
        described(&self.info, self.info.frames.is_some(), &self.truth)
    }

    /// Takes the next frame of a camera; its number from 0.
    pub fn push(&self, rgba: &[u8], time: f64, missed: u64) -> Result<usize> {
        match &self.source {
            Source::Live(live) => live.push(rgba, time, missed),
            Source::Video(_) => Err(Error::Invalid("this video is read, not pushed".into())),
        }
    }

    /// The pixels of a frame (from 0), red, green, blue, alpha; `None` where the video ends before.
    pub fn picture(&mut self, index: usize) -> Result<Option<Vec<u8>>> {
        let decoded = self.track.decoded().filter(|frame| frame.index == index);
        let frame = match decoded {
            Some(frame) => Some(Arc::clone(frame)),
            None => self.frames.frame(index)?,
        };
        Ok(frame.map(|frame| rgba(&frame.image)))
    }

    pub fn propose(&mut self, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
        proposed(&mut *self.frames, frame, at)
    }

    pub fn start(&mut self, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        self.check(&bbox)?;
        (self.saving, self.lines) = (None, Lines::default());
        let meter = match &self.source {
            Source::Live(live) => Some(live.meter.clone()),
            Source::Video(_) => None,
        };
        let log = Box::new(Log::new(self.lines.clone(), meter));
        self.track.start(self.source.frames(), log, setup, frame, bbox)
    }

    pub fn step(&mut self, frames: usize) -> Result<Value> {
        let before = self.track.frames();
        let answer = self.track.step(frames, || false)?;
        if self.track.frames() > before {
            self.saving = None;
        }
        Ok(answer)
    }

    pub fn detail(&self, frame: usize) -> Value {
        self.track.detail(frame)
    }

    pub fn correct(&mut self, frame: usize, bbox: BBox) -> Result<Value> {
        self.check(&bbox)?;
        self.saving = None;
        self.track.correct(frame, bbox)
    }

    /// The command that gives this track; empty where there is none, as for a camera.
    pub fn command(&self) -> Result<String> {
        match self.source {
            Source::Live(_) => self.track.get().map(|_| String::new()),
            Source::Video(_) => self.track.command(Path::new(&self.name)),
        }
    }

    /// Begins to make the files that are not there anyway.
    pub fn save(&mut self, report: bool) -> Result<Value> {
        let tracking = self.track.get()?;
        let (setup, given) = (&tracking.setup, tracking.given().clone());
        self.saving = None;
        if report && matches!(self.source, Source::Video(_)) {
            let info = RunInfo {
                command: self.command()?,
                truth: self.truth.iter().map_while(|bbox| *bbox).collect(),
                ..RunInfo::of(self.name.clone(), &self.info, setup.config.clone(), &setup.blueprint, setup.seed)
            };
            self.saving = Some(Saving::begin(setup, info, self.source.frames(), given, tracking.last())?);
        }
        Ok(json!({}))
    }

    /// How far that is; with the names of the files once they are whole.
    pub fn saved(&mut self) -> Result<Value> {
        let mut names = NAMES.to_vec();
        let Some(saving) = &mut self.saving else { return Ok(json!({ "frames": 0, "files": names })) };
        saving.go_on(REPORTED)?;
        if saving.page.is_none() {
            return Ok(json!({ "frames": saving.count, "files": null }));
        }
        names.push("report.html");
        Ok(json!({ "frames": saving.count, "files": names }))
    }

    pub fn file(&self, name: &str) -> Option<Vec<u8>> {
        match name {
            "report.html" => self.saving.as_ref()?.page.clone(),
            _ => self.lines.file(name).map(String::into_bytes),
        }
    }

    fn check(&self, b: &BBox) -> Result<()> {
        let (w, h) = (self.info.width as f64, self.info.height as f64);
        let whole = [b.x, b.y, b.w, b.h].iter().all(|v| v.is_finite()) && b.w >= 2.0 && b.h >= 2.0;
        if whole && b.x < w && b.y < h && b.x + b.w > 0.0 && b.y + b.h > 0.0 && b.w <= 2.0 * w && b.h <= 2.0 * h {
            return Ok(());
        }
        Err(Error::Invalid(format!(
            "the box: expected one of at least 2 x 2 pixels that touches the frame of {w} x {h}, found left {}, top {}, width {}, \
             height {}; draw another",
            b.x + 1.0,
            b.y + 1.0,
            b.w,
            b.h
        )))
    }
}

/// Red, green, blue and an alpha of 255, pixel by pixel.
pub fn rgba(image: &foveate_core::scene::Image) -> Vec<u8> {
    let plane = |p: usize| image.plane(p.min(image.planes() - 1));
    let colours = plane(0).iter().zip(plane(1)).zip(plane(2));
    let mut out = Vec::with_capacity(4 * image.width() * image.height());
    colours.for_each(|((r, g), b)| out.extend_from_slice(&[*r, *g, *b, 255]));
    out
}
