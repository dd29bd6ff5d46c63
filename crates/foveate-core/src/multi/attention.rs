//! Whom to look at, where there are more targets than looks in a frame (the paper's future work: attention over objects).
//!
//! A look is what costs. Who gets none coasts: its belief is predicted and spreads, detections still count, and nothing is
//! learned of its looks. Who is first follows from a priority, the greatest first:
//! ```text
//! round-robin   frames since its last look
//! surprise      how far a look moved its estimate a frame, on average, times the square of the frames since the last one
//! ```
//! *Surprise* is the index of a restless bandit whose cost grows evenly while it waits (Whittle, 1988): looking now saves
//! `c w`, and waiting has cost `c w / 2` a frame so far, so that the gain of a look is worth `c w²` but for a factor.

use serde::{Deserialize, Serialize};

/// How many targets are looked at in a frame, and which.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Attention {
    /// Number of targets updated in a frame; 0 updates all.
    pub budget: usize,
    /// Order of the targets.
    pub policy: Priority,
}

/// Order of the targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Priority {
    /// Who has waited longest.
    #[default]
    RoundRobin,
    /// Whom looks surprised most.
    Surprise,
}

/// What is known of a target before it is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Frames since its last look.
    pub waited: usize,
    /// How far a look moved its estimate a frame, template units, on average.
    pub surprise: f64,
}

impl Attention {
    /// Whether all of so many targets are looked at.
    pub fn suffices(&self, targets: usize) -> bool {
        self.budget == 0 || targets <= self.budget
    }

    /// Puts the greatest priorities first, and equal ones by their number: those of the budget are looked at.
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

    #[test]
    fn priorities_are_what_they_say() {
        let candidate = |waited, surprise| Candidate { waited, surprise };
        let all = [candidate(3, 0.5), candidate(1, 0.1), candidate(2, 0.9)];
        for (policy, expected) in [(Priority::RoundRobin, [0, 2, 1]), (Priority::Surprise, [2, 0, 1])] {
            let mut order = vec![];
            Attention { budget: 1, policy }.order(all.into_iter(), &mut order);
            assert_eq!(order.iter().map(|(_, i)| *i).collect::<Vec<_>>(), expected, "{policy:?}");
        }
    }
}
