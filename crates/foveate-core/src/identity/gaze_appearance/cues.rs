//! Template, discriminant and colour: which of them there are, how they are mixed, and what colour is worth.

use super::{GazeAppearance, looks};
use crate::geometry::{Gaze, State};
use crate::identity::colour::{self, Colour};
use crate::identity::discriminant::{self, Discriminant};
use crate::identity::fusion::{self, Fusion};

impl GazeAppearance {
    /// Learns while tracking what tells the target from what is around it, by these settings.
    pub fn discriminating(self, settings: discriminant::Settings) -> Self {
        let (_, n_h) = self.encoder.shape();
        Self { discriminant: Some(Discriminant::new(settings, n_h)), ..self }
    }

    /// Learns while tracking the colours of the target and of its surroundings, by these settings.
    pub fn colouring(self, settings: Option<colour::Settings>) -> Self {
        Self { colour: settings.map(Colour::new), ..self }
    }

    /// Learns while tracking which of template, discriminant and colour to trust, by these settings.
    pub fn fusing(self, settings: Option<fusion::Settings>) -> Self {
        Self { fusion: settings.map(Fusion::new), ..self }
    }

    /// The whole box is looked at under every gaze: gazes say where a sensor reads sharply.
    pub fn steady(self, steady: bool) -> Self {
        Self { steady, ..self }
    }

    /// Mixing weights of the discriminant beside the template, and of colour beside both.
    pub(super) fn mixing(&self) -> (f64, f64) {
        let discriminant = self.discriminant.as_ref().map_or(0.0, |it| it.settings().mixing_weight);
        let colour = self.colour.as_ref().map_or(0.0, Colour::weight);
        self.fusion.as_ref().map_or((discriminant, colour), |it| it.mixed(discriminant, colour))
    }

    /// How much farther the distractors are than the target by their colours, on average. All of them were seen: where
    /// distractors are not searched for, they are particles.
    pub(super) fn colour_margin(&self, state: &State, distractors: &[State]) -> f64 {
        let looks = looks(&*self.retina, self.extent());
        let Some(colour) = self.colour.as_ref().filter(|_| self.fusion.is_some() && !distractors.is_empty()) else {
            return 0.0;
        };
        let distance = |place: &State| {
            let view = self.buffers.views.of(place, Gaze::CENTRE, looks, true);
            colour.distance(&self.buffers.views.get(view).sums, place, looks.extent)
        };
        let all: f64 = distractors.iter().map(distance).sum();
        all / distractors.len() as f64 - distance(state)
    }
}
