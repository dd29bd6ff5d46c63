//! The search around a state for places that the target could be mistaken for.

use super::view::View;
use crate::control::{DistractorSearch, distractors};
use crate::geometry::State;

/// The places around one state that look most like the target and are not that state.
#[derive(Default)]
pub(super) struct Distractors {
    /// The state that was searched around; `None` if there was no search, or its scores do not hold any more.
    around: Option<State>,
    /// The log-likelihood of the best of them, −∞ if there is none; `None` if there was no search.
    pub best: Option<f64>,
    pub states: Vec<State>,
}

impl Distractors {
    /// Searches around `state`, unless these already are the distractors there. Without a search there are none.
    pub(super) fn search(mut self, search: Option<&mut DistractorSearch>, view: &mut View<'_>, state: &State) -> Self {
        if self.around.is_some_and(|around| around == *state) {
            return self;
        }
        (self.around, self.best) = (None, None);
        let Some(search) = search else { return self };
        let places = search.places(view.size(), state, view.target.extent);
        // An estimate that has left the picture has nothing around it.
        if places.is_empty() {
            self.states.clear();
            self.best = Some(f64::NEG_INFINITY);
            return self;
        }
        let extent = view.target.extent;
        self.best = Some(distractors(places, view.scores(places), state, extent, &mut self.states));
        self.around = Some(*state);
        self
    }

    /// Empty, with the same buffer.
    pub(super) fn forget(self) -> Self {
        Self { around: None, best: None, ..self }
    }
}
