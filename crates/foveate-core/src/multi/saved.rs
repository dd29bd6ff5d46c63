//! The state of many targets in mid-video, from which tracking resumes bit for bit.

use serde::{Deserialize, Serialize};

use super::initiation::TentativeTracks;
use super::occlusion::Fronts;
use super::ranks::Ranks;
use super::target::{SHAPE, Target};
use super::{MOST_ID, MultiTracker};
use crate::control::{Consistency, Cues};
use crate::geometry::{BBox, Covariance, Extent, Gaze, Size, State};
use crate::origin::Origin;
use crate::saved_state::{FORMAT, SavedState, Valid, Validate, ensure, refused};
use crate::seen::{Phase, Seen};
use foveate_base::{Result, memory};

/// Maximum number of frames of a video: 24 days at 1000 a second.
pub(super) const MOST_FRAMES: usize = 1 << 31;

/// Declares the state of a type: those of its fields that are saved.
macro_rules! state {
    ($name:ident of $from:ty { $($field:ident: $type:ty),* $(,)? }) => {
        #[derive(Serialize, Deserialize)]
        struct $name {
            $($field: $type),*
        }

        impl $name {
            fn of(from: &$from) -> Self {
                Self { $($field: Clone::clone(&from.$field)),* }
            }
            fn put(self, into: &mut $from) {
                $(into.$field = self.$field;)*
            }
        }
    };
}

state!(Own of MultiTracker {
    next_id: u64,
    detecting: bool,
    fronts: Fronts,
    tentative: TentativeTracks,
    ranks: Ranks,
    next: usize,
    size: Option<Size>,
});

state!(Track of Seen<'static> {
    id: u64,
    born: usize,
    phase: Phase,
    p_lost: f64,
    own_p_lost: f64,
    cues: Cues,
    bbox: BBox,
    state: State,
    extent: Extent,
    covariance: Covariance,
    gaze: Gaze,
    visible: f64,
    consistency: Consistency,
    waited: usize,
    detected_class: Option<usize>,
    class: Option<(usize, f64)>,
});

state!(Counts of Target {
    lost: usize,
    unseen: usize,
    hidden: usize,
    terminated: usize,
    shape: f64,
    surprise: f64,
});

#[derive(Serialize, Deserialize)]
struct SavedTarget {
    track: Track,
    #[serde(flatten)]
    counts: Counts,
    ensemble: SavedState,
}

#[derive(Serialize, Deserialize)]
struct Saved {
    format: u32,
    origin: Origin,
    #[serde(flatten)]
    own: Own,
    active: Vec<SavedTarget>,
    terminated: Vec<SavedTarget>,
}

impl std::fmt::Debug for MultiTracker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let targets = self.active.len();
        f.debug_struct("MultiTracker").field("origin", &self.origin).field("targets", &targets).finish_non_exhaustive()
    }
}

impl MultiTracker {
    /// Returns the whole state, from which [`MultiTracker::load`] resumes.
    pub fn save(&self) -> SavedState {
        let targets = |targets: &[Target]| targets.iter().map(SavedTarget::of).collect();
        let (active, terminated) = (targets(&self.active), targets(&self.terminated));
        let saved = Saved { format: FORMAT, origin: self.origin.clone(), own: Own::of(self), active, terminated };
        SavedState::new(&saved)
    }

    /// Restores a state that `save` returned, in a tracker of the same configuration and seed. Nothing changes on an error.
    ///
    /// # Errors
    /// [`foveate_base::Error::Invalid`] if these are not saved targets, are of another version, or were saved with another configuration or
    /// seed: the error names the settings that differ.
    pub fn load(&mut self, saved: &SavedState) -> Result<()> {
        saved.check_origin(&self.origin)?;
        let Saved { own, active, terminated, .. } = saved.state("targets", &())?;
        let (n, size) = (active.len() + terminated.len(), own.size.unwrap_or_default());
        memory::check(format_args!("{n} targets"), self.room.with(n, &BBox::new(0.0, 0.0, 0.0, 0.0), size))?;
        let read = |targets: Vec<SavedTarget>| targets.into_iter().map(|t| t.read(self)).collect::<Result<Vec<_>>>();
        (self.active, self.terminated) = (read(active)?, read(terminated)?);
        own.put(self);
        // After a cut there is no size, and the last frame counts as the next one.
        self.frame = self.next.saturating_sub(usize::from(self.size.is_some()));
        self.resumed = true;
        (self.preprocessor, self.full, self.shape) = ((self.fresh)(), false, [size.width, size.height, 1]);
        self.publish();
        Ok(())
    }
}

impl Validate for Saved {
    fn validate(&self, (): &()) -> Valid {
        let Own { next, next_id, tentative, .. } = &self.own;
        let ordered = self.active.is_sorted_by(|a, b| a.track.id < b.track.id) && *next_id <= MOST_ID;
        let targets = || self.active.iter().chain(&self.terminated);
        ensure(ordered && targets().all(|t| t.track.id < *next_id), || "their ids are not in order".into())?;
        ensure(*next <= MOST_FRAMES, || format!("`next` is frame {next}; expected a number up to {MOST_FRAMES}"))?;
        targets().try_for_each(|target| target.validate(next))?;
        tentative.check(*next)
    }
}

impl Validate<usize> for SavedTarget {
    /// The setting is the number of the next frame.
    fn validate(&self, next: &usize) -> Valid {
        let (Track { id, born, waited, covariance, .. }, counts) = (&self.track, &self.counts);
        for (name, frame) in [("born", born), ("terminated", &counts.terminated)] {
            ensure(frame <= next, || {
                format!("`{name}` of target {id} is frame {frame}; expected one up to `next`, {next}")
            })?;
        }
        let Counts { lost, unseen, hidden, shape, .. } = counts;
        for (name, count) in [("lost", lost), ("unseen", unseen), ("hidden", hidden), ("not looked at", waited)] {
            ensure(count <= next, || {
                format!("target {id} was {name} for {count} frames; expected up to `next`, {next}")
            })?;
        }
        ensure((0..State::N).all(|k| covariance[k][k] >= 0.0), || format!("a variance of {id} is less than 0"))?;
        ensure(shape.abs() <= SHAPE, || {
            format!("shape of {id}: expected a logarithm from -{SHAPE} to {SHAPE}, found {shape}")
        })
    }
}

impl SavedTarget {
    fn of(target: &Target) -> Self {
        Self { track: Track::of(&target.track), counts: Counts::of(target), ensemble: target.ensemble.save() }
    }
    fn read(self, trackers: &MultiTracker) -> Result<Target> {
        let Self { track, counts, ensemble } = self;
        let mut target = Target::new((trackers.make)(track.id), Seen::given([1; 3], &track.bbox).in_phase(track.phase));
        target.ensemble.load(&ensemble)?;
        if !target.ensemble.first().has_target() {
            return Err(refused("targets", &format!("{} has no template", track.id)));
        }
        counts.put(&mut target);
        track.put(&mut target.track);
        target.with_buffers(&trackers.pool, |_| ());
        Ok(target)
    }
}
