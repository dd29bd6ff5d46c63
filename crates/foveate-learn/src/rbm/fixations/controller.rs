//! Where to fixate next, for the sake of the class (Larochelle & Hinton 2010, section 4.2).
//!
//! f(s, a) = wₐᵀs + bₐ predicts log p(y | x₁..k) after a fixation at place a. s is p(h | x₁..k₋₁) and one bit for
//! each place already fixated. f is trained on |f − log p(y | x₁..k)| by stochastic gradient, with places drawn in
//! proportion to exp f; in use the best place is taken. No place is fixated twice. Section 2.2 of the paper leaves
//! this for future work.

use super::batch::add;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};
use foveate_kernels::dot;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A score for each place, linear in the fixations so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    hidden: usize,
    /// Places × (n_h + places + 1): for s, the bits, and the bias.
    weights: Vec<f32>,
}

impl Controller {
    /// Knows nothing: every place has score 0. Fails without hidden units or places.
    pub fn new(hidden: usize, places: usize) -> Result<Self> {
        if hidden == 0 || places == 0 {
            return Err(Error::Invalid("a controller needs hidden units and places".into()));
        }
        Ok(Self { hidden, weights: vec![0.0; places * (hidden + places + 1)] })
    }
    /// How many places it chooses among.
    pub fn places(&self) -> usize {
        // weights.len() = places (places + hidden + 1)
        let (n, b) = (self.weights.len(), self.hidden + 1);
        (1..=n).find(|p| p * (p + b) >= n).expect("made with a place")
    }
    /// f(s, a) for every place, in nats; `hidden` is p(h | x so far), `seen` marks the fixated places.
    pub fn scores(&self, hidden: &[f32], seen: &[bool], scores: &mut [f32]) {
        for (w, score) in self.weights.chunks_exact(self.hidden + seen.len() + 1).zip(scores) {
            let bits = &w[self.hidden..];
            let visited: f32 = seen.iter().zip(bits).filter(|s| *s.0).map(|s| s.1).sum();
            *score = dot(&w[..self.hidden], hidden) + visited + bits[seen.len()];
        }
    }
    /// The place with the highest score of those not seen, or None if all are.
    pub fn best(&self, hidden: &[f32], seen: &[bool]) -> Option<usize> {
        let mut scores = vec![0.0; seen.len()];
        self.scores(hidden, seen, &mut scores);
        (0..seen.len()).filter(|&a| !seen[a]).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))
    }
    /// A place not seen, drawn in proportion to exp f, or None if all are.
    pub fn draw(&self, hidden: &[f32], seen: &[bool], rng: &mut Rng) -> Option<usize> {
        let mut scores = vec![0.0; seen.len()];
        self.scores(hidden, seen, &mut scores);
        let most = scores.iter().zip(seen).filter(|s| !s.1).map(|s| *s.0).fold(f32::NEG_INFINITY, f32::max);
        let share = |a: usize| if seen[a] { 0.0 } else { (scores[a] - most).exp() };
        let mut left = rng.random::<f32>() * (0..seen.len()).map(share).sum::<f32>();
        let drawn = (0..seen.len()).find(|&a| {
            left -= share(a);
            left < 0.0
        });
        drawn.or_else(|| (0..seen.len()).rfind(|&a| !seen[a]))
    }
    /// A step of size `rate` down the gradient of |f(s, place) − log_p|: `log_p` is log p(y | x₁..k) of the true class y
    /// after a fixation at `place`, the k-th.
    pub fn learn(&mut self, hidden: &[f32], seen: &[bool], place: usize, log_p: f32, rate: f32) {
        let width = self.hidden + seen.len() + 1;
        let mut scores = vec![0.0; seen.len()];
        self.scores(hidden, seen, &mut scores);
        let step = if log_p > scores[place] { rate } else { -rate };
        let w = &mut self.weights[place * width..][..width];
        add(&mut w[..self.hidden], step, hidden);
        seen.iter().zip(&mut w[self.hidden..]).filter(|s| *s.0).for_each(|s| *s.1 += step);
        w[width - 1] += step;
    }
}
