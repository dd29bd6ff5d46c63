//! The likelihood of one target in one frame: log p(h | x, a) at any place.

use super::target::Target;
use super::visibility::Visibility;
use crate::control::DistractorSearch;
use crate::geometry::{Gaze, Size, State};
use crate::identity::{Appearance, Percept};
use crate::scene::Scene;

/// One frame under the appearance model of one target.
pub(super) struct View<'a> {
    pub appearance: &'a mut dyn Appearance,
    pub scene: Scene<'a>,
    pub target: Target,
    pub visibility: &'a Visibility,
    /// Whether the visible fraction of the target is large enough to judge whether it is lost.
    pub is_judged: bool,
    pub scratch: &'a mut Scratch,
}

/// Buffers of a view, allocated once. No call reads the values of another call.
#[derive(Default)]
pub(super) struct Scratch {
    states: Vec<State>,
    scores: Vec<f64>,
    pub features: Vec<f32>,
}

/// log p(h | x, a) of all particles under every gaze of a plan.
#[derive(Default)]
pub(super) struct Looks {
    /// The gazes of the plan, relative to the gaze to which the appearance is committed.
    pub gazes: Vec<Gaze>,
    /// The weight of each gaze in the plan.
    weights: Vec<f64>,
    /// One row of N values for each gaze.
    log_likelihood: Vec<f64>,
    particles: usize,
}

impl<'a> View<'a> {
    /// Creates the view of one frame of `target`, with its expected state before the looks.
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

    /// Returns width and height of the picture, pixels.
    pub(super) fn size(&self) -> Size {
        self.scene.image.size()
    }

    /// Computes log p(h | x, a) of these states under all gazes, with these weights, in the buffer `looks`. It also prepares the part of
    /// the picture that a search for distractors around the target needs.
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

    /// Computes log p(h | x, a) of prepared states, reduced by the visibility of the target there.
    pub(super) fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        self.appearance.log_likelihood(states, gaze, out);
        self.visibility.apply(states, out, self.target.reference);
    }

    /// Computes log p(h | x, a) of other places under the centre gaze, as if the whole target were visible there.
    pub(super) fn scores(&mut self, places: &[State]) -> &[f64] {
        self.appearance.extend(self.scene.image, places, &[Gaze::CENTRE]);
        self.prepared_scores(places)
    }

    /// Computes the colour distance of each place, and its score less these nats per unit of colour distance. Returns false if colours do
    /// not separate the target from its surroundings.
    pub(super) fn colour_scores(
        &mut self,
        places: &[State],
        nats: f64,
        (colours, scores): (&mut Vec<f64>, &mut Vec<f64>),
    ) -> bool {
        colours.resize(places.len(), 0.0);
        if !self.appearance.colour_distances(self.scene.image, places, colours) {
            return false;
        }
        scores.clear();
        scores.extend(self.scores(places).iter().zip(&*colours).map(|(score, colour)| score - nats * colour));
        true
    }

    /// Computes the scores of [`View::scores`] for prepared places.
    pub(super) fn prepared_scores(&mut self, places: &[State]) -> &[f64] {
        self.scratch.scores.resize(places.len(), 0.0);
        self.appearance.log_likelihood(places, Gaze::CENTRE, &mut self.scratch.scores);
        &self.scratch.scores
    }

    /// Returns the glimpse at a state under the chosen gaze of the plan.
    pub(super) fn glimpse(&mut self, state: &State, chosen: Gaze, mut percept: Percept) -> Percept {
        let gaze = chosen.relative_to(self.appearance.committed_gaze());
        // The mean of scattered states is not near any of them, so it is prepared too.
        self.appearance.extend(self.scene.image, &[*state], &[gaze]);
        self.appearance.glimpse(state, gaze, &mut percept);
        percept.gaze = chosen;
        percept
    }
}

impl Looks {
    /// Returns the log-likelihoods of each gaze of the plan.
    pub(super) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.log_likelihood.chunks_exact(self.particles)
    }

    /// Returns the weight and the log-likelihoods of each gaze that moves the belief.
    pub(super) fn used(&self) -> impl Iterator<Item = (f64, &[f64])> {
        self.weights.iter().copied().zip(self.rows()).filter(|(weight, _)| *weight > 0.0)
    }

    /// Returns the sum of the weights of the used gazes: the effective number of looks.
    pub(super) fn count(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// Computes the likelihood of the states with these indices again, under the used gazes, and adds it to their log weights.
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
