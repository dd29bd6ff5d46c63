//! Settings chosen on some sequences and tested on others.
//!
//! A score on the sequences that settings were chosen on is biased. Here each sequence is tested with the candidate that was best *without*
//! its group of sequences: without its half (two-fold cross-validation), or without its source (leave one source out). The best candidate
//! has the greatest mean AUC, with equal weight for every sequence; ties go to the first.

use serde::Serialize;

use super::catalogue::Origin;
use super::{Evaluation, Score};

/// Means over sequences.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Area under the success curve, 0 to 1.
    pub auc: f64,
    /// Share of frames with a centre error of at most 20 pixels, 0 to 1.
    pub p20: f64,
    /// Frames with an IoU of 0, percent.
    pub failure_pct: f64,
}

impl Figures {
    fn mean<'a>(scores: impl Iterator<Item = &'a Score>) -> Option<Self> {
        Score::mean(scores).map(|s| Self { auc: s.auc, p20: s.p20, failure_pct: s.failure_pct })
    }
}

/// Candidates on the same sequences.
#[derive(Clone, Debug)]
pub struct Trials {
    /// The sequences' names and origins.
    sequences: Vec<(String, Origin)>,
    /// The candidates' names.
    candidates: Vec<String>,
    /// For each candidate, a score per sequence: the mean over seeds.
    scores: Vec<Vec<Score>>,
}

/// A group of sequences, and the candidate that was best on all others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chosen {
    /// The half or the source that was left out.
    pub left_out: String,
    /// The candidate that was best on the others.
    pub candidate: String,
    /// Its scores on the sequences that it was chosen on.
    pub there: Figures,
    /// Its scores on the left-out sequences.
    pub left: Figures,
}

/// Test scores of every sequence with the candidate that was chosen without it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The choices, by left-out group.
    pub choices: Vec<Chosen>,
    /// Means over all sequences.
    pub mean: Figures,
    /// The index of the candidate tested on each sequence.
    #[serde(skip)]
    pub with: Vec<usize>,
}

/// Returns the half or the source of a sequence.
pub type GroupOf = fn(&Origin) -> &str;

/// Returns the half of a sequence, `a` or `b`.
pub fn by_half(sequence: &Origin) -> &str {
    sequence.half.name()
}

/// Returns the source of a sequence.
pub fn by_source(sequence: &Origin) -> &str {
    &sequence.source
}

impl Trials {
    /// Creates trials from evaluations, one per candidate, named after it.
    ///
    /// # Panics
    /// If there is none, or one does not have every sequence.
    pub fn of(evaluations: &[Evaluation]) -> Self {
        let first = evaluations.first().expect("a candidate at least");
        let mut sequences: Vec<_> = first.rows.iter().map(|row| (row.sequence.clone(), row.origin.clone())).collect();
        sequences.sort_by(|a, b| a.0.cmp(&b.0));
        sequences.dedup();
        let scores = |e: &Evaluation| {
            sequences
                .iter()
                .map(|(name, _)| e.of_sequence(name).expect("every candidate ran on every sequence"))
                .collect()
        };
        let scores = evaluations.iter().map(scores).collect();
        Self { candidates: evaluations.iter().map(|e| e.tracker.clone()).collect(), sequences, scores }
    }

    /// Returns the names and origins of the sequences.
    pub fn sequences(&self) -> &[(String, Origin)] {
        &self.sequences
    }

    /// Returns a candidate's means over the sequences that satisfy `such`; `None` without one.
    pub fn figures(&self, candidate: usize, such: &dyn Fn(&Origin) -> bool) -> Option<Figures> {
        let scores = self.sequences.iter().zip(&self.scores[candidate]);
        Figures::mean(scores.filter(|((_, origin), _)| such(origin)).map(|(_, score)| score))
    }

    /// Returns the candidate with the greatest mean AUC over such sequences, the first of equals, and its scores there.
    pub fn best(&self, such: &dyn Fn(&Origin) -> bool) -> Option<(usize, Figures)> {
        let each = (0..self.candidates.len()).filter_map(|i| Some((i, self.figures(i, such)?)));
        each.reduce(|best, next| if next.1.auc > best.1.auc { next } else { best })
    }

    /// Tests each sequence with the candidate that is best on the sequences of other groups; `None` with fewer than two groups.
    pub fn judge(&self, group: GroupOf) -> Option<Judgement> {
        let mut groups: Vec<&str> = self.sequences.iter().map(|(_, origin)| group(origin)).collect();
        groups.sort();
        groups.dedup();
        let mut with = vec![0; self.sequences.len()];
        let mut choices = vec![];
        for left_out in groups {
            let (i, there) = self.best(&|origin| group(origin) != left_out)?;
            let left = self.figures(i, &|origin| group(origin) == left_out)?;
            let such = self.sequences.iter().zip(&mut with).filter(|((_, origin), _)| group(origin) == left_out);
            such.for_each(|(_, candidate)| *candidate = i);
            choices.push(Chosen { left_out: left_out.into(), candidate: self.candidates[i].clone(), there, left });
        }
        let mean = Figures::mean(with.iter().enumerate().map(|(s, candidate)| &self.scores[*candidate][s]))?;
        Some(Judgement { choices, mean, with })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::eval::catalogue::origin;
    use crate::eval::{Curves, Row};

    /// A candidate with these AUCs on these sequences.
    pub(crate) fn candidate(name: &str, aucs: &[(&str, f64)]) -> Evaluation {
        let row = |(sequence, auc): &(&str, f64)| {
            let score = Score {
                mask_iou: None,
                mask_box_iou: None,
                frames: 1,
                auc: *auc,
                p20: 1.0 - auc,
                centre_error: 0.0,
                centre_error_sd: 0.0,
                failures: 0,
                failure_pct: 100.0 * (1.0 - auc),
                sr50: 0.0,
                fps: None,
                values: None,
                read_pct: None,
            };
            let curves = Curves::of(&[], &[]);
            Row { sequence: (*sequence).into(), origin: origin(sequence), seed: Some(1), score, curves }
        };
        Evaluation { tracker: name.into(), rows: aucs.iter().map(row).collect(), missing: vec![] }
    }

    /// Half a: Bag, Coke, and Car1 and Car4 of one source. Half b: Bolt and Bolt2 of one source.
    pub(crate) fn three() -> Vec<Evaluation> {
        let of = |name, aucs: [f64; 6]| {
            let names = ["Bag", "Coke", "Car1", "Car4", "Bolt", "Bolt2"];
            candidate(name, &names.into_iter().zip(aucs).collect::<Vec<_>>())
        };
        vec![
            of("x=1", [0.9, 0.9, 0.1, 0.1, 0.2, 0.4]), // a: 0.5, b: 0.3, all: 2.6 / 6
            of("x=2", [0.4, 0.4, 0.4, 0.4, 0.5, 0.5]), // a: 0.4, b: 0.5, all: 2.6 / 6
            of("x=3", [0.0, 0.0, 0.0, 0.0, 0.6, 0.6]), // a: 0.0, b: 0.6, all: 1.2 / 6
        ]
    }

    #[test]
    fn halves_choose_for_each_other() {
        let trials = Trials::of(&three());
        // Half a chooses x=1, which has 0.3 on b; half b chooses x=3, which has 0 on a.
        let halves = trials.judge(by_half).expect("two halves");
        let said: Vec<_> = halves.choices.iter().map(|c| (c.left_out.as_str(), c.candidate.as_str())).collect();
        assert_eq!(said, [("a", "x=3"), ("b", "x=1")]);
        let near = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-12, "{got} is not {expected}");
        near(halves.choices[0].there.auc, 0.6);
        near(halves.choices[0].left.auc, 0.0);
        near(halves.choices[1].there.auc, 0.5);
        near(halves.choices[1].left.auc, 0.3);
        // Four zeros, 0.2 and 0.4 over six sequences; precision and failures follow the same choice.
        near(halves.mean.auc, 0.1);
        near(halves.mean.p20, 0.9);
        near(halves.mean.failure_pct, 90.0);
        // The biased score, with ties to the first, is much greater.
        let (best, plain) = trials.best(&|_| true).expect("sequences");
        assert_eq!(best, 0);
        near(plain.auc, 2.6 / 6.0);
    }

    #[test]
    fn a_source_is_left_out_as_a_whole() {
        let trials = Trials::of(&three());
        let sources = trials.judge(by_source).expect("four sources");
        let said: Vec<_> = sources.choices.iter().map(|c| (c.left_out.as_str(), c.candidate.as_str())).collect();
        // Without Bag: x=1 has 1.7, x=2 2.2. Without the cars: 2.4 and 1.8. Without Bolt: 2.0 and 1.6. Without Coke: as Bag.
        assert_eq!(said, [("Bag", "x=2"), ("Bolt", "x=1"), ("Car", "x=1"), ("Coke", "x=2")]);
        // Bag 0.4, Coke 0.4, cars 0.1 each, Bolts 0.2 and 0.4.
        assert!((sources.mean.auc - 1.6 / 6.0).abs() < 1e-12);
        let with: Vec<_> =
            trials.sequences().iter().map(|(name, _)| name.as_str()).zip(sources.with.iter().copied()).collect();
        assert_eq!(with, [("Bag", 1), ("Bolt", 0), ("Bolt2", 0), ("Car1", 0), ("Car4", 0), ("Coke", 1)]);
    }

    #[test]
    fn one_group_leaves_nothing_to_choose_on() {
        let trials = Trials::of(&[candidate("x=1", &[("Bolt", 0.5), ("Bolt2", 0.5)])]);
        assert_eq!((trials.judge(by_half), trials.judge(by_source)), (None, None));
        assert_eq!(trials.figures(0, &|_| false), None);
    }
}
