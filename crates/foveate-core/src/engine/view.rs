//! What one frame shows of one target: log p(h | x, a) at any place of it.

use super::target::Target;
use super::visibility::Visibility;
use crate::control::DistractorSearch;
use crate::geometry::{Gaze, State};
use crate::identity::{Appearance, Percept};
use crate::scene::Scene;

/// One frame, as the appearance model of one target sees it.
pub(super) struct View<'a> {
    pub appearance: &'a mut dyn Appearance,
    pub scene: Scene<'a>,
    pub target: Target,
    pub visibility: &'a Visibility,
    /// Whether enough of the target is in view for its looks to say whether it is lost.
    pub is_judged: bool,
    pub scratch: &'a mut Scratch,
}

/// Buffers of a view that are grown once. Nothing in them is read by another call.
#[derive(Default)]
pub(super) struct Scratch {
    states: Vec<State>,
    scores: Vec<f64>,
    pub features: Vec<f32>,
}

/// log p(h | x, a) of all particles under every gaze of a plan.
#[derive(Default)]
pub(super) struct Looks {
    /// The gazes of the plan, relative to the gaze that the appearance is committed to.
    pub gazes: Vec<Gaze>,
    /// How much each of them counts for the weights of the particles: the weights of its plan.
    weights: Vec<f64>,
    /// A row of N for each gaze.
    log_likelihood: Vec<f64>,
    particles: usize,
}

impl<'a> View<'a> {
    /// One frame of `target`, which is expected at a place before the looks.
    pub(super) fn new(
        appearance: &'a mut dyn Appearance,
        scene: Scene<'a>,
        target: Target,
        visibility: &'a Visibility,
        expected: &State,
        scratch: &'a mut Scratch,
    ) -> Self {
        Self { appearance, scene, target, visibility, is_judged: visibility.is_judged(expected), scratch }
    }

    /// Width and height of the picture, pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.scene.image.width(), self.scene.image.height())
    }

    /// log p(h | x, a) of these states under all gazes, which count with these weights, in the buffer `looks`. The part of the picture that
    /// a search for distractors around the target needs is prepared at the same time.
    pub(super) fn log_likelihoods(
        &mut self,
        states: &[State],
        (gazes, weights, around): (&[Gaze], &[f64], Option<&DistractorSearch>),
        mut looks: Looks,
    ) -> Looks {
        let committed = self.appearance.committed_gaze();
        looks.gazes.clear();
        looks.gazes.extend(gazes.iter().map(|gaze| gaze.relative_to(committed)));
        looks.weights.clear();
        looks.weights.extend_from_slice(weights);
        self.scratch.states.clear();
        self.scratch.states.extend_from_slice(states);
        if let Some(around) = around {
            around.surround(&mut self.scratch.states, self.target.extent);
        }
        self.appearance.prepare(self.scene.image, &self.scratch.states, &looks.gazes);
        looks.particles = states.len();
        looks.log_likelihood.resize(looks.gazes.len() * states.len(), 0.0);
        for (gaze, row) in looks.gazes.iter().zip(looks.log_likelihood.chunks_exact_mut(states.len())) {
            self.log_likelihood(states, *gaze, row);
        }
        looks
    }

    /// log p(h | x, a) of states that were prepared, as far as the target is visible there.
    pub(super) fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        self.appearance.log_likelihood(states, gaze, out);
        self.visibility.apply(states, out, self.target.reference);
    }

    /// log p(h | x, a) of other places under the centre gaze, as if all of the target were visible there.
    pub(super) fn scores(&mut self, places: &[State]) -> &[f64] {
        self.appearance.extend(self.scene.image, places, &[Gaze::CENTRE]);
        self.prepared_scores(places)
    }

    /// The same of places that were prepared.
    pub(super) fn prepared_scores(&mut self, places: &[State]) -> &[f64] {
        self.scratch.scores.resize(places.len(), 0.0);
        self.appearance.log_likelihood(places, Gaze::CENTRE, &mut self.scratch.scores);
        &self.scratch.scores
    }

    /// log p(h | x, a) of the estimate, with and without the short-term memory, and the best of the `others` without it; `None` without a
    /// short-term memory.
    pub(super) fn long_term_scores(&mut self, estimate: &State, others: &[State]) -> Option<LongTerm> {
        let Scratch { states, scores, .. } = &mut *self.scratch;
        states.clear();
        states.push(*estimate);
        states.extend_from_slice(others);
        scores.resize(states.len(), 0.0);
        if !set_short_term_aside(self.appearance, true) {
            return None;
        }
        self.appearance.log_likelihood(states, Gaze::CENTRE, scores);
        set_short_term_aside(self.appearance, false);
        let mut here = [0.0];
        self.appearance.log_likelihood(&[*estimate], Gaze::CENTRE, &mut here);
        let best = scores[1..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some(LongTerm { change: scores[0] - here[0], best })
    }

    /// What is seen at a state under the chosen gaze of the plan.
    pub(super) fn glimpse(&mut self, state: &State, chosen: Gaze, mut percept: Percept) -> Percept {
        let gaze = chosen.relative_to(self.appearance.committed_gaze());
        // The mean of states that are scattered lies where none of them is.
        self.appearance.extend(self.scene.image, &[*state], &[gaze]);
        self.appearance.glimpse(state, gaze, &mut percept);
        percept.gaze = chosen;
        percept
    }
}

/// Leaves the short-term memory out of log-likelihoods, or takes it in again. Returns whether there is one that has learned.
pub(super) fn set_short_term_aside(appearance: &mut dyn Appearance, aside: bool) -> bool {
    appearance.memory().is_some_and(|memory| memory.set_short_term_aside(aside))
}

/// Log-likelihoods without the short-term memory.
pub(super) struct LongTerm {
    /// Nats that the estimate has more without the short-term memory than with it.
    pub change: f64,
    /// The log-likelihood of the best of the other places; −∞ if there is none.
    pub best: f64,
}

impl Looks {
    /// The log-likelihoods of each gaze of the plan.
    pub(super) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.log_likelihood.chunks_exact(self.particles)
    }

    /// The gazes that move the belief: the weight of each, and its log-likelihoods.
    pub(super) fn used(&self) -> impl Iterator<Item = (f64, &[f64])> {
        self.weights.iter().copied().zip(self.rows()).filter(|(weight, _)| *weight > 0.0)
    }

    /// How many looks the used gazes count for: the sum of their weights.
    pub(super) fn count(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// Looks again at the states with these indices, under the gazes that are used, and adds the log-likelihoods to their log weights.
    pub(super) fn look_again(
        &mut self,
        view: &mut View<'_>,
        states: &[State],
        which: &[usize],
        log_weights: &mut [f64],
    ) {
        view.appearance.extend(view.scene.image, states, &self.gazes);
        let mut again = std::mem::take(&mut view.scratch.states);
        again.clear();
        again.extend(which.iter().map(|i| states[*i]));
        let mut scores = std::mem::take(&mut view.scratch.scores);
        scores.resize(again.len(), 0.0);
        let gazes = self.gazes.iter().zip(&self.weights).enumerate();
        for (k, (gaze, weight)) in gazes.filter(|(_, (_, weight))| **weight > 0.0) {
            view.log_likelihood(&again, *gaze, &mut scores);
            for (i, l) in which.iter().zip(&scores) {
                self.log_likelihood[k * self.particles + i] = *l;
                log_weights[*i] += weight * l;
            }
        }
        (view.scratch.states, view.scratch.scores) = (again, scores);
    }
}
