//! Gazes that are scored beside the policy's own, for observers alone.

use super::Blueprint;
use crate::gaze::{Policy, Shadow};
use crate::geometry::Gaze;

impl Blueprint {
    /// The same, with these gazes scored each frame beside those of the policy, for observers; the track stays the same.
    pub fn shadowing(self, gazes: Vec<Gaze>) -> Self {
        Self { shadow: gazes, ..self }
    }
    pub(super) fn shadowed(&self, policy: Box<dyn Policy>) -> Box<dyn Policy> {
        if self.shadow.is_empty() { policy } else { Box::new(Shadow::new(self.shadow.clone(), policy)) }
    }
}
