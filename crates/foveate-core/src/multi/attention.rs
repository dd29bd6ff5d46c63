//! Scheduling of looks if there are more targets than looks in a frame (the paper's future work: attention over objects).
//!
//! Looks dominate the cost. A target without a look coasts: its belief is predicted and spreads, detections still weigh it, and its models
//! are not updated. The targets with the highest priorities get the looks:
//! ```text
//! round-robin   frames since its last look
//! surprise      how far a look moved its estimate a frame, on average, times the square of the frames since the last one
//! ```
//! *Surprise* is the index of a restless bandit whose cost grows linearly while it waits (Whittle, 1988): a look after `w` frames saves
//! `c w`, and waiting has cost `c w / 2` per frame so far, so that the gain of a look is proportional to `c w²`.

use serde::{Deserialize, Serialize};

/// The number of targets updated in a frame, and their order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Attention {
    /// Number of targets updated in a frame; 0 updates all.
    pub budget: usize,
    /// Targets that come first: `round-robin`, those that waited longest; `surprise`, those that updates move most.
    pub policy: Priority,
}

/// Order of the targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Priority {
    /// The longest time since the last look first.
    #[default]
    RoundRobin,
    /// The largest expected motion by a look first.
    Surprise,
}

/// The quantities from which the priority of a target follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Frames since its last look.
    pub waited: usize,
    /// Mean distance by which a look moves its estimate, per frame, template units.
    pub surprise: f64,
}

impl Attention {
    /// Returns whether the budget covers this number of targets.
    pub fn suffices(&self, targets: usize) -> bool {
        self.budget == 0 || targets <= self.budget
    }

    /// Sorts the candidates by priority, largest first, and equal ones by index; the first `budget` are updated.
    pub fn order(&self, candidates: impl Iterator<Item = Candidate>, order: &mut Vec<(f64, usize)>) {
        order.clear();
        order.extend(candidates.map(|c| self.policy.of(&c)).zip(0..));
        order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
}

impl Priority {
    fn of(self, candidate: &Candidate) -> f64 {
        let Candidate { waited, surprise } = *candidate;
        match self {
            Self::RoundRobin => waited as f64,
            Self::Surprise => surprise * ((1 + waited) as f64).powi(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A budget of 0 has no limit.
    #[test]
    fn a_budget_suffices_for_as_many_targets() {
        let suffices = |budget, targets| Attention { budget, ..Attention::default() }.suffices(targets);
        assert!(suffices(0, 9) && suffices(3, 2) && suffices(3, 3) && !suffices(3, 4));
    }

    #[test]
    fn priorities_order_the_targets() {
        let candidate = |waited, surprise| Candidate { waited, surprise };
        let all = [candidate(3, 0.5), candidate(1, 0.1), candidate(2, 0.9), candidate(0, 1.0)];
        for (policy, expected) in [(Priority::RoundRobin, [0, 2, 1, 3]), (Priority::Surprise, [2, 0, 3, 1])] {
            let mut order = vec![];
            Attention { budget: 1, policy }.order(all.into_iter(), &mut order);
            assert_eq!(order.iter().map(|(_, i)| *i).collect::<Vec<_>>(), expected, "{policy:?}");
        }
    }
}
