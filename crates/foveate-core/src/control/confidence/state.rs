//! The status of a track over frames, with hysteresis.

use serde::{Deserialize, Serialize};

use super::ConfidenceModel;
use crate::control::Status;

/// A status, and what speaks against it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TrackState {
    pub status: Status,
    /// Frames in a row that spoke against it, by what they count.
    against: f64,
    /// Frames since the target went out, or was found.
    since: usize,
}

impl TrackState {
    pub fn is_out(&self) -> bool {
        self.status.is_occluded_or_lost()
    }

    /// Takes a frame in, and tells whether the target is found in it. `elsewhere`: something else fits better, and nothing is found.
    pub fn stand(&mut self, model: &ConfidenceModel, p_lost: f64, elsewhere: bool) -> bool {
        let out = self.is_out();
        let counts = if out && elsewhere { 0.0 } else { model.counts(out, p_lost) };
        self.against = if counts > 0.0 { self.against + counts } else { 0.0 };
        if out {
            self.since = self.since.saturating_add(1);
            if self.against >= model.confirm as f64 {
                // Hidden for a moment only, it was never away.
                self.status = if self.status == Status::Lost { Status::Reacquired } else { Status::Tracking };
                (self.against, self.since) = (0.0, 0);
                return true;
            }
            if self.since > model.patience {
                self.status = Status::Lost;
            }
        } else if self.against >= model.notice as f64 {
            self.status = if self.status == Status::Reacquired { Status::Lost } else { Status::Occluded };
            self.against = 0.0;
        } else if self.status == Status::Reacquired {
            self.since = self.since.saturating_add(1);
            if self.since > model.patience {
                (self.status, self.since) = (Status::Tracking, 0);
            }
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
            let mut state = TrackState { status: Status::Lost, against: 0.0, since: 30 };
            (1..10).find(|_| state.stand(&model, p, false) && state.status == Status::Reacquired)
        };
        assert_eq!([0.199, 0.1, 1e-6, 0.0].map(|p| found_after(p, 1.0)), [Some(4); 4]);
        // ln 9 / ln 4 = 1.58: three.
        assert_eq!([0.199, 0.1, 1e-6, 0.0].map(|p| found_after(p, 2.0)), [Some(4), Some(3), Some(2), Some(2)]);
        assert_eq!(found_after(0.2, 2.0), None);
    }
}
