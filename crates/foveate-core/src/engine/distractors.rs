//! The search around a state for places that resemble the target.

use super::view::View;
use crate::control::{DistractorSearch, SearchResult, distractors};
use crate::geometry::State;

/// The places around one state, apart from itself, that look most like the target.
#[derive(Default)]
pub(super) struct Distractors {
    /// The state at the centre of the search; `None` if there was no search or its scores are out of date.
    around: Option<State>,
    /// The log-likelihood of the best of these places, −∞ if there is none; `None` if there was no search.
    pub best: Option<f64>,
    pub states: Vec<State>,
    /// The result of a search of the whole picture; `None` without one.
    pub search: Option<SearchResult>,
}

impl Distractors {
    /// Searches around `state`, unless these are the distractors there already. Without a search the result is empty.
    pub(super) fn search(mut self, search: Option<&mut DistractorSearch>, view: &mut View<'_>, state: &State) -> Self {
        if self.around.is_some_and(|around| around == *state) {
            return self;
        }
        (self.around, self.best) = (None, None);
        let Some(search) = search else { return self };
        let places = search.places(view.size(), state, view.target.extent);
        // There are no places around an estimate outside the picture.
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

    /// Marks the results as out of date, and keeps their buffers.
    pub(super) fn forget(self) -> Self {
        Self { around: None, best: None, search: None, ..self }
    }
}
