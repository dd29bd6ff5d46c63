//! What a page asks about the track of a video that is open, and the JSON that it is answered. Frames are counted from 1 there.

use std::path::Path;
use std::sync::Arc;

use super::command::command;
use super::lines::{LineLog, Lines};
use super::player::{Frames, Shared};
use super::propose::propose;
use super::row::cells;
use super::tracking::{Log, MOST_FRAMES, Setup, Tracking};
use foveate_base::{Error, Result};
use foveate_core::config::{BUILTIN, Config, OFFERED, about};
use foveate_core::geometry::BBox;
use foveate_video::{Frame, Meter, SourceInfo};
use serde_json::{Value, json};

/// Pixels of a frame, at most: a decoded one has three bytes for each, and a page holds a few.
const MOST_PIXELS: usize = 1 << 25;
/// Targets of a video, at most: each takes time.
pub const MOST_TARGETS: usize = 8;
/// Frames tracked for one message, at most.
const MOST_STEPS: usize = 200;

/// What becomes of the results of targets as they are tracked.
#[derive(Clone)]
pub enum Results {
    /// They are not kept: who wants them runs the track once more.
    Again,
    /// They are kept as text; of a source without an end those of the last frames, with what its meter counts.
    Kept(Option<Meter>),
}

/// The tracks of a video: one for each target, all on the same frames.
pub struct Tracks {
    frames: Shared,
    results: Results,
    all: Vec<(Tracking, Lines)>,
}

impl Tracks {
    /// Of no target yet.
    pub fn new(frames: Box<dyn Frames>, results: Results) -> Self {
        Self { frames: Shared::new(frames), results, all: vec![] }
    }

    /// The track of a target, from 0.
    ///
    /// # Errors
    /// There is none yet.
    pub fn get(&self, target: usize) -> Result<&Tracking> {
        self.all.get(target).map(|(tracking, _)| tracking).ok_or_else(|| untracked(target))
    }
    fn get_mut(&mut self, target: usize) -> Result<&mut Tracking> {
        self.all.get_mut(target).map(|(tracking, _)| tracking).ok_or_else(|| untracked(target))
    }
    /// How many targets there are.
    pub fn count(&self) -> usize {
        self.all.len()
    }
    /// What was kept of a target's results.
    pub fn lines(&self, target: usize) -> Option<&Lines> {
        self.all.get(target).map(|(_, lines)| lines)
    }
    /// How many frames all of them have together.
    pub fn frames(&self) -> usize {
        self.all.iter().map(|(tracking, _)| tracking.frames()).sum()
    }
    /// The frame (from 0) that is tracked next: of the target that is farthest behind. `None` where there is none.
    pub fn next(&self) -> Option<usize> {
        self.all.iter().filter(|(t, _)| !t.ended()).map(|(t, _)| t.last() + 1).min()
    }
    /// The frame that was decoded last for them.
    pub fn decoded(&self) -> Option<Arc<Frame>> {
        self.frames.newest()
    }

    /// Starts a target on a box in a frame. One that is there is forgotten; one that is not there must be the next.
    ///
    /// # Errors
    /// There are targets enough, or as [`Tracking::start`].
    pub fn start(&mut self, target: usize, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        if target > self.all.len() || target >= MOST_TARGETS {
            let there = self.all.len();
            let problem =
                format!("{there} targets are followed, {MOST_TARGETS} at most, and each is added after the others");
            return Err(Error::Invalid(problem + "; remove one, or start one of these anew"));
        }
        let (cells, policy) = (cells(&*setup.blueprint.retina()), setup.blueprint.config().policy_kind());
        let (lines, log): (Lines, Box<dyn Log>) = match &self.results {
            Results::Again => (Lines::default(), Box::new(())),
            Results::Kept(meter) => {
                let lines = if self.frames.repeats() { Lines::default() } else { Lines::of_last(MOST_FRAMES) };
                (lines.clone(), Box::new(LineLog::new(lines, meter.clone())))
            }
        };
        let player = Box::new(self.frames.clone());
        let mut tracking = Tracking::start(player, log, setup, frame.saturating_sub(1), bbox)?;
        let rows = tracking.take_rows();
        match self.all.get_mut(target) {
            Some(place) => *place = (tracking, lines),
            None => self.all.push((tracking, lines)),
        }
        Ok(json!({ "rows": rows, "cells": cells, "policy": policy, "ended": false }))
    }

    /// Forgets a target; those after it move up.
    ///
    /// # Errors
    /// There is no such target.
    pub fn remove(&mut self, target: usize) -> Result<Value> {
        self.get(target)?;
        self.all.remove(target);
        Ok(json!({}))
    }

    /// Tracks some frames; none after the first where `enough` says so. Targets that are behind catch up first, so that all see a
    /// frame while it is there.
    ///
    /// # Errors
    /// There is no target, or as [`Tracking::step`].
    pub fn step(&mut self, frames: usize, enough: impl Fn() -> bool) -> Result<Value> {
        self.get(0)?;
        for done in 0..frames.clamp(1, MOST_STEPS) {
            let Some(next) = self.next().filter(|_| done == 0 || !enough()) else { break };
            let due = self.all.iter_mut().filter(|(t, _)| !t.ended() && t.last() + 1 == next);
            due.map(|(tracking, _)| tracking).try_for_each(Tracking::step)?;
        }
        let answer = |(tracking, _): &mut (Tracking, Lines)| {
            let rows = tracking.take_rows();
            let detail = parsed(tracking.detail(tracking.last()).filter(|_| !rows.is_empty()));
            json!({ "rows": rows, "detail": detail, "surface": tracking.surface(), "ended": tracking.ended() })
        };
        Ok(json!({ "targets": self.all.iter_mut().map(answer).collect::<Vec<_>>() }))
    }

    /// What is known of a frame beside its row.
    pub fn detail(&self, target: usize, frame: usize) -> Value {
        let detail = self.get(target).ok().and_then(|tracking| tracking.detail(frame.saturating_sub(1)));
        json!({ "detail": parsed(detail) })
    }

    /// A box by hand in a frame that was tracked.
    ///
    /// # Errors
    /// There is no such target, or as [`Tracking::correct`].
    pub fn correct(&mut self, target: usize, frame: usize, bbox: BBox) -> Result<Value> {
        let tracking = self.get_mut(target)?;
        tracking.correct(frame.saturating_sub(1), bbox)?;
        Ok(json!({ "rows": tracking.take_rows().pop().into_iter().collect::<Vec<_>>(), "ended": false }))
    }

    /// The commands that give these tracks of a video, a line a target.
    ///
    /// # Errors
    /// There is no target.
    pub fn command(&self, video: &Path) -> Result<String> {
        self.get(0)?;
        Ok((0..self.all.len()).filter_map(|target| self.line(target, video).ok()).collect::<Vec<_>>().join("\n"))
    }

    /// The command that gives one target's track.
    ///
    /// # Errors
    /// There is no such target.
    pub fn line(&self, target: usize, video: &Path) -> Result<String> {
        let tracking = self.get(target)?;
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

fn untracked(target: usize) -> Error {
    Error::Invalid(match target {
        0 => "nothing is tracked yet; draw a box and start".into(),
        _ => format!("there is no target {}; add it first", target + 1),
    })
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

/// The configurations that ship and are for one target, of those that fit, by purpose: group, name, title, and what each is for.
pub fn offered(fits: impl Fn(Config) -> bool) -> Vec<Value> {
    let single = |config: Config| config.multi_target.is_none() && fits(config);
    let all = OFFERED.iter().flat_map(|(group, some)| some.iter().map(move |(name, title)| (group, name, title)));
    all.filter_map(|(group, name, title)| {
        let (_, text) = BUILTIN.iter().find(|builtin| builtin.0 == *name)?;
        Config::parse(text, name)
            .is_ok_and(&single)
            .then(|| json!({ "group": group, "name": name, "title": title, "for": about(text) }))
    })
    .collect()
}
