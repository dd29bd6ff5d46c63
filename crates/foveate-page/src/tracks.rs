//! The tracks of a video, one for each target, and their JSON for the page.

use std::path::Path;
use std::sync::Arc;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_video::{Frame, Meter};
use serde_json::{Value, json};

use crate::command::command;
use crate::lines::Lines;
use crate::player::{Frames, Kept};
use crate::row::cells;
use crate::tracking::{MOST_FRAMES, Setup, Tracking};

/// Maximum number of targets of a video: each takes time.
pub(crate) const MOST_TARGETS: usize = 8;
/// Maximum number of frames tracked per message.
const MOST_STEPS: usize = 200;

/// The tracks of a video: one for each target, all on the same frames.
pub(crate) struct Tracks {
    frames: Kept,
    /// Counts the frames that a camera or a stream dropped.
    meter: Option<Meter>,
    all: Vec<Tracking>,
}

impl Tracks {
    /// Creates tracks without a target.
    pub(crate) fn new(frames: Box<dyn Frames>, meter: Option<Meter>) -> Self {
        Self { frames: Kept::new(frames), meter, all: vec![] }
    }

    /// Returns the track of a target, from 0.
    ///
    /// # Errors
    /// There is no such target.
    pub(crate) fn get(&self, target: usize) -> Result<&Tracking> {
        self.all.get(target).ok_or_else(|| untracked(target))
    }
    /// Returns the number of targets.
    pub(crate) fn count(&self) -> usize {
        self.all.len()
    }
    /// Returns the total number of frames of all targets.
    pub(crate) fn frames(&self) -> usize {
        self.all.iter().map(Tracking::frames).sum()
    }
    /// Returns the frame (from 0) that is tracked next: that of the target that is farthest behind. `None` without a target.
    pub(crate) fn next(&self) -> Option<usize> {
        self.all.iter().filter(|t| !t.ended()).map(|t| t.last() + 1).min()
    }
    /// Returns the frame that was last decoded for the tracks.
    pub(crate) fn decoded(&self) -> Option<Arc<Frame>> {
        self.frames.last.clone()
    }

    /// Starts a target on a box in a frame (from 0); replaces the target with that number, or adds the next one.
    ///
    /// # Errors
    /// There are too many targets, or as [`Tracking::start`].
    pub(crate) fn start(&mut self, target: usize, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        if target > self.all.len() || target >= MOST_TARGETS {
            let there = self.all.len();
            let problem =
                format!("{there} targets are followed, {MOST_TARGETS} at most, and each is added after the others");
            return Err(Error::Invalid(problem + "; remove one, or start one of these anew"));
        }
        let (cells, policy) = (cells(&*setup.blueprint.retina()), setup.blueprint.config().policy_kind());
        let most = (!self.frames.repeats()).then_some(MOST_FRAMES);
        let lines = Lines::new(most, self.meter.clone(), self.frames.remarks());
        let mut tracking = Tracking::start(&mut self.frames, lines, setup, frame, bbox)?;
        let rows = tracking.take_rows();
        match self.all.get_mut(target) {
            Some(place) => *place = tracking,
            None => self.all.push(tracking),
        }
        Ok(json!({ "rows": rows, "cells": cells, "policy": policy, "ended": false }))
    }

    /// Removes a target; later ones move up.
    ///
    /// # Errors
    /// There is no such target.
    pub(crate) fn remove(&mut self, target: usize) -> Result<Value> {
        self.get(target)?;
        self.all.remove(target);
        Ok(json!({}))
    }

    /// Tracks up to this number of frames; stops after the first one when `enough` returns true. Targets that are behind catch up first, so
    /// that all targets get a frame while it is available.
    ///
    /// # Errors
    /// There is no target, or as [`Tracking::step`] if nothing was tracked. Otherwise the error is part of the answer.
    pub(crate) fn step(&mut self, frames: usize, enough: impl Fn() -> bool) -> Result<Value> {
        self.get(0)?;
        let (before, mut problem) = (self.frames(), None);
        for done in 0..frames.min(MOST_STEPS) {
            let Some(next) = self.next().filter(|_| done == 0 || !enough()) else { break };
            let mut due = self.all.iter_mut().filter(|t| !t.ended() && t.last() + 1 == next);
            if let Err(error) = due.try_for_each(|tracking| tracking.step(&mut self.frames)) {
                if self.frames() == before {
                    return Err(error);
                }
                problem = Some(error.to_string());
                break;
            }
        }
        let answer = |tracking: &mut Tracking| {
            let rows = tracking.take_rows();
            let detail = parsed(tracking.detail(tracking.last()).filter(|_| !rows.is_empty()));
            json!({ "rows": rows, "detail": detail, "surface": tracking.surface(), "ended": tracking.ended() })
        };
        Ok(json!({ "targets": self.all.iter_mut().map(answer).collect::<Vec<_>>(), "problem": problem }))
    }

    /// Returns particles, glimpse and gazes of a frame (from 1).
    pub(crate) fn detail(&self, target: usize, frame: usize) -> Value {
        let detail = self.get(target).ok().and_then(|tracking| tracking.detail(frame.saturating_sub(1)));
        json!({ "detail": parsed(detail) })
    }

    /// Sets a box by hand in a tracked frame (from 0).
    ///
    /// # Errors
    /// There is no such target, or as [`Tracking::correct`].
    pub(crate) fn correct(&mut self, target: usize, frame: usize, bbox: BBox) -> Result<Value> {
        let tracking = self.all.get_mut(target).ok_or_else(|| untracked(target))?;
        tracking.correct(&mut self.frames, frame, bbox)?;
        Ok(json!({ "rows": tracking.take_rows().pop().into_iter().collect::<Vec<_>>(), "ended": false }))
    }

    /// Returns the commands that reproduce these tracks of a video, one line per target.
    ///
    /// # Errors
    /// There is no target.
    pub(crate) fn command(&self, video: &Path) -> Result<String> {
        self.get(0)?;
        Ok((0..self.all.len()).filter_map(|target| self.line(target, video).ok()).collect::<Vec<_>>().join("\n"))
    }

    /// Returns the command that reproduces one target's track.
    ///
    /// # Errors
    /// There is no such target.
    pub(crate) fn line(&self, target: usize, video: &Path) -> Result<String> {
        let tracking = self.get(target)?;
        let given: Vec<(usize, BBox)> = tracking.given().iter().map(|(k, b)| (*k, *b)).collect();
        let Setup { config, policy, seed, blueprint } = &tracking.setup;
        let seed = Some(*seed).filter(|seed| *seed != blueprint.config().seed);
        let mut line = command(video, &given, config, policy.as_deref(), seed);
        if !tracking.ended() {
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
