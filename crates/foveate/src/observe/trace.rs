//! trace.jsonl: every intermediate quantity of a run, one JSON object a line and frame, for those who want to look.

use std::path::PathBuf;

use serde::Serialize;

use super::Observer;
use super::heat::Heat;
use super::sink::Sink;
use crate::Result;
use crate::control::{Trust, Watch};
use crate::gaze::Portrait;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::Frame;
use crate::step::Step;

/// Writes what [`Step`] holds, under its names. Numbers that are not finite are `null`; others read back bit for bit.
#[derive(Debug)]
pub struct Trace {
    file: Sink,
    line: Vec<u8>,
}

/// A line for a frame whose box was given.
#[derive(Serialize)]
struct Given<'a> {
    frame: usize,
    time: f64,
    given: &'a BBox,
}

/// A line for a frame that was tracked. `frame` counts from 1, boxes from 0.
#[derive(Serialize)]
struct Tracked<'a> {
    frame: usize,
    time: f64,
    bbox: BBox,
    estimate: State,
    covariance: [[f64; 6]; 6],
    ess: f64,
    log_evidence: f64,
    watch: Watch,
    trust: Trust,
    extent: Extent,
    /// Predicted particles: x, y, vx, vy, log_scale, angle.
    predicted: Vec<[f64; 6]>,
    weights: &'a [f64],
    ancestors: &'a [usize],
    plan: Plan<'a>,
    rewards: &'a [f64],
    /// Gazes scored for observers alone, and their rewards; left out where there are none.
    #[serde(skip_serializing_if = "<[Gaze]>::is_empty")]
    recorded_gazes: &'a [Gaze],
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    recorded_rewards: &'a [f64],
    gaze_evidence: &'a [f64],
    percept: Percept<'a>,
    /// Probabilities of classes over all frames so far, those of this frame's own decision, and where it looked for
    /// them; left out without a recogniser.
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    classes: &'a [f64],
    /// What the likeliest is called; left out where classes have numbers alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    class: Option<&'a str>,
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    own_classes: &'a [f64],
    #[serde(skip_serializing_if = "<[Gaze]>::is_empty")]
    recognition_gazes: &'a [Gaze],
    portrait: Option<Shown<'a>>,
}

#[derive(Serialize)]
struct Plan<'a> {
    gazes: &'a [Gaze],
    used: &'a [bool],
    weights: &'a [f64],
    chosen: usize,
}

#[derive(Serialize)]
struct Percept<'a> {
    gaze: Gaze,
    glimpse: &'a [f32],
    features: &'a [f32],
    distance: f64,
}

/// What the policy has learned.
#[derive(Serialize)]
#[serde(untagged)]
enum Shown<'a> {
    Arms {
        gazes: &'a [Gaze],
        probabilities: &'a [f64],
    },
    /// A reward surface at points × points gazes from −reach to reach, row by row from the top.
    Surface {
        points: usize,
        reach: f64,
        mean: Vec<f64>,
        best: Option<Gaze>,
    },
}

/// Points along a side of a reward surface.
const POINTS: usize = 11;

impl Trace {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Sink::create(path)?, line: vec![] })
    }
    fn put(&mut self, object: &impl Serialize) -> Result<()> {
        self.line.clear();
        serde_json::to_writer(&mut self.line, object).expect("plain data is JSON, and memory takes it");
        self.line.push(b'\n');
        self.file.write(&self.line)?;
        self.file.flush()
    }
}

impl Observer for Trace {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.put(&Given { frame: frame.index + 1, time: frame.time, given: bbox })
    }

    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        let p = step.percept;
        self.put(&Tracked {
            frame: step.frame.index + 1,
            time: step.frame.time,
            bbox: step.bbox(),
            estimate: step.estimate,
            covariance: step.covariance,
            ess: step.ess,
            log_evidence: step.log_evidence,
            watch: step.watch,
            trust: step.trust,
            extent: step.extent,
            predicted: step.predicted.iter().map(State::to_array).collect(),
            weights: step.weights,
            ancestors: step.ancestors,
            plan: Plan {
                gazes: step.plan.gazes(),
                used: step.plan.used(),
                weights: step.plan.weights(),
                chosen: step.plan.chosen_index(),
            },
            rewards: step.rewards,
            recorded_gazes: step.plan.recorded(),
            recorded_rewards: step.recorded,
            gaze_evidence: step.gaze_evidence,
            percept: Percept { gaze: p.gaze, glimpse: &p.glimpse, features: &p.features, distance: p.distance },
            classes: step.classes,
            class: step.class().and_then(|(class, _)| step.class_names.get(class)).map(String::as_str),
            own_classes: step.own_classes,
            recognition_gazes: step.recognition_gazes,
            portrait: match step.portrait {
                Portrait::Arms { gazes, probabilities } => Some(Shown::Arms { gazes, probabilities }),
                Portrait::Surface(surface) => {
                    let Heat { n, reach, mean, .. } = Heat::of(surface, POINTS);
                    Some(Shown::Surface { points: n, reach, mean, best: surface.best() })
                }
                Portrait::Blank => None,
            },
        })
    }

    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}
