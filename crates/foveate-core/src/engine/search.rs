//! Searches beyond the paper: of the whole picture for a lost target, and around the estimate for a target that has moved abruptly. Each
//! draws some of the particles again.

use super::distractors::Distractors;
use super::filter::Filter;
use super::monitor::Monitor;
use super::particles::Particles;
use super::view::{Looks, View, set_short_term_aside};
use crate::control::{CLOSER, LocalSearch, REFINEMENTS, WORTH};
use crate::geometry::State;
use foveate_base::rng::{Purpose, Streams};

impl Filter {
    /// Searches the whole picture if the target is lost, and around the estimate otherwise. Returns the distractors around the estimate,
    /// if there was a search for them, in the buffer `found`.
    pub(super) fn search(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        monitor: &mut Monitor,
        (lost, streams, t): (bool, Streams, u64),
        found: Distractors,
    ) -> Distractors {
        if self.redetection.as_mut().is_some_and(|search| search.is_due(lost, t)) {
            let seen = monitor.loss.seen().copied().unwrap_or_else(|| belief.belief().mean());
            let best = self.redetect(view, belief, looks, &seen, streams.at(t, Purpose::Redetection));
            monitor.loss.searched(best.as_ref());
        }
        let found = found.forget();
        if lost || !view.is_judged {
            return found;
        }
        self.search_around(view, belief, looks, monitor, found, streams.at(t, Purpose::LocalSearch))
    }

    /// Scores places all over the picture, draws some of the states again from the best, and weighs all particles again. `seen` is the
    /// place where the target was last tracked. Returns the best place.
    fn redetect(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        seen: &State,
        streams: Streams,
    ) -> Option<State> {
        let search = self.redetection.as_mut()?;
        let reference = view.target.reference;
        let mut scores = view.scores(search.places(view.size(), seen, view.target.extent));
        let places = search.recall(scores);
        scores = view.scores(places);
        for _ in 0..REFINEMENTS {
            let places = search.candidates.refine(scores);
            scores = view.scores(places);
        }
        let least = reference.on - search.settings().fit * (reference.on - reference.off);
        let best = search.candidates.best(scores).map(|(place, _)| place);
        search.candidates.draw(least, &mut belief.states, &mut belief.log_importance, &mut belief.drawn, streams);
        belief.apply_detection_likelihood(self.detection_likelihood.as_ref(), view);
        belief.weigh_drawn(view, looks);
        best
    }

    /// Draws some of the states again from the places around the estimate, if one of them fits better than the estimate does, fits well,
    /// and was not seen beside the target before. In doubt the scores leave out the short-term memory, which may have learned an object
    /// that occludes the target; if another place is better, that memory is reset. Returns the distractors around the estimate, in the
    /// buffer of `found`.
    fn search_around(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        monitor: &mut Monitor,
        found: Distractors,
        streams: Streams,
    ) -> Distractors {
        let Some(search) = self.local_search.as_mut() else { return found };
        let estimate = belief.belief().mean();
        let is_doubtful = monitor.loss.last().own >= search.settings().doubt;
        let aside = is_doubtful && set_short_term_aside(view.appearance, true);
        let mut found = found.search(monitor.distractors.as_mut(), view, &estimate);
        let least = better_place(search, monitor, view, &estimate, &found);
        if aside {
            set_short_term_aside(view.appearance, false);
            found = found.forget();
        }
        let Some(least) = least else { return found };
        search.candidates.draw(least, &mut belief.states, &mut belief.log_importance, &mut belief.drawn, streams);
        belief.apply_detection_likelihood(self.detection_likelihood.as_ref(), view);
        if aside {
            // The log-likelihoods of all particles change without the short-term memory.
            if let Some(memory) = view.appearance.memory() {
                memory.forget_short_term();
            }
            belief.drawn.clear();
            belief.drawn.extend(0..belief.states.len());
        }
        belief.weigh_drawn(view, looks);
        found
    }
}

/// Compares the places around the estimate with it. If one is better, returns the least log-likelihood of the places to draw from.
fn better_place(
    search: &mut LocalSearch,
    monitor: &mut Monitor,
    view: &mut View<'_>,
    estimate: &State,
    found: &Distractors,
) -> Option<f64> {
    let (reference, best, lattice) = (view.target.reference, found.best?, monitor.distractors.as_ref()?.lattice());
    let here = view.scores(&[*estimate])[0];
    if best < here - WORTH {
        return None;
    }
    let mut scores = view.scores(search.begin(&found.states, estimate, view.target.extent, lattice));
    for _ in 0..CLOSER {
        let places = search.candidates.refine(scores);
        scores = view.scores(places);
    }
    let least = here.max(reference.on - search.settings().fit * (reference.on - reference.off));
    let (place, fit) = search.candidates.best(scores)?;
    (fit >= least && !monitor.was_beside(view, [place, *estimate])).then_some(least)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{beside, evidence, look, weighed};
    use super::super::toy::{Learned, OFF, SLOPE, Toy, parts};
    use super::*;
    use crate::control::{Consistency, FrameEvidence};

    /// In doubt, places are compared without the short-term memory. If another place is better, that memory is reset and all particles are
    /// weighed again.
    #[test]
    fn a_search_in_doubt_ignores_the_short_term_memory() {
        for doubtful in [false, true] {
            let mut monitor = beside(false);
            let shown = evidence(&mut monitor);
            let deficit = f64::from(u8::from(doubtful));
            let shown = FrameEvidence { consistency: Consistency { deficit, ..shown.consistency }, ..shown };
            monitor.judge(true, &shown);
            let mut toy = Toy { learned: Some(Learned { nats: 3.0, ..Learned::default() }), ..Toy::at(70.0) };
            let mut filter = parts(Toy::at(70.0)).filter.with_local_search(Some(LocalSearch::new(Default::default())));
            let belief = look(&mut toy, 1.0, |view| {
                let (mut belief, mut looks) = weighed(view, &[50.0; 10]);
                let when = (false, Streams::new(1, 0), 60);
                filter.search(view, &mut belief, &mut looks, &mut monitor, when, Distractors::default());
                belief
            });
            let learned = toy.learned.expect("it learns");
            let nats = if doubtful { 0.0 } else { 3.0 };
            assert!(learned.nats == nats && !learned.aside && !belief.drawn.is_empty(), "doubtful {doubtful}");
            for (i, particle) in belief.states.iter().enumerate() {
                let fit = (-SLOPE * (particle.x - 70.0).abs()).max(OFF) + nats;
                assert!((belief.log_weights[i] - belief.log_importance[i] - fit).abs() < 1e-9, "particle {i}");
            }
        }
    }
}
