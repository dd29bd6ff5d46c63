//! Vote of several trackers of one target on the reported box and P(lost).
//!
//! Each member k has a box bₖ and a probability of loss Pₖ. As a mixture with equal weights, the members expect the
//! overlap Σ (1 − Pₖ) IoU(b, bₖ) / K of a box b; the member's box with the largest value is reported. A box is lost
//! if its IoU with the target is below 0.1, so P(lost) = 1 − Σ (1 − Pₖ) [IoU(b, bₖ) ≥ 0.1] / K. Nothing is fitted.
//!
//! Deviation: the paper has one tracker. Query by committee: Seung, Opper and Sompolinsky (1992); ensembles for uncertainty:
//! Lakshminarayanan, Pritzel and Blundell (2017).

use serde::{Deserialize, Serialize};

use super::search::SearchState;
use super::{ConfidenceModel, LOST};
use crate::control::status::ReportedStatus;
use crate::control::{Status, StatusThresholds};
use crate::geometry::BBox;

/// Thresholds of the vote's P(lost): lost from the first on, found below the second. They decide which members
/// restart and which status is reported.
const OUT: f64 = 0.5;
const FOUND: f64 = 0.45;

/// One member's box and P(lost) of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Ballot {
    /// Its box, pixels.
    pub bbox: BBox,
    /// Its P(lost), 0 to 1.
    pub p_lost: f64,
    /// Whether it searches for the target.
    pub is_searching: bool,
}

impl Ballot {
    /// Whether its box is on that of another.
    pub fn is_on(&self, other: &BBox) -> bool {
        self.bbox.iou(other) >= LOST
    }
}

/// Counts ballots, and keeps the status of the track.
#[derive(Clone, Debug)]
pub struct Vote {
    /// Number of lost frames after which the status is lost.
    patience: usize,
    pub(crate) state: VoteState,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VoteState {
    search: SearchState,
    reported: ReportedStatus,
}

impl Vote {
    /// A vote before the first frame, with the `patience` of a member's `model`.
    pub fn new(model: &ConfidenceModel) -> Self {
        Self { patience: model.patience, state: VoteState::default() }
    }

    /// The rule of search and status. Only a committee needs it; every target keeps a vote.
    fn rule(&self) -> ConfidenceModel {
        ConfidenceModel {
            enter: OUT,
            leave: FOUND,
            notice: 1,
            confirm: 1,
            surest: 1.0,
            status: StatusThresholds { enter: OUT, leave: FOUND },
            patience: self.patience,
            ..ConfidenceModel::default()
        }
    }

    /// Resets the vote: the target was just given.
    pub fn reset(&mut self) {
        self.state = VoteState::default();
    }

    /// The member with the reported box, and its P(lost); the first of equal ones. Panics without ballots.
    pub fn elect(ballots: &[Ballot]) -> (usize, f64) {
        let share = 1.0 / ballots.len() as f64;
        let expected = |at: &BBox| ballots.iter().map(|b| share * (1.0 - b.p_lost) * b.bbox.iou(at)).sum::<f64>();
        let (mut elected, mut most) = (0, f64::NEG_INFINITY);
        for (k, ballot) in ballots.iter().enumerate() {
            let overlap = expected(&ballot.bbox);
            if overlap > most {
                (elected, most) = (k, overlap);
            }
        }
        let reported = ballots[elected].bbox;
        let there: f64 = ballots.iter().filter(|b| b.is_on(&reported)).map(|b| share * (1.0 - b.p_lost)).sum();
        (elected, (1.0 - there).clamp(0.0, 1.0))
    }

    /// Whether the target is lost by the vote: members then do not restart at its box.
    pub fn is_searching(&self) -> bool {
        self.state.search.is_searching
    }

    /// The elected member, the P(lost) of its box, and the reported status, which follows from that.
    pub fn count(&mut self, ballots: &[Ballot]) -> (usize, f64, Status) {
        let (elected, p_lost) = Self::elect(ballots);
        // The target is found if a member at the reported box has found it by its own rule.
        let reported = ballots[elected].bbox;
        let found = ballots.iter().any(|b| !b.is_searching && b.is_on(&reported));
        let rule = self.rule();
        self.state.search.update(&rule, p_lost, !found);
        (elected, p_lost, self.state.reported.update(p_lost, rule.status, rule.patience))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    fn at(x: f64, p_lost: f64) -> Ballot {
        Ballot { bbox: BBox::new(x, 0.0, 10.0, 10.0), p_lost, is_searching: p_lost > 0.5 }
    }

    /// A million worlds: a member drawn at random is right with 1 - P, and then the target is in its box; else it is nowhere. The mean overlap
    /// of the reported box is the largest of all members' boxes, and P(lost) is the share of worlds with an overlap below 0.1; seed 3,
    /// false alarms below 1 in 10,000 (four standard deviations of 1/2000).
    #[test]
    fn the_vote_equals_a_simulation_of_its_mixture() {
        let ballots = [at(0.0, 0.3), at(2.0, 0.1), at(9.5, 0.0), at(40.0, 0.2)];
        let (elected, p_lost) = Vote::elect(&ballots);
        let mut rng = Streams::new(3, 0).rng(0);
        let (mut overlap, mut lost) = ([0.0; 4], 0);
        let worlds = 1_000_000;
        for _ in 0..worlds {
            let right = &ballots[rng.random_range(0..4)];
            let target = (rng.random::<f64>() >= right.p_lost).then_some(right.bbox);
            let iou = |b: &Ballot| target.map_or(0.0, |target| b.bbox.iou(&target));
            overlap.iter_mut().zip(&ballots).for_each(|(sum, b)| *sum += iou(b));
            lost += usize::from(iou(&ballots[elected]) < LOST);
        }
        let best = (0..4).max_by(|a, b| overlap[*a].total_cmp(&overlap[*b])).expect("four");
        assert_eq!(elected, best);
        assert!((p_lost - lost as f64 / worlds as f64).abs() < 0.002, "{p_lost}, drawn {lost} in {worlds}");
    }

    #[test]
    fn a_single_member_keeps_its_estimate() {
        assert_eq!(Vote::elect(&[at(3.0, 0.25)]), (0, 0.25));
    }

    /// Of three sure members one dissents: no harm. Two do: the target is lost, until two agree again. Members begin again at the box once
    /// one of those two has found the target by its own rule.
    #[test]
    fn two_of_three_decide() {
        let mut vote = Vote::new(&ConfidenceModel { patience: 2, ..ConfidenceModel::default() });
        let mut status = |ballots: [Ballot; 3]| {
            let (_, p_lost, status) = vote.count(&ballots);
            assert!(if status.is_usable() { p_lost < OUT } else { p_lost >= FOUND }, "{status:?} at {p_lost}");
            assert!(status.is_usable() || vote.is_searching());
            status
        };
        assert_eq!(status([at(0.0, 0.0), at(1.0, 0.0), at(90.0, 0.0)]), Status::Tracking);
        assert_eq!(status([at(0.0, 0.0), at(40.0, 0.0), at(90.0, 0.0)]), Status::Occluded);
        assert_eq!(status([at(0.0, 0.0), at(1.0, 0.0), at(90.0, 0.0)]), Status::Tracking);
        assert_eq!(status([at(0.0, 0.9), at(1.0, 0.9), at(2.0, 0.9)]), Status::Occluded);
        for expected in [Status::Occluded, Status::Lost, Status::Lost] {
            assert_eq!(status([at(0.0, 0.9), at(1.0, 0.9), at(2.0, 0.9)]), expected);
        }
        // P(lost) is low, but none of them has found it by its own rule.
        let searching = |x| Ballot { is_searching: true, ..at(x, 0.0) };
        assert_eq!(status([searching(0.0), searching(1.0), searching(2.0)]), Status::Reacquired);
        assert!(vote.is_searching());
        let (.., status) = vote.count(&[at(0.0, 0.0), searching(1.0), searching(2.0)]);
        assert_eq!((status, vote.is_searching()), (Status::Reacquired, false));
    }

    /// One sure member wins against two doubtful ones at one place, and the first of equal members wins.
    #[test]
    fn a_vote_counts_the_probability_that_a_member_is_right() {
        assert_eq!(Vote::elect(&[at(0.0, 0.7), at(0.0, 0.7), at(40.0, 0.3)]).0, 2);
        assert_eq!(Vote::elect(&[at(0.0, 0.9), at(40.0, 0.1)]).0, 1);
        assert_eq!(Vote::elect(&[at(0.0, 0.2), at(0.0, 0.2)]).0, 0);
    }

    /// The vote calls a target lost at a P(lost) of 0.5, and found below 0.45 if a member at its box has found it.
    #[test]
    fn the_vote_has_thresholds_of_its_own() {
        let mut vote = Vote::new(&ConfidenceModel::default());
        for (p_lost, is_searching, lost) in [
            (0.49, false, false),
            (0.51, false, true),
            (0.46, false, true),
            (0.44, true, true),
            (0.44, false, false),
            (0.46, false, false),
        ] {
            vote.count(&[Ballot { is_searching, ..at(0.0, p_lost) }]);
            assert_eq!(vote.is_searching(), lost, "after {p_lost}, {is_searching}");
        }
    }
}
