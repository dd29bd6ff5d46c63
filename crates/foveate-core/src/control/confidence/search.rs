//! Whether the tracker searches for the target, by its own P(lost) over several frames. This differs from the
//! reported status.

use serde::{Deserialize, Serialize};

use super::ConfidenceModel;

/// Whether the target is searched for, and the frames with evidence against it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SearchState {
    pub is_searching: bool,
    /// Frames in a row that spoke against it, each by its weight.
    against: f64,
}

impl SearchState {
    /// Takes a frame in. Returns whether the target is found in it. `elsewhere`: another place fits better, so that nothing is found.
    pub(super) fn update(&mut self, model: &ConfidenceModel, p_lost: f64, elsewhere: bool) -> bool {
        let searching = self.is_searching;
        let weight = if searching && elsewhere { 0.0 } else { model.weight_of_frame(searching, p_lost) };
        self.against = if weight > 0.0 { self.against + weight } else { 0.0 };
        if self.against >= if searching { model.confirm } else { model.notice } as f64 {
            *self = Self { is_searching: !searching, against: 0.0 };
            return searching;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found at `leave` = 0.2, P = 0.2 − ε counts 1 and P → 0 counts `surest`: after ⌈4 / 2⌉ sure frames, or four hardly sure ones.
    #[test]
    fn frames_that_are_surer_count_for_more() {
        let found_after = |p: f64, surest: f64| {
            let model = ConfidenceModel { leave: 0.2, confirm: 4, surest, ..ConfidenceModel::default() };
            let mut state = SearchState { is_searching: true, against: 0.0 };
            (1..10).find(|_| state.update(&model, p, false) && !state.is_searching)
        };
        assert_eq!([0.199, 0.1, 1e-6, 0.0].map(|p| found_after(p, 1.0)), [Some(4); 4]);
        // ln 9 / ln 4 = 1.58: three.
        assert_eq!([0.199, 0.1, 1e-6, 0.0].map(|p| found_after(p, 2.0)), [Some(4), Some(3), Some(2), Some(2)]);
        assert_eq!(found_after(0.2, 2.0), None);
    }
}
