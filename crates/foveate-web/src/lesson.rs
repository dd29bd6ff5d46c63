//! The paper's digit scenes as a lesson: a learning gaze policy beside a fixed centre and random gazes on the same frames.

use foveate_base::files::Nowhere;
use foveate_base::{Error, Result};
use foveate_core::config::{Blueprint, Config};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;
use foveate_core::{Seen, Tracker};
use foveate_lab::Digits;
use foveate_lab::synthetic::{Clutter, Drawn, GLIMPSE, Occlusion};
use foveate_page::{Row, cells, detail, surface};
use foveate_video::Frame;
use serde::Deserialize;
use serde_json::{Value, json};

/// Digits of each class to choose from.
const PER_CLASS: usize = 20;
/// Number of frames of a scene, and frames per second.
const FRAMES: usize = 300;
const RATE: f64 = 30.0;
/// Side of the enlarged digit, pixels.
const CLOSE: usize = 56;

/// The kind of scene.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    /// A digit among static ones (section 6.1).
    Clutter,
    /// A digit that passes behind bars, seen through a small window (section 6.2).
    Bars,
    /// The bars scene with a window of 5 x 5 pixels, as in `foveate demo`.
    Glimpse,
    /// A digit twice as large, seen through a window of a quarter of its box.
    CloseUp,
}

/// The settings of a scene.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scene {
    kind: Kind,
    /// 0 to 9.
    digit: u8,
    /// Fraction of the pixels with noise, 0 to 1.
    noise: f64,
    /// Number of other digits or of bars; or the side of a black square on the centre of the digit, in 28ths of its box.
    hidden: usize,
    seed: u64,
}

impl Scene {
    fn video(&self) -> Result<Box<dyn Drawn>> {
        let Self { digit, noise, hidden, seed, .. } = *self;
        let (digits, frames) = (Digits::drawn(seed, PER_CLASS), FRAMES);
        let most = |most: usize| {
            if hidden <= most {
                Ok(())
            } else {
                Err(Error::Invalid(format!("expected at most {most}, found {hidden}")))
            }
        };
        Ok(match self.kind {
            Kind::Clutter => {
                most(60)?;
                Box::new(
                    Clutter { digit, seed, noise, frames, distractors: hidden, ..Clutter::default() }.video(&digits)?,
                )
            }
            Kind::Bars | Kind::Glimpse => {
                most(8)?;
                let (shade, side) = if matches!(self.kind, Kind::Bars) { (90, 200) } else { (0, 160) };
                let scene = Occlusion { digit, seed, noise, frames, bars: hidden, shade, ..Occlusion::default() };
                Box::new(Occlusion { width: side, height: side, ..scene }.video(&digits)?)
            }
            Kind::CloseUp => {
                most(28)?;
                let scene = Occlusion {
                    digit,
                    seed,
                    noise,
                    frames,
                    side: CLOSE,
                    bars: 0,
                    patch: hidden,
                    ..Occlusion::default()
                };
                Box::new(scene.video(&digits)?)
            }
        })
    }

    /// Returns the configuration for the scene.
    fn config(&self, policy: &str) -> Result<Config> {
        let name = match (self.kind, policy) {
            (Kind::Clutter, _) => "digits-hedge",
            (Kind::Bars | Kind::Glimpse, _) => "digits-partial",
            (Kind::CloseUp, "pool") => "digits-pool",
            (Kind::CloseUp, _) => "digits-closeup",
        };
        let config =
            Config::builtin(name).ok_or_else(|| Error::Config(format!("no configuration is called {name}")))?;
        let changes = if matches!(self.kind, Kind::Glimpse) { &GLIMPSE[..] } else { &[] };
        changes.iter().try_fold(config?.with_policy(policy)?, |config, change| config.set(change))
    }
}

/// A scene, and its three trackers.
pub(crate) struct Lesson {
    video: Box<dyn Drawn>,
    learning: Tracker,
    fixed: Tracker,
    random: Tracker,
    cells: Vec<f64>,
    policy: String,
    config: String,
    /// The last tracked frame.
    frame: Frame,
}

impl Lesson {
    pub(crate) fn begin(scene: Scene, policy: &str) -> Result<Self> {
        let video = scene.video()?;
        let blueprint = scene.config(policy)?.check(&Nowhere)?;
        let frame = Frame { index: 0, time: 0.0, image: video.render(0) };
        let first = video.truth()[0];
        let begin = |blueprint: &Blueprint| -> Result<Tracker> {
            let mut tracker = blueprint.tracker(scene.seed)?;
            tracker.init(&frame.image, first)?;
            Ok(tracker)
        };
        let other = |policy: &str| begin(&scene.config(policy)?.check(&Nowhere)?);
        let (learning, fixed, random) = (begin(&blueprint)?, other("fixed")?, other("random")?);
        let (cells, config) = (cells(&*blueprint.retina()), blueprint.config().to_toml());
        Ok(Self { video, learning, fixed, random, cells, policy: policy.into(), config, frame })
    }

    pub(crate) fn about(&self) -> Value {
        let Size { width, height } = self.video.size();
        json!({
            "width": width, "height": height, "frames": self.video.truth().len(), "cells": self.cells, "policy": self.policy,
            "config": self.config, "row": Row::of(&self.frame, &Seen::given(self.frame.image.shape(), &self.video.truth()[0])),
        })
    }

    /// Returns the current frame.
    pub(crate) fn picture(&self) -> Vec<u8> {
        rgba(&self.frame.image)
    }

    /// Tracks the next frame; returns `{"ended": true}` after the last one.
    pub(crate) fn step(&mut self) -> Result<Value> {
        let index = self.frame.index + 1;
        let Some(truth) = self.video.truth().get(index).copied() else { return Ok(json!({ "ended": true })) };
        let image: Image = self.video.render(index);
        self.frame = Frame { index, time: index as f64 / RATE, image };
        let follow = |tracker: &mut Tracker| -> Result<Value> {
            let seen = tracker.update(&self.frame.image)?;
            let detail: Value = serde_json::from_str(&detail(index + 1, &seen)).unwrap_or_default();
            let reward = seen.rewards.get(seen.plan.chosen_index()).copied().unwrap_or(0.0);
            let shown = surface(seen.snapshot);
            let row = Row::of(&self.frame, &seen);
            Ok(
                json!({ "row": row, "detail": detail, "reward": reward, "surface": shown, "error": error(&seen.bbox, &truth) }),
            )
        };
        let (learning, fixed, random) =
            (follow(&mut self.learning)?, follow(&mut self.fixed)?, follow(&mut self.random)?);
        let truth = [truth.x, truth.y, truth.w, truth.h];
        Ok(json!({ "ended": false, "truth": truth, "learning": learning, "fixed": fixed, "random": random }))
    }
}

/// Returns the distance of the centres, pixels.
fn error(a: &BBox, b: &BBox) -> f64 {
    let ((ax, ay), (bx, by)) = (a.centre(), b.centre());
    (ax - bx).hypot(ay - by)
}

/// Returns red, green, blue and an alpha of 255, pixel by pixel.
pub(crate) fn rgba(image: &Image) -> Vec<u8> {
    let plane = |p: usize| image.plane(p.min(image.planes() - 1));
    let colours = plane(0).iter().zip(plane(1)).zip(plane(2));
    let mut out = Vec::with_capacity(4 * image.width() * image.height());
    colours.for_each(|((r, g), b)| out.extend_from_slice(&[*r, *g, *b, 255]));
    out
}
