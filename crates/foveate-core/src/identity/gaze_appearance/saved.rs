//! The state of an appearance between frames: the picture of frame 1 and the learned models.

use serde_json::json;

use super::{GazeAppearance, Template};
use crate::geometry::Gaze;
use crate::identity::discriminant::Discriminant;
use crate::saved_state::{SavedState, Valid, Validate, ensure};
use foveate_base::{Result, memory};

/// The farthest gaze that a policy may have, template units.
const FARTHEST: f64 = 10.0;

impl Validate for Template {
    fn validate(&self, (): &()) -> Valid {
        let Self { image, origin, size, .. } = self;
        let holds = |from: usize, n: usize, side: usize| from.checked_add(n).is_some_and(|end| end <= side);
        ensure(holds(origin.0, image.width(), size.width) && holds(origin.1, image.height(), size.height), || {
            "the part of a picture that it has lies outside of the picture".into()
        })?;
        memory::check_picture(size.width, size.height).map_err(|error| error.to_string())
    }
}

impl Validate for Gaze {
    fn validate(&self, (): &()) -> Valid {
        ensure([self.u, self.v].iter().all(|place| place.abs() <= FARTHEST), || "it is no place of the template".into())
    }
}

impl GazeAppearance {
    pub(super) fn to_saved(&self) -> SavedState {
        let Some(template) = &self.kept else { return SavedState::empty() };
        SavedState::new(&json!({
            "template": template,
            "committed": self.committed,
            "discriminant": self.discriminant.as_ref().map(Discriminant::save),
            "colour": self.colour.as_ref().map(|it| &it.state),
            "training": self.saved_training(),
        }))
    }

    pub(super) fn take_up(&mut self, saved: &SavedState) -> Result<()> {
        if saved.is_empty() {
            self.kept = None;
            return Ok(());
        }
        let (template, committed) = (saved.part_state("template", &())?, saved.part_state("committed", &())?);
        if let Some(it) = &mut self.discriminant {
            it.load(&saved.part("discriminant"))?;
        }
        if let Some(it) = &mut self.colour {
            it.resume(saved.part_state("colour", &())?);
        }
        self.take_up_training(&saved.part("training"))?;
        self.recenter(committed);
        self.keep(template);
        Ok(())
    }
}

#[cfg(feature = "learn")]
impl GazeAppearance {
    fn saved_training(&self) -> SavedState {
        self.training.as_ref().map_or_else(SavedState::empty, super::Training::save)
    }

    fn take_up_training(&mut self, saved: &SavedState) -> Result<()> {
        if let Some(training) = &mut self.training {
            self.encoder = training
                .load(saved)
                .map_err(|error| crate::saved_state::refused("online training", &error.to_string()))?;
        }
        Ok(())
    }
}

#[cfg(not(feature = "learn"))]
impl GazeAppearance {
    fn saved_training(&self) -> SavedState {
        SavedState::empty()
    }

    fn take_up_training(&mut self, _: &SavedState) -> Result<()> {
        Ok(())
    }
}
