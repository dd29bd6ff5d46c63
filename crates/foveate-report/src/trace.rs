//! trace.jsonl: every intermediate quantity of a run, one JSON object per frame. Its keys are those of [`crate::columns::TRACE`].

use std::path::PathBuf;

use serde::Serialize;

use crate::Observer;
use crate::heat::Heat;
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_core::Seen;
use foveate_core::control::{Consistency, TrackConfidence};
use foveate_core::gaze::PolicySnapshot;
use foveate_core::geometry::{BBox, Covariance, Extent, Gaze, State};
use foveate_video::Frame;

/// Writes the contents of [`Seen`] under its names: the keys [`crate::columns::TRACE`]. Numbers that are not finite are `null`; others read
/// back bit for bit.
#[derive(Debug)]
pub struct Trace {
    file: Sink,
    line: Vec<u8>,
}

/// A line for a frame with a given box.
#[derive(Serialize)]
struct Given<'a> {
    frame: usize,
    time: f64,
    given: &'a BBox,
}

/// A line for a tracked frame. `frame` counts from 1, boxes from 0.
#[derive(Serialize)]
struct Tracked<'a> {
    frame: usize,
    time: f64,
    bbox: BBox,
    estimate: State,
    covariance: Covariance,
    ess: f64,
    log_evidence: f64,
    consistency: Consistency,
    confidence: TrackConfidence,
    extent: Extent,
    /// Predicted particles: x, y, vx, vy, log_scale, angle, log_aspect.
    predicted: Vec<[f64; State::N]>,
    weights: &'a [f64],
    ancestors: &'a [usize],
    plan: Plan<'a>,
    rewards: &'a [f64],
    /// Gazes scored only for observers, and their rewards; omitted if there are none.
    #[serde(skip_serializing_if = "<[Gaze]>::is_empty")]
    recorded_gazes: &'a [Gaze],
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    recorded_rewards: &'a [f64],
    gaze_evidence: &'a [f64],
    percept: Percept<'a>,
    /// Omitted without a recogniser, with all related fields.
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    classes: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    class: Option<&'a str>,
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    own_classes: &'a [f64],
    #[serde(skip_serializing_if = "<[Gaze]>::is_empty")]
    recognition_gazes: &'a [Gaze],
    snapshot: Option<Snapshot<'a>>,
}

#[derive(Serialize)]
struct Plan<'a> {
    gazes: &'a [Gaze],
    used: Vec<bool>,
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

/// The state of the policy.
#[derive(Serialize)]
#[serde(untagged)]
enum Snapshot<'a> {
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
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
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
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first() else { return Ok(()) };
        if seen.is_given() {
            return self.put(&Given { frame: frame.index + 1, time: frame.time, given: &seen.bbox });
        }
        let p = seen.percept;
        self.put(&Tracked {
            frame: frame.index + 1,
            time: frame.time,
            bbox: seen.bbox,
            estimate: seen.state,
            covariance: seen.covariance,
            ess: seen.ess,
            log_evidence: seen.log_evidence,
            consistency: seen.consistency,
            confidence: TrackConfidence {
                p_lost: seen.p_lost,
                own: seen.own_p_lost,
                status: seen.status,
                cues: seen.cues,
            },
            extent: seen.extent,
            predicted: seen.particles.iter().map(State::to_array).collect(),
            weights: seen.weights,
            ancestors: seen.ancestors,
            plan: Plan {
                gazes: seen.plan.gazes(),
                used: seen.plan.weights().iter().map(|weight| *weight > 0.0).collect(),
                weights: seen.plan.weights(),
                chosen: seen.plan.chosen_index(),
            },
            rewards: seen.rewards,
            recorded_gazes: seen.plan.recorded(),
            recorded_rewards: seen.recorded,
            gaze_evidence: seen.gaze_evidence,
            percept: Percept { gaze: p.gaze, glimpse: &p.glimpse, features: &p.features, distance: p.distance },
            classes: seen.classes,
            class: seen.class.and_then(|(class, _)| seen.class_names.get(class)).map(String::as_str),
            own_classes: seen.own_classes,
            recognition_gazes: seen.recognition_gazes,
            snapshot: match seen.snapshot {
                PolicySnapshot::Arms { gazes, probabilities } => Some(Snapshot::Arms { gazes, probabilities }),
                PolicySnapshot::Surface(surface) => {
                    let Heat { n, reach, mean, .. } = Heat::of(surface, POINTS);
                    Some(Snapshot::Surface { points: n, reach, mean, best: surface.best() })
                }
                PolicySnapshot::Blank => None,
            },
        })
    }

    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}
