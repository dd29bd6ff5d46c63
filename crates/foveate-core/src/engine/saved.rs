//! The state of an engine in mid-video as plain data, from which tracking resumes.

use serde::{Deserialize, Serialize};

use super::Engine;
use super::filter::Waiting;
use super::target::Target;
use crate::control::Redetection;
use crate::gaze::Context;
use crate::geometry::State;
use crate::identity::box_regression::BoxRegression;
use crate::identity::surroundings::Surroundings;
use crate::recognition::Recognition;
use crate::saved_state::SavedState;
use foveate_base::{Error, Result};

/// Upper bound on the frame number of a saved state.
const MOST_FRAMES: u64 = 1 << 48;

#[derive(Serialize, Deserialize)]
struct Saved {
    frame: u64,
    target: Option<Target>,
    particles: Vec<State>,
    /// JSON has no −∞: a particle without weight has `None`.
    log_weights: Vec<Option<f64>>,
    /// The postponed motion of frames without a look.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    waiting: Option<Waiting>,
    visible: f64,
    policy: SavedState,
    appearance: SavedState,
    consistency: serde_json::Value,
    /// The same for the short-term memory; `None` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    short_term: Option<serde_json::Value>,
    confidence: serde_json::Value,
    /// The remembered surroundings of the target; `None` without that memory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    surroundings: Option<serde_json::Value>,
    context: Context,
    /// The state of the search for a lost target; `None` without such a search.
    redetection: Option<serde_json::Value>,
    /// `None` for a tracker without a recogniser; a recogniser that is loaded from `None` starts from nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    recognizer: Option<serde_json::Value>,
    /// The state of the box regression; `None` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    box_regression: Option<serde_json::Value>,
}

impl Engine {
    /// Returns the whole state of the filter in mid-video. [`Engine::load`] resumes from it bit for bit.
    pub(crate) fn save(&self) -> serde_json::Value {
        let saved = Saved {
            frame: self.frame,
            target: self.target,
            particles: self.parts.filter.particles.clone(),
            log_weights: self.parts.filter.log_weights.iter().map(|w| w.is_finite().then_some(*w)).collect(),
            waiting: self.parts.filter.waiting,
            visible: self.visibility.fraction(),
            policy: self.parts.gaze.policy.save(),
            appearance: self.parts.appearance.save(),
            consistency: self.parts.monitor.consistency.save(),
            short_term: self.parts.monitor.short_term.as_ref().map(|it| it.consistency.save()),
            confidence: self.parts.monitor.loss.save(),
            surroundings: self.parts.monitor.surroundings.as_ref().map(Surroundings::save),
            context: self.context,
            redetection: self.parts.filter.redetection.as_ref().map(Redetection::save),
            recognizer: self.parts.extras.recognition.as_ref().map(Recognition::save),
            box_regression: self.parts.extras.box_regression.as_ref().and_then(BoxRegression::save),
        };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Restores a state that `save` returned, in a tracker made from the same configuration and seed. After an error the caller must set
    /// the target again.
    pub(crate) fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved tracker cannot be used: {what}"));
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        let n = self.parts.filter.particles.len();
        if saved.particles.len() != n || saved.log_weights.len() != n {
            return Err(bad(format!(
                "it has {} particles and {} weights, this tracker has {n}; use the configuration it was saved with",
                saved.particles.len(),
                saved.log_weights.len()
            )));
        }
        if saved.frame > MOST_FRAMES || saved.target.is_some() == saved.appearance.is_empty() {
            return Err(bad("its frame number is absurd, or it has a target without a template".into()));
        }
        if saved.waiting.is_some_and(|waiting| waiting.frames as u64 > saved.frame) {
            return Err(bad("it was waited for longer than there were frames".into()));
        }
        if saved.waiting.is_some() && !self.waits(false) {
            return Err(bad(
                "nobody looked at it lately, which this configuration cannot take up; use that it was saved with"
                    .into(),
            ));
        }
        if let Some(Target { extent, unit, .. }) = &saved.target {
            let sane = |half: f64| (0.3..=1e6).contains(&half);
            if !(sane(extent.half_w) && sane(extent.half_h) && sane(*unit)) {
                return Err(bad(format!("its target has halves of {} x {} pixels", extent.half_w, extent.half_h)));
            }
        }
        self.parts.gaze.policy.load(&saved.policy)?;
        self.parts.appearance.load(&saved.appearance)?;
        self.parts.monitor.consistency.load(&saved.consistency)?;
        match (&mut self.parts.monitor.short_term, &saved.short_term) {
            (Some(it), Some(saved)) => it.consistency.load(saved)?,
            (Some(it), None) => it.consistency.reset(),
            (None, _) => (),
        }
        self.parts.monitor.loss.load(&saved.confidence)?;
        match (&mut self.parts.monitor.surroundings, &saved.surroundings) {
            (Some(it), Some(saved)) => it.load(saved, self.parts.appearance.width())?,
            (Some(it), None) => it.clear(),
            (None, _) => (),
        }
        if let (Some(search), Some(saved)) = (&mut self.parts.filter.redetection, &saved.redetection) {
            search.load(saved)?;
        }
        match (&mut self.parts.extras.recognition, &saved.recognizer) {
            (Some(recognizer), Some(saved)) => recognizer.load(saved)?,
            (Some(recognizer), None) => recognizer.reset(),
            (None, _) => (),
        }
        if let Some(it) = &mut self.parts.extras.box_regression {
            if saved.target.is_some() && saved.box_regression.is_none() {
                return Err(bad("it has no box regression; use the configuration it was saved with".into()));
            }
            it.load(saved.box_regression.as_ref())?;
        }
        if let Some(target) = &saved.target {
            self.parts.filter.proposal.size(target.unit);
        }
        self.frame = saved.frame;
        self.target = saved.target;
        self.context = saved.context;
        self.visibility.set_fraction(saved.visible);
        self.parts.filter.particles = saved.particles;
        self.parts.filter.waiting = saved.waiting;
        self.parts.filter.log_weights = saved.log_weights.iter().map(|w| w.unwrap_or(f64::NEG_INFINITY)).collect();
        Ok(())
    }
}
