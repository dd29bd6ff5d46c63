//! The state of many targets in mid-video, from which tracking resumes bit for bit.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::initiation::TentativeTracks;
use super::occlusion::Fronts;
use super::ranks::Ranks;
use super::target::{SHAPE, Target};
use super::{MOST_ID, MultiTracker};
use crate::control::Consistency;
use crate::geometry::{BBox, Covariance, Extent, Gaze, State};
use crate::origin::Origin;
use crate::seen::{Phase, Seen};
use foveate_base::{Error, Result, memory};

/// Maximum number of frames of a video: 24 days at 1000 a second.
pub(super) const MOST_FRAMES: usize = 1 << 31;

/// The format number.
const FORMAT: u32 = 11;

#[derive(Serialize, Deserialize)]
struct Saved {
    format: u32,
    origin: Origin,
    next_id: u64,
    detecting: bool,
    fronts: Fronts,
    tentative: TentativeTracks,
    ranks: Ranks,
    /// The number of the next picture, and the size of all pictures.
    next: usize,
    size: Option<(usize, usize)>,
    active: Vec<SavedTarget>,
    terminated: Vec<SavedTarget>,
}

#[derive(Serialize, Deserialize)]
struct SavedTarget {
    track: SavedTrack,
    lost: usize,
    unseen: usize,
    hidden: usize,
    terminated: usize,
    shape: f64,
    surprise: f64,
    ensemble: Value,
}

/// The result of a target's last frame: see [`Seen`].
#[derive(Serialize, Deserialize)]
struct SavedTrack {
    id: u64,
    born: usize,
    phase: Phase,
    #[serde(default)]
    p_lost: f64,
    bbox: BBox,
    state: State,
    extent: Extent,
    covariance: Covariance,
    gaze: Gaze,
    visible: f64,
    deficit: f64,
    waited: usize,
    detected_class: Option<usize>,
    class: Option<(usize, f64)>,
}

impl SavedTrack {
    fn of(seen: &Seen<'_>) -> Self {
        let Seen { id, born, phase, p_lost, bbox, state, extent, covariance, gaze, visible, .. } = *seen;
        let Seen { consistency: Consistency { deficit, .. }, waited, detected_class, class, .. } = *seen;
        Self {
            id,
            born,
            phase,
            p_lost,
            bbox,
            state,
            extent,
            covariance,
            gaze,
            visible,
            deficit,
            waited,
            detected_class,
            class,
        }
    }

    fn seen(self) -> Seen<'static> {
        let Self { id, born, phase, p_lost, bbox, state, extent, covariance, gaze, visible, deficit, .. } = self;
        let Self { waited, detected_class, class, .. } = self;
        let consistency = Consistency { deficit, ..Consistency::default() };
        let given = Seen::given([1; 3], &bbox).in_phase(phase);
        let belief = Seen { p_lost, state, extent, covariance, gaze, visible, consistency, ..given };
        Seen { id, born, waited, detected_class, class, ..belief }
    }
}

impl std::fmt::Debug for MultiTracker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let targets = self.active.len();
        f.debug_struct("MultiTracker").field("origin", &self.origin).field("targets", &targets).finish_non_exhaustive()
    }
}

impl MultiTracker {
    /// Returns the whole state, from which [`MultiTracker::load`] resumes.
    pub fn save(&self) -> Value {
        let targets = |targets: &[Target]| targets.iter().map(SavedTarget::of).collect();
        let saved = Saved {
            format: FORMAT,
            origin: self.origin.clone(),
            next_id: self.next_id,
            detecting: self.detecting,
            fronts: self.fronts.clone(),
            tentative: self.tentative.clone(),
            ranks: self.ranks.clone(),
            next: self.next,
            size: self.size,
            active: targets(&self.active),
            terminated: targets(&self.terminated),
        };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Restores a state that `save` returned, in a tracker of the same configuration and seed. Nothing changes on an error.
    ///
    /// # Errors
    /// [`Error::Invalid`] if these are not saved targets, are of another version, or were saved with another configuration or seed: the
    /// error names the settings that differ.
    pub fn load(&mut self, saved: &Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved targets cannot be used: {what}"));
        // Check the format first: targets of another format have other fields.
        if let Some(format) = saved["format"].as_u64().filter(|format| *format != u64::from(FORMAT)) {
            return Err(bad(format!("their format is {format}, this program writes and reads {FORMAT}")));
        }
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        self.origin.check(&saved.origin).map_err(bad)?;
        let ordered = saved.active.is_sorted_by(|a, b| a.track.id < b.track.id);
        let ids = ordered && saved.next_id <= MOST_ID;
        if !ids || saved.active.iter().chain(&saved.terminated).any(|t| t.track.id >= saved.next_id) {
            return Err(bad("their ids are not in order".into()));
        }
        saved.check_frames().map_err(bad)?;
        let (n, size) = (saved.active.len() + saved.terminated.len(), saved.size.unwrap_or_default());
        memory::check(format_args!("{n} targets"), self.room.with(n, &BBox::new(0.0, 0.0, 0.0, 0.0), size))?;
        let read = |targets: Vec<SavedTarget>| targets.into_iter().map(|t| t.read(self)).collect::<Result<Vec<_>>>();
        let (active, terminated) = (read(saved.active)?, read(saved.terminated)?);
        (self.active, self.terminated) = (active, terminated);
        (self.next, self.frame, self.size, self.resumed) = (saved.next, saved.next, saved.size, true);
        (self.next_id, self.detecting) = (saved.next_id, saved.detecting);
        (self.fronts, self.tentative, self.ranks) = (saved.fronts, saved.tentative, saved.ranks);
        let (width, height) = size;
        (self.preprocessor, self.full, self.shape) = ((self.fresh)(), false, [width, height, 1]);
        self.publish();
        Ok(())
    }
}

impl Saved {
    /// Checks that no saved frame number is after the present one.
    fn check_frames(&self) -> std::result::Result<(), String> {
        let next = self.next;
        if next > MOST_FRAMES {
            return Err(format!("`next` is frame {next}; expected a number up to {MOST_FRAMES}"));
        }
        for t in self.active.iter().chain(&self.terminated) {
            let id = t.track.id;
            for (name, frame) in [("born", t.track.born), ("terminated", t.terminated)] {
                if frame > next {
                    return Err(format!("`{name}` of target {id} is frame {frame}; expected one up to `next`, {next}"));
                }
            }
            let counts =
                [("lost", t.lost), ("unseen", t.unseen), ("hidden", t.hidden), ("not looked at", t.track.waited)];
            for (name, count) in counts {
                if count > next {
                    return Err(format!("target {id} was {name} for {count} frames; expected up to `next`, {next}"));
                }
            }
        }
        self.tentative.check(next)
    }
}

impl SavedTarget {
    fn of(target: &Target) -> Self {
        let Target { track, lost, unseen, hidden, terminated, shape, surprise, .. } = *target;
        let track = SavedTrack::of(&track);
        Self { track, lost, unseen, hidden, terminated, shape, surprise, ensemble: target.ensemble.save() }
    }
    fn read(self, trackers: &MultiTracker) -> Result<Target> {
        let mut ensemble = (trackers.make)(self.track.id);
        ensemble.load(&self.ensemble)?;
        if !ensemble.first().has_target() {
            return Err(Error::Invalid(format!("the saved targets cannot be used: {} has no template", self.track.id)));
        }
        let Self { track, lost, unseen, hidden, terminated, shape, surprise, .. } = self;
        if (0..State::N).any(|k| track.covariance[k][k] < 0.0) {
            let problem = format!("a variance of {} is less than 0", track.id);
            return Err(Error::Invalid(format!("the saved targets cannot be used: {problem}")));
        }
        if shape.abs() > SHAPE {
            let expected = format!("expected a logarithm from -{SHAPE} to {SHAPE}, found {shape}");
            return Err(Error::Invalid(format!("the saved targets cannot be used: shape of {}: {expected}", track.id)));
        }
        let mut target =
            Target { lost, unseen, hidden, terminated, shape, surprise, ..Target::new(ensemble, track.seen()) };
        target.with_buffers(&trackers.pool, |_| ());
        Ok(target)
    }
}
