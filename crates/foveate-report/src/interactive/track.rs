//! What a page asks about the track of a video that is open, and the JSON that it is answered. Frames are counted from 1 there.

use std::path::Path;
use std::sync::Arc;

use super::command::command;
use super::player::Frames;
use super::propose::propose;
use super::row::cells;
use super::tracking::{Log, Setup, Tracking};
use foveate_base::{Error, Result};
use foveate_core::config::{BUILTIN, Config, about};
use foveate_core::geometry::BBox;
use foveate_video::{Frame, SourceInfo};
use serde_json::{Value, json};

/// Pixels of a frame, at most: a decoded one has three bytes for each, and a page holds a few.
const MOST_PIXELS: usize = 1 << 25;
/// Frames tracked for one message, at most.
const MOST_STEPS: usize = 200;

/// The track of a video, once there is one.
#[derive(Default)]
pub struct Track(Option<Tracking>);

impl Track {
    /// The track.
    ///
    /// # Errors
    /// There is none yet.
    pub fn get(&self) -> Result<&Tracking> {
        self.0.as_ref().ok_or_else(untracked)
    }
    fn get_mut(&mut self) -> Result<&mut Tracking> {
        self.0.as_mut().ok_or_else(untracked)
    }
    /// How many frames it has.
    pub fn frames(&self) -> usize {
        self.0.as_ref().map_or(0, |tracking| tracking.rows().len())
    }
    /// The frame that was decoded last for it.
    pub fn decoded(&self) -> Option<&Arc<Frame>> {
        self.0.as_ref().and_then(Tracking::decoded)
    }

    /// Starts on a box in a frame; any track before is forgotten.
    ///
    /// # Errors
    /// As [`Tracking::start`].
    pub fn start(
        &mut self,
        frames: Box<dyn Frames>,
        log: Box<dyn Log>,
        setup: Setup,
        frame: usize,
        bbox: BBox,
    ) -> Result<Value> {
        self.0 = None;
        let (cells, policy) = (cells(&*setup.blueprint.retina()), setup.blueprint.config().policy_kind());
        let tracking = Tracking::start(frames, log, setup, frame.saturating_sub(1), bbox)?;
        let rows = json!(tracking.rows());
        self.0 = Some(tracking);
        Ok(json!({ "rows": rows, "cells": cells, "policy": policy, "ended": false }))
    }

    /// Tracks some frames; none after the first where `enough` says so.
    ///
    /// # Errors
    /// There is no track, or as [`Tracking::step`].
    pub fn step(&mut self, frames: usize, enough: impl Fn() -> bool) -> Result<Value> {
        let tracking = self.get_mut()?;
        let before = tracking.rows().len();
        tracking.step(frames.clamp(1, MOST_STEPS), enough)?;
        let rows = &tracking.rows()[before..];
        let (detail, surface) = (parsed(tracking.detail(tracking.last())), tracking.surface());
        Ok(json!({ "rows": rows, "detail": detail, "surface": surface, "ended": tracking.ended() }))
    }

    /// What is known of a frame beside its row.
    pub fn detail(&self, frame: usize) -> Value {
        let detail = self.0.as_ref().and_then(|tracking| tracking.detail(frame.saturating_sub(1)));
        json!({ "detail": parsed(detail) })
    }

    /// A box by hand in a frame that was tracked.
    ///
    /// # Errors
    /// There is no track, or as [`Tracking::correct`].
    pub fn correct(&mut self, frame: usize, bbox: BBox) -> Result<Value> {
        let tracking = self.get_mut()?;
        tracking.correct(frame.saturating_sub(1), bbox)?;
        Ok(json!({ "rows": &tracking.rows()[tracking.rows().len() - 1..], "ended": false }))
    }

    /// The command that gives this track of a video.
    ///
    /// # Errors
    /// There is no track.
    pub fn command(&self, video: &Path) -> Result<String> {
        let tracking = self.get()?;
        let given: Vec<(usize, BBox)> = tracking.given().iter().map(|(k, b)| (*k, *b)).collect();
        let Setup { config, policy, seed, blueprint } = &tracking.setup;
        let seed = Some(*seed).filter(|seed| *seed != blueprint.config().seed);
        let mut line = command(video, &given, config, policy.as_deref(), seed);
        if !tracking.ended() && tracking.last() > tracking.first() {
            line += &format!(" --until {}", tracking.last() + 1);
        }
        Ok(line)
    }
}

fn untracked() -> Error {
    Error::Invalid("nothing is tracked yet; draw a box and start".into())
}

fn parsed(text: Option<&str>) -> Value {
    text.and_then(|text| serde_json::from_str(text).ok()).unwrap_or(Value::Null)
}

/// A box as the page has it: left, top, width, height.
pub fn boxed([x, y, w, h]: [f64; 4]) -> BBox {
    BBox { x, y, w, h }
}

/// What the page is told of a video.
pub fn described(info: &SourceInfo, exact: bool, truth: &[Option<BBox>]) -> Value {
    let truth: Vec<_> = truth.iter().map(|b| b.map(|b| [b.x, b.y, b.w, b.h])).collect();
    json!({
        "width": info.width, "height": info.height, "frames": info.frames, "exact": exact, "rate": info.rate,
        "reader": info.reader, "truth": truth,
    })
}

/// Fails where frames are too large for a page.
///
/// # Errors
/// [`Error::Malformed`], which says how large they are.
pub fn check_size(info: &SourceInfo, video: &Path) -> Result<()> {
    let (w, h) = (info.width, info.height);
    if w.saturating_mul(h) <= MOST_PIXELS {
        return Ok(());
    }
    let problem = format!("frames of {w} x {h} are too large for the page; track it with `foveate track --scale`");
    Err(Error::malformed(video, problem))
}

/// A box about a place in a frame, or without one about the most salient.
///
/// # Errors
/// There is no such frame.
pub fn proposed(frames: &mut dyn Frames, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
    let [other, frame] = frames.pair(frame.saturating_sub(1))?;
    let frame = frame.ok_or_else(|| Error::Invalid("the video has no such frame; choose an earlier one".into()))?;
    let at = at.filter(|(x, y)| x.is_finite() && y.is_finite());
    let (b, from) = propose(other.as_ref().map(|f| &f.image), &frame.image, at);
    Ok(json!({ "box": [b.x, b.y, b.w, b.h], "from": from }))
}

/// The configurations that ship and are for one target, of those that fit: names, and what they are for.
pub fn offered(fits: impl Fn(Config) -> bool) -> Vec<Value> {
    let single = |config: Config| config.multi_target.is_none() && fits(config);
    let all = BUILTIN.iter().filter(|(name, text)| Config::parse(text, name).is_ok_and(single));
    all.map(|(name, text)| json!({ "name": name, "for": about(text) })).collect()
}
