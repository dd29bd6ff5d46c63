//! A video that is open: its frames, its track, its results.

use std::path::Path;
use std::sync::Arc;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_report::interactive::Reopen;
use foveate_report::interactive::{Frames, Player, Setup, Tracking, cells, command, propose};
use foveate_report::{Clock, RunInfo, Warnings};
use foveate_video::SourceInfo;
use serde_json::{Value, json};

use crate::live::Live;
use crate::log::{Lines, Log, NAMES};
use crate::save::Saving;
use crate::store::Video;

/// Pixels of a frame, at most.
const MOST_PIXELS: usize = 1 << 25;
/// Frames tracked for one message, and frames of a report made for one, at most.
const MOST_STEPS: usize = 200;
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
    tracking: Option<Tracking>,
    lines: Lines,
    saving: Option<Saving>,
}

pub fn boxed([x, y, w, h]: [f64; 4]) -> BBox {
    BBox { x, y, w, h }
}

fn untracked() -> Error {
    Error::Invalid("nothing is tracked yet; draw a box and start".into())
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
        let (w, h) = (info.width, info.height);
        if w.saturating_mul(h) > MOST_PIXELS {
            let problem = format!("frames of {w} x {h} are too large for the page; use `foveate track --scale`");
            return Err(Error::malformed(Path::new(&name), problem));
        }
        let frames = source.frames();
        Ok(Self { name, source, info, truth, frames, tracking: None, lines: Lines::default(), saving: None })
    }

    pub fn about(&self) -> Value {
        let truth: Vec<_> = self.truth.iter().map(|b| b.map(|b| [b.x, b.y, b.w, b.h])).collect();
        json!({
            "width": self.info.width, "height": self.info.height, "frames": self.info.frames,
            "exact": self.info.frames.is_some(), "rate": self.info.rate, "reader": self.info.reader, "truth": truth,
        })
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
        let decoded = self.tracking.as_ref().and_then(Tracking::decoded).filter(|frame| frame.index == index);
        let frame = match decoded {
            Some(frame) => Some(Arc::clone(frame)),
            None => self.frames.frame(index)?,
        };
        Ok(frame.map(|frame| rgba(&frame.image)))
    }

    pub fn propose(&mut self, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
        let index = frame.saturating_sub(1);
        // The frame before, or after the first one; a camera's may be gone.
        let other = if index > 0 { index - 1 } else { 1 };
        let other = self.frames.frame(other).ok().flatten();
        let frame = self.frames.frame(index)?;
        let frame = frame.ok_or_else(|| Error::Invalid("the video has no such frame; choose an earlier one".into()))?;
        let at = at.filter(|(x, y)| x.is_finite() && y.is_finite());
        let (b, from) = propose(other.as_ref().map(|f| &f.image), &frame.image, at);
        Ok(json!({ "box": [b.x, b.y, b.w, b.h], "from": from }))
    }

    pub fn start(&mut self, setup: Setup, frame: usize, bbox: BBox, policy: &str) -> Result<Value> {
        self.check(&bbox)?;
        let retina = setup.blueprint.retina();
        (self.tracking, self.saving, self.lines) = (None, None, Lines::default());
        let meter = match &self.source {
            Source::Live(live) => Some(live.meter.clone()),
            Source::Video(_) => None,
        };
        let log = Box::new(Log::new(self.lines.clone(), meter));
        let tracking = Tracking::start(self.source.frames(), log, setup, frame.saturating_sub(1), bbox)?;
        let rows = json!(tracking.rows());
        self.tracking = Some(tracking);
        Ok(json!({ "rows": rows, "cells": cells(&*retina), "policy": policy, "ended": false }))
    }

    pub fn step(&mut self, frames: usize) -> Result<Value> {
        let tracking = self.tracking.as_mut().ok_or_else(untracked)?;
        let before = tracking.rows().len();
        tracking.step(frames.clamp(1, MOST_STEPS), || false)?;
        let rows = &tracking.rows()[before..];
        if !rows.is_empty() {
            self.saving = None;
        }
        let (detail, surface) = (parsed(tracking.detail(tracking.last())), tracking.surface());
        Ok(json!({ "rows": rows, "detail": detail, "surface": surface, "ended": tracking.ended() }))
    }

    pub fn detail(&self, frame: usize) -> Value {
        let detail = self.tracking.as_ref().and_then(|t| t.detail(frame.saturating_sub(1)));
        json!({ "detail": parsed(detail) })
    }

    pub fn correct(&mut self, frame: usize, bbox: BBox) -> Result<Value> {
        self.check(&bbox)?;
        let tracking = self.tracking.as_mut().ok_or_else(untracked)?;
        self.saving = None;
        tracking.correct(frame.saturating_sub(1), bbox)?;
        Ok(json!({ "rows": &tracking.rows()[tracking.rows().len() - 1..], "ended": false }))
    }

    /// The command that gives this track; empty where there is none, as for a camera.
    pub fn command(&self) -> Result<String> {
        let tracking = self.tracking.as_ref().ok_or_else(untracked)?;
        if matches!(self.source, Source::Live(_)) {
            return Ok(String::new());
        }
        let given: Vec<(usize, BBox)> = tracking.given().iter().map(|(k, b)| (*k, *b)).collect();
        let Setup { config, policy, seed, blueprint } = &tracking.setup;
        let seed = Some(*seed).filter(|seed| *seed != blueprint.config().seed);
        let mut line = command(Path::new(&self.name), &given, config, policy.as_deref(), seed);
        if !tracking.ended() && tracking.last() > tracking.first() {
            line += &format!(" --until {}", tracking.last() + 1);
        }
        Ok(line)
    }

    /// Begins to make the files that are not there anyway.
    pub fn save(&mut self, report: bool) -> Result<Value> {
        let tracking = self.tracking.as_ref().ok_or_else(untracked)?;
        let (setup, given) = (&tracking.setup, tracking.given().clone());
        self.saving = None;
        if report && matches!(self.source, Source::Video(_)) {
            let info = RunInfo {
                source: self.name.clone(),
                reader: self.info.reader.clone(),
                rate: self.info.rate,
                bit_rate: None,
                config_name: setup.config.clone(),
                config_text: setup.blueprint.config().to_toml(),
                seed: setup.seed,
                command: self.command()?,
                retina: Some(setup.blueprint.retina()),
                truth: self.truth.iter().map_while(|bbox| *bbox).collect(),
                baseline: None,
                clock: Clock::default(),
                shadow: vec![],
                warnings: Warnings::default(),
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

fn parsed(text: Option<&str>) -> Value {
    text.and_then(|text| serde_json::from_str(text).ok()).unwrap_or(Value::Null)
}

/// Red, green, blue and an alpha of 255, pixel by pixel.
pub fn rgba(image: &foveate_core::scene::Image) -> Vec<u8> {
    let plane = |p: usize| image.plane(p.min(image.planes() - 1));
    let colours = plane(0).iter().zip(plane(1)).zip(plane(2));
    let mut out = Vec::with_capacity(4 * image.width() * image.height());
    colours.for_each(|((r, g), b)| out.extend_from_slice(&[*r, *g, *b, 255]));
    out
}
