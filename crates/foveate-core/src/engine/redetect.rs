//! `redetect`: a lost target may be anywhere, so some particles are drawn from where the picture looks most like it.
//! `search_around`: distractors, too, are looked for beyond the particles, and one of them may be the target, which has leapt.

use super::Engine;
use super::template::attenuate;
use crate::control::{Belief, CLOSER, REFINEMENTS, WORTH, distractors, normalize};
use crate::geometry::{Gaze, State};
use crate::identity::Appearance;
use crate::scene::{Detection, Image, Scene};
use foveate_base::rng::Purpose;

impl Engine {
    /// While the target is believed lost: scores places all over the picture, draws some of the predicted states again from
    /// the best, and looks at these, so that log prior, log posterior and weights are those of all states again.
    pub(super) fn redetect(&mut self, scene: Scene<'_>) {
        let image = scene.image;
        let (reference, target) = (self.reference(), *self.target());
        let (parts, w) = (&mut self.parts, &mut self.work);
        let Some(search) = &mut parts.filter.redetection else { return };
        if !search.is_due(self.context.lost, self.frame) {
            return;
        }
        let predicted = || Belief { states: &w.predicted, weights: &w.weights }.mean();
        let seen = parts.monitor.loss.seen().copied().unwrap_or_else(predicted);
        let appearance = &mut *parts.appearance;
        look(appearance, image, search.places((image.width(), image.height()), &seen, target.extent), &mut w.scores);
        look(appearance, image, search.recall(&w.scores), &mut w.scores);
        for _ in 0..REFINEMENTS {
            look(appearance, image, search.candidates.refine(&w.scores), &mut w.scores);
        }
        let least = reference.on - search.settings().fit * (reference.on - reference.off);
        let streams = self.streams.at(self.frame, Purpose::Redetection);
        parts.monitor.loss.searched(search.candidates.best(&w.scores).map(|(place, _)| place).as_ref());
        search.candidates.draw(least, &mut w.predicted, &mut w.log_prior, &mut w.redetected, streams);
        self.owe(scene.detections);
        self.weigh_drawn(image);
    }

    /// While the target is not lost: where a place around it, looked at closely, fits better than the estimate does, and well, and was not
    /// beside the target before, some of the predicted states are drawn again from there. In doubt what was learned for now has no say: it
    /// may be what hides the target, and is forgotten where another place is the better one.
    pub(super) fn search_around(&mut self, scene: Scene<'_>) {
        let Some(search) = self.parts.filter.local_search.as_ref() else { return };
        if self.context.lost || !self.is_judged() {
            return;
        }
        let doubtful = self.parts.monitor.loss.last().own >= search.settings().doubt;
        let estimate = Belief { states: &self.work.predicted, weights: &self.work.weights }.mean();
        let aside = doubtful && self.parts.appearance.set_short_term_aside(true);
        let found = self.leap_to(scene.image, &estimate);
        if aside {
            self.parts.appearance.set_short_term_aside(false);
            self.work.around = None;
        }
        let Some(least) = found else { return };
        let (parts, w) = (&mut self.parts, &mut self.work);
        let Some(search) = &mut parts.filter.local_search else { return };
        let streams = self.streams.at(self.frame, Purpose::LocalSearch);
        search.candidates.draw(least, &mut w.predicted, &mut w.log_prior, &mut w.redetected, streams);
        self.owe(scene.detections);
        if aside {
            // Then all look otherwise.
            self.parts.appearance.forget_short_term();
            self.work.redetected.clear();
            self.work.redetected.extend(0..self.work.predicted.len());
        }
        self.weigh_drawn(scene.image);
    }

    /// Whether one of the places around the estimate is a better one: then the least log-likelihood that places are drawn from.
    fn leap_to(&mut self, image: &Image, estimate: &State) -> Option<f64> {
        let (reference, extent) = (self.reference(), self.target().extent);
        let best = self.look_around(image, estimate)?;
        let (parts, w) = (&mut self.parts, &mut self.work);
        let (search, around) = (parts.filter.local_search.as_mut()?, parts.monitor.distractors.as_ref()?);
        let appearance = &mut *parts.appearance;
        look(appearance, image, &[*estimate], &mut w.scores);
        let here = w.scores[0];
        if best < here - WORTH {
            return None;
        }
        look(appearance, image, search.begin(&w.distractors, estimate, extent, around.lattice()), &mut w.scores);
        for _ in 0..CLOSER {
            look(appearance, image, search.candidates.refine(&w.scores), &mut w.scores);
        }
        let least = here.max(reference.on - search.settings().fit * (reference.on - reference.off));
        let (place, fit) = search.candidates.best(&w.scores)?;
        (fit >= least && !parts.monitor.was_beside(appearance, [place, *estimate], &mut w.features)).then_some(least)
    }

    /// What detections say of the predicted states that were drawn again, `work.redetected`, is in their log prior, as in that of all.
    fn owe(&mut self, detections: &[Detection]) {
        let (extent, w) = (self.target().extent, &mut self.work);
        let Some(likelihood) = &self.parts.filter.detection_likelihood else { return };
        let told = |state: &State| likelihood.log_likelihood(detections, state, extent) + w.detected;
        w.redetected.iter().for_each(|i| w.log_prior[*i] += told(&w.predicted[*i]));
    }

    /// Looks again at those of the predicted states that `work.redetected` names: log posterior and weights are those of all again.
    fn weigh_drawn(&mut self, image: &Image) {
        let reference = self.reference();
        let (parts, w) = (&mut self.parts, &mut self.work);
        if w.redetected.is_empty() {
            return;
        }
        let appearance = &mut *parts.appearance;
        appearance.see_more(image, &w.predicted, &w.gazes);
        w.drawn.clear();
        w.drawn.extend(w.redetected.iter().map(|i| w.predicted[*i]));
        w.redetected.iter().for_each(|i| w.log_posterior[*i] = w.log_prior[*i]);
        let n = w.predicted.len();
        let gazes = w.gazes.iter().zip(w.plan.weights()).enumerate();
        for (k, (gaze, weight)) in gazes.filter(|(_, (_, weight))| **weight > 0.0) {
            score(appearance, &w.drawn, *gaze, &mut w.scores);
            self.exclusion.apply(&w.drawn, &mut w.scores, reference);
            attenuate(&mut w.scores, self.visible);
            for (i, l) in w.redetected.iter().zip(&w.scores) {
                w.log_likelihood[k * n + i] = *l;
                w.log_posterior[*i] += weight * l;
            }
        }
        w.log_evidence = normalize(&w.log_posterior, &mut w.weights);
    }

    /// Fills `work.distractors` with the places around the estimate that look most like the target. The log-likelihood of the
    /// best; `None` where they are not looked for.
    pub(super) fn look_around(&mut self, image: &Image, estimate: &State) -> Option<f64> {
        let extent = self.target().extent;
        let (parts, w) = (&mut self.parts, &mut self.work);
        let around = parts.monitor.distractors.as_mut()?;
        if let Some((_, best)) = w.around.filter(|(at, _)| at == estimate) {
            return Some(best);
        }
        let places = around.places((image.width(), image.height()), estimate, extent);
        // An estimate that has left the picture has nothing around it.
        if places.is_empty() {
            w.distractors.clear();
            return Some(f64::NEG_INFINITY);
        }
        look(&mut *parts.appearance, image, places, &mut w.scores);
        let best = distractors(places, &w.scores, estimate, extent, &mut w.distractors);
        w.around = Some((*estimate, best));
        Some(best)
    }

    /// Looks around the target, at `state`, in its first frame: remembers what is there, and learns what looks most like the target
    /// and is not, each where the settings ask for it. What was remembered before is forgotten.
    pub(super) fn look_around_first(&mut self, image: &Image, state: &State) {
        let extent = self.target().extent;
        let (parts, w) = (&mut self.parts, &mut self.work);
        let Some(around) = &mut parts.monitor.distractors else { return };
        let (first_frame, surroundings) = (around.first_frame(), &mut parts.monitor.surroundings);
        if let Some(surroundings) = surroundings {
            surroundings.clear();
            w.features.reserve(surroundings.places() * parts.appearance.width());
        }
        if !first_frame && surroundings.is_none() {
            return;
        }
        let places = around.places((image.width(), image.height()), state, extent);
        if places.is_empty() {
            return;
        }
        parts.appearance.see(image, places, &[Gaze::CENTRE]);
        if first_frame {
            score(&mut *parts.appearance, places, Gaze::CENTRE, &mut w.scores);
            distractors(places, &w.scores, state, extent, &mut w.distractors);
        }
        self.remember(state);
        if first_frame {
            self.parts.appearance.init_distractors(image, state, &self.work.distractors);
        }
    }
}

/// Looks at more states, and has their log-likelihoods.
fn look(appearance: &mut dyn Appearance, image: &Image, states: &[State], out: &mut Vec<f64>) {
    appearance.see_more(image, states, &[Gaze::CENTRE]);
    score(appearance, states, Gaze::CENTRE, out);
}

/// Log-likelihoods of states whose surroundings were seen, as many as there are states.
fn score(appearance: &mut dyn Appearance, states: &[State], gaze: Gaze, out: &mut Vec<f64>) {
    out.resize(states.len(), 0.0);
    appearance.log_likelihood(states, gaze, out);
}
