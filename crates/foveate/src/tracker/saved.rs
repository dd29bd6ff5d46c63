//! A tracker in mid-video as plain data, to go on from.

use serde::{Deserialize, Serialize};

use super::{Target, Tracker};
use crate::gaze::Context;
use crate::geometry::State;
use crate::recognition::Recognition;
use crate::{Error, Result};

/// The format number of saved trackers.
const FORMAT: u32 = 6;
/// More frames than any video has.
const MOST_FRAMES: u64 = 1 << 48;

#[derive(Serialize, Deserialize)]
struct Saved {
    format: u32,
    frame: u64,
    target: Option<Target>,
    particles: Vec<State>,
    /// JSON has no −∞: a particle without weight has none.
    log_weights: Vec<Option<f64>>,
    proposal: serde_json::Value,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    aspect: Option<serde_json::Value>,
    policy: serde_json::Value,
    appearance: serde_json::Value,
    vigilance: serde_json::Value,
    confidence: serde_json::Value,
    context: Context,
    /// None of a tracker that did not recognise; one that does begins then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    recognizer: Option<serde_json::Value>,
}

impl Tracker {
    /// The whole state of the filter in mid-video, to go on from bit for bit with [`Tracker::load`].
    pub fn save(&self) -> serde_json::Value {
        let saved = Saved {
            format: FORMAT,
            frame: self.frame,
            target: self.target,
            particles: self.particles.clone(),
            log_weights: self.log_carried.iter().map(|w| w.is_finite().then_some(*w)).collect(),
            proposal: self.parts.proposal.save(),
            aspect: self.parts.aspect.map(|aspect| aspect.save()),
            policy: self.parts.policy.save(),
            appearance: self.parts.appearance.save(),
            vigilance: self.parts.vigilance.save(),
            confidence: self.parts.confidence.save(),
            context: self.context,
            recognizer: self.parts.recognizer.as_ref().map(Recognition::save),
        };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Takes up what `save` gave, in a tracker made from the same configuration and seed. After an error the tracker
    /// has to be started anew.
    pub fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved tracker cannot be used: {what}"));
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        if saved.format != FORMAT {
            return Err(bad(format!("its format is {}, this program writes and reads {FORMAT}", saved.format)));
        }
        let n = self.particles.len();
        if saved.particles.len() != n || saved.log_weights.len() != n {
            return Err(bad(format!(
                "it has {} particles and {} weights, this tracker has {n}; use the configuration it was saved with",
                saved.particles.len(),
                saved.log_weights.len()
            )));
        }
        if saved.frame > MOST_FRAMES || saved.target.is_some() == saved.appearance.is_null() {
            return Err(bad("its frame number is absurd, or it has a target without a template".into()));
        }
        if let Some(Target { extent, unit, .. }) = &saved.target {
            let sane = |half: f64| (0.3..=1e6).contains(&half);
            if !(sane(extent.half_w) && sane(extent.half_h) && sane(*unit)) {
                return Err(bad(format!("its target has halves of {} x {} pixels", extent.half_w, extent.half_h)));
            }
        }
        self.parts.proposal.load(&saved.proposal)?;
        self.parts.policy.load(&saved.policy)?;
        self.parts.appearance.load(&saved.appearance)?;
        match (&mut self.parts.aspect, &saved.aspect) {
            (Some(aspect), Some(saved)) => aspect.load(saved)?,
            (None, None) => (),
            _ => {
                return Err(bad(
                    "only one of it and this tracker has an aspect; use the configuration it was saved with".into(),
                ));
            }
        }
        self.parts.vigilance.load(&saved.vigilance)?;
        self.parts.confidence.load(&saved.confidence)?;
        match (&mut self.parts.recognizer, &saved.recognizer) {
            (Some(recognizer), Some(saved)) => recognizer.load(saved)?,
            (Some(recognizer), None) => recognizer.reset(),
            (None, _) => (),
        }
        if let Some(target) = &saved.target {
            self.parts.proposal.size(target.unit);
            self.parts.appearance.reshape(target.extent);
        }
        self.frame = saved.frame;
        self.target = saved.target;
        self.context = saved.context;
        self.particles = saved.particles;
        self.log_carried = saved.log_weights.iter().map(|w| w.unwrap_or(f64::NEG_INFINITY)).collect();
        Ok(())
    }
}
