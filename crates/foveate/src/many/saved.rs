//! The state of many targets in mid-video, to go on from bit for bit.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::births::Nursery;
use super::occlusion::Fronts;
use super::{Many, Target};
use crate::observe::Seen;
use crate::{Error, Result};

/// The format number.
const FORMAT: u32 = 2;

#[derive(Serialize, Deserialize)]
struct Saved {
    format: u32,
    next_id: u64,
    detecting: bool,
    fronts: Fronts,
    nursery: Nursery,
    living: Vec<SavedTarget>,
    dead: Vec<SavedTarget>,
}

#[derive(Serialize, Deserialize)]
struct SavedTarget {
    seen: Seen,
    lost: usize,
    unseen: usize,
    died: usize,
    shape: f64,
    tracker: Value,
}

impl Many {
    /// Everything there is to go on from with [`Many::load`].
    pub fn save(&self) -> Value {
        let targets = |targets: &[Target]| targets.iter().map(SavedTarget::of).collect();
        let saved = Saved {
            format: FORMAT,
            next_id: self.next_id,
            detecting: self.detecting,
            fronts: self.fronts.clone(),
            nursery: self.nursery.clone(),
            living: targets(&self.living),
            dead: targets(&self.dead),
        };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Takes up what `save` gave, among trackers of the same configuration and seed. Nothing changes where it fails.
    pub fn load(&mut self, saved: &Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved targets cannot be used: {what}"));
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        if saved.format != FORMAT {
            return Err(bad(format!("their format is {}, this program writes and reads {FORMAT}", saved.format)));
        }
        let ordered = saved.living.is_sorted_by(|a, b| a.seen.id < b.seen.id);
        if !ordered || saved.living.iter().chain(&saved.dead).any(|t| t.seen.id >= saved.next_id) {
            return Err(bad("their ids are not in order".into()));
        }
        let read = |targets: Vec<SavedTarget>| targets.into_iter().map(|t| t.read(self)).collect::<Result<Vec<_>>>();
        let (living, dead) = (read(saved.living)?, read(saved.dead)?);
        (self.living, self.dead) = (living, dead);
        (self.next_id, self.detecting) = (saved.next_id, saved.detecting);
        (self.fronts, self.nursery) = (saved.fronts, saved.nursery);
        self.tell();
        Ok(())
    }
}

impl SavedTarget {
    fn of(target: &Target) -> Self {
        let Target { tracker, seen, lost, unseen, died, shape } = target;
        Self { seen: *seen, lost: *lost, unseen: *unseen, died: *died, shape: *shape, tracker: tracker.save() }
    }
    fn read(self, many: &Many) -> Result<Target> {
        let mut tracker = (many.make)(self.seen.id);
        tracker.load(&self.tracker)?;
        if !tracker.is_started() {
            return Err(Error::Invalid(format!("the saved targets cannot be used: {} has no template", self.seen.id)));
        }
        let Self { seen, lost, unseen, died, shape, .. } = self;
        Ok(Target { tracker, seen, lost, unseen, died, shape })
    }
}
