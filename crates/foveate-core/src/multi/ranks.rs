//! The confidence of a detector, independent of its scale: the rank of a score among recent scores.
//!
//! Detectors report probabilities, log odds, or sums of votes. The fraction of the recent scores that are not above a score is comparable
//! among all of them. Without scores, or with equal ones, there is no rank.

use crate::scene::Detection;

/// Number of recent scores that are remembered.
const REMEMBERED: usize = 1000;

/// The scores of recent detections.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Ranks {
    scores: Vec<f64>,
    /// The index of the next score once the buffer is full.
    next: usize,
}

impl Ranks {
    /// Adds the scores of a frame; scores that are not finite are ignored.
    pub(super) fn look(&mut self, detections: &[Detection]) {
        for score in detections.iter().map(|d| d.score).filter(|score| score.is_finite()) {
            if self.scores.len() < REMEMBERED {
                self.scores.push(score);
            } else {
                let next = self.next % REMEMBERED;
                self.scores[next] = score;
                self.next = next + 1;
            }
        }
    }

    /// Returns the fraction of the remembered scores that are not above this one, 0 to 1; `None` if it is not a score, or all are equal.
    pub(super) fn of(&self, score: f64) -> Option<f64> {
        let first = *self.scores.first()?;
        if !score.is_finite() || self.scores.iter().all(|s| *s == first) {
            return None;
        }
        Some(self.scores.iter().filter(|s| **s <= score).count() as f64 / self.scores.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BBox;

    fn scored(score: f64) -> Detection {
        Detection::new(BBox { x: 0.0, y: 0.0, w: 9.0, h: 9.0 }, score)
    }

    #[test]
    fn a_rank_is_the_fraction_of_scores_not_above() {
        let mut ranks = Ranks::default();
        assert_eq!(ranks.of(-3.0), None);
        ranks.look(&[scored(5.0), scored(f64::NAN), scored(-1.0), scored(7.0), scored(5.0)]);
        assert_eq!([-2.0, -1.0, 5.0, 6.0, 9.0].map(|s| ranks.of(s)), [0.0, 0.25, 0.75, 0.75, 1.0].map(Some));
        assert_eq!(ranks.of(f64::NAN), None);
        // The oldest scores are dropped: 1000 times the same.
        (0..REMEMBERED).for_each(|_| ranks.look(&[scored(2.0)]));
        assert_eq!((ranks.of(2.0), ranks.of(1.9)), (None, None), "always the same is no score");
    }
}
