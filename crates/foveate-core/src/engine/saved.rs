//! The state of an engine in mid-video, from which tracking resumes bit for bit.

use serde::Deserialize;
use serde_json::json;

use super::target::Target;
use super::{Engine, Extras, Parts};
use crate::control::Redetection;
use crate::gaze::Context;
use crate::recognition::Recognition;
use crate::saved_state::{SavedState, Valid, Validate, ensure, refused};
use foveate_base::Result;

/// Upper bound on the frame number of a saved state.
const MOST_FRAMES: u64 = 1 << 48;

/// What an engine itself keeps between frames, beside the states of its parts.
#[derive(Deserialize)]
struct Own {
    frame: u64,
    target: Option<Target>,
    context: Context,
    visible: f64,
}

impl Validate for Own {
    fn validate(&self, (): &()) -> Valid {
        ensure(self.frame <= MOST_FRAMES, || format!("its frame number is {}", self.frame))?;
        let sane = |half: f64| (0.3..=1e6).contains(&half);
        let fits = |target: &Target| {
            let (small, large) = (target.extent, target.drawn());
            [small.half_w, small.half_h, large.half_w, large.half_h, target.unit].into_iter().all(sane)
        };
        let shares = |Target { share, .. }: &Target| (1e-3..=1.0).contains(share);
        ensure(self.target.as_ref().is_none_or(shares), || {
            "the target's share of its box is not from 0.001 to 1".into()
        })?;
        ensure(self.target.as_ref().is_none_or(fits), || format!("the size of its target: {:?}", self.target))
    }
}

impl Engine {
    /// Returns the whole state in mid-video. [`Engine::load`] resumes from it bit for bit.
    pub(crate) fn save(&self) -> SavedState {
        let Parts { filter, gaze, appearance, monitor, extras: Extras { recognition, box_regression, .. }, .. } =
            &self.parts;
        SavedState::new(&json!({
            "frame": self.frame,
            "target": self.target,
            "context": self.context,
            "visible": self.visibility.fraction(),
            "filter": filter.state,
            "search": filter.redetection.as_ref().map(Redetection::state),
            "policy": gaze.policy.save(),
            "appearance": appearance.save(),
            "consistency": monitor.consistency.state,
            "confidence": monitor.loss.state,
            "surroundings": monitor.surroundings.as_ref().map(|it| &it.state),
            "recognizer": recognition.as_ref().map(Recognition::save),
            "box_regression": box_regression.as_ref().map(|it| &it.state),
        }))
    }

    /// Restores a state that `save` returned, in a tracker made from the same configuration and seed. After an error the caller must set
    /// the target again.
    pub(crate) fn load(&mut self, saved: &SavedState) -> Result<()> {
        let Own { frame, target, context, visible } = saved.state("tracker", &())?;
        let Parts { filter, gaze, appearance, monitor, extras, .. } = &mut self.parts;
        let (template, has_target) = (saved.part("appearance"), target.is_some());
        if template.is_empty() == has_target {
            return Err(refused("appearance", "there is a target without a template, or a template without a target"));
        }
        appearance.load(&template)?;
        filter.state = saved.part_state("filter", &&*filter)?;
        if let Some(it) = &mut filter.redetection {
            it.resume(saved.part_state("search", it.settings())?);
        }
        gaze.policy.load(&saved.part("policy"))?;
        monitor.consistency.load(&saved.part("consistency"))?;
        monitor.loss.state = saved.part_state("confidence", &())?;
        if let Some(it) = &mut monitor.surroundings {
            it.state = saved.part_state("surroundings", &(&*it, appearance.width()))?;
        }
        if let Some(it) = &mut extras.recognition {
            it.load(&saved.part("recognizer"))?;
        }
        if let Some(it) = &mut extras.box_regression {
            it.resume(saved.part_state("box_regression", &has_target)?);
        }
        if let Some(target) = &target {
            filter.proposal.size(target.unit);
        }
        (self.frame, self.target, self.context) = (frame, target, context);
        self.visibility.set_fraction(visible);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::toy::{Toy, parts, started};
    use super::*;

    /// Each number is checked by itself, up to its ends.
    #[test]
    fn a_target_of_a_size_that_no_tracker_has_is_refused() {
        let engine = started(parts(Toy::at(50.0)), 0);
        let saved: serde_json::Value = engine.save().read().expect("JSON");
        let fits = |path: &str, value: f64| {
            let mut changed = saved.clone();
            *changed.pointer_mut(path).expect(path) = value.into();
            serde_json::from_value::<Own>(changed).is_ok_and(|own| own.validate(&()).is_ok())
        };
        for path in ["/target/extent/half_w", "/target/extent/half_h", "/target/unit"] {
            assert!(fits(path, 0.3) && fits(path, 1e6), "{path}");
            assert!(!fits(path, 0.29) && !fits(path, 1.01e6), "{path}");
        }
        let share = "/target/share";
        assert!(fits(share, 1e-3) && fits(share, 1.0) && !fits(share, 0.9e-3) && !fits(share, 1.001));
    }
}
