//! Searches beyond the paper: of the whole picture for a lost target, and around the estimate for a target that has moved abruptly. Each
//! draws some of the particles again.

use super::distractors::Distractors;
use super::filter::Filter;
use super::monitor::Monitor;
use super::particles::Particles;
use super::view::{Looks, View};
use crate::control::{ByColour, CLOSER, LocalSearch, REFINEMENTS, SearchResult, WORTH};
use crate::geometry::State;
use foveate_base::rng::{Purpose, Streams};

impl Filter {
    /// Searches the whole picture if the target is lost, and around the estimate otherwise. Returns the best place in the picture and the
    /// distractors around the estimate, each if there was a search for it, in the buffer `found`.
    pub(super) fn search(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        monitor: &mut Monitor,
        (lost, streams, t): (bool, Streams, u64),
        found: Distractors,
    ) -> Distractors {
        let streams = |purpose| streams.at(t, purpose);
        let mut found = found.forget();
        if view.is_judged && self.follow_colours(view, belief, looks, monitor, (streams(Purpose::ColourSearch), t)) {
            return found;
        }
        if self.redetection.as_mut().is_some_and(|search| search.is_due(lost, t)) {
            let seen = monitor.loss.seen().copied().unwrap_or_else(|| belief.belief().mean());
            let best = self.redetect(view, belief, looks, &seen, streams(Purpose::Redetection));
            found.search = Some(SearchResult { best });
        }
        if lost || !view.is_judged {
            return found;
        }
        self.search_around(view, belief, looks, monitor, found, streams(Purpose::LocalSearch))
    }

    /// Scores places all over the picture, draws some of the states again from the best, and weighs all particles again. `seen` is the
    /// place where the target was last tracked. Returns the best place if it fits better than the estimate then does.
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
        let best = search.candidates.best(scores);
        search.candidates.draw(least, &mut belief.states, &mut belief.log_importance, &mut belief.drawn, streams);
        belief.apply_detection_likelihood(self.detection_likelihood.as_ref(), view);
        belief.weigh_drawn(view, looks);
        let here = view.scores(&[belief.belief().mean()])[0];
        best.filter(|(_, fit)| *fit > here).map(|(place, _)| place)
    }

    /// Moves all particles to the place near the last one that has the colours of the target, if the target is new or fast and the estimate
    /// fits badly ([`ByColour`]). Returns whether they moved.
    fn follow_colours(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        monitor: &mut Monitor,
        (streams, t): (Streams, u64),
    ) -> bool {
        let (Some(search), Some(around)) = (self.local_search.as_deref_mut(), monitor.distractors.as_mut()) else {
            return false;
        };
        let (expected, target) = (belief.expected, view.target);
        let speed = expected.vx.hypot(expected.vy) / (target.unit * expected.log_scale.exp());
        if t > ByColour::NEW && speed < ByColour::FAST {
            return false;
        }
        let ByColour { candidates, places, colours, scores } = &mut search.by_colour;
        let (estimate, reference) = (belief.belief().mean(), target.reference);
        let here = view.scores(&[estimate])[0];
        if here > reference.on - ByColour::UNFIT * (reference.on - reference.off) {
            return false;
        }
        // Particles of a fast target are far from the last place in the direction of its motion, and it may turn round.
        let last = State { x: expected.x - expected.vx, y: expected.y - expected.vy, ..estimate };
        places.clear();
        places.push(estimate);
        places.extend_from_slice(around.places(view.size(), &last, target.extent));
        colours.resize(places.len(), 0.0);
        if !view.appearance.colour_distances(view.scene.image, places, colours) || colours[0] < ByColour::NEAR {
            return false;
        }
        let least = here - ByColour::NATS * colours[0] + ByColour::BETTER;
        let mut worth = colours.iter().map(|colour| *colour < ByColour::WORTH);
        places.retain(|_| worth.next().unwrap_or(false));
        if places.is_empty() {
            return false;
        }
        let states = candidates.begin(places, estimate.half(target.extent), around.lattice());
        view.colour_scores(states, ByColour::NATS, (colours, scores));
        for _ in 0..CLOSER {
            view.colour_scores(candidates.refine(scores), ByColour::NATS, (colours, scores));
        }
        let Some((place, fit)) = candidates.best(scores).filter(|(_, fit)| *fit >= least) else { return false };
        let mut colour = [0.0];
        view.appearance.colour_distances(view.scene.image, &[place], &mut colour);
        if colour[0] > ByColour::FAR {
            return false;
        }
        for state in &mut belief.states {
            (state.vx, state.vy) = (state.vx - state.x, state.vy - state.y);
        }
        candidates.draw(fit, &mut belief.states, &mut belief.log_importance, &mut belief.drawn, streams);
        for state in &mut belief.states {
            (state.vx, state.vy) = (state.vx + state.x, state.vy + state.y);
        }
        belief.apply_detection_likelihood(self.detection_likelihood.as_ref(), view);
        belief.weigh_drawn(view, looks);
        true
    }

    /// Draws some of the states again from the places around the estimate, if one of them fits better than the estimate does, fits well,
    /// and was not seen beside the target before. Returns the distractors around the estimate, in the buffer of `found`.
    fn search_around(
        &mut self,
        view: &mut View<'_>,
        belief: &mut Particles,
        looks: &mut Looks,
        monitor: &mut Monitor,
        found: Distractors,
        streams: Streams,
    ) -> Distractors {
        let Some(search) = self.local_search.as_deref_mut() else { return found };
        let estimate = belief.belief().mean();
        let found = found.search(monitor.distractors.as_mut(), view, &estimate);
        let Some(least) = better_place(search, monitor, view, &estimate, &found) else { return found };
        search.candidates.draw(least, &mut belief.states, &mut belief.log_importance, &mut belief.drawn, streams);
        belief.apply_detection_likelihood(self.detection_likelihood.as_ref(), view);
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
    use super::super::toy::{OFF, SLOPE, Toy, parts};
    use super::*;
    use crate::control::DistractorSettings;

    /// A target that is new or fast is followed to its colours, with the velocity of that leap, if its shape fits nowhere near; another one
    /// is not, and neither is one with the colours of its surroundings.
    #[test]
    fn a_fast_target_is_followed_by_its_colours() {
        for (t, speed, at, colours, follows) in [
            (1, 0.0, 200.0, Some(76.0), true),
            (60, 8.0, 200.0, Some(76.0), true),
            (60, 1.0, 200.0, Some(76.0), false),
            (1, 0.0, 50.0, Some(76.0), false),
            (1, 0.0, 200.0, Some(52.0), false),
            (1, 0.0, 200.0, None, false),
        ] {
            let settings = DistractorSettings { reach: 4.5, step: 0.75, ..DistractorSettings::default() };
            let mut monitor = beside(false).with_distractors(Some(settings));
            let mut filter = parts(Toy::at(at)).filter.with_local_search(Some(LocalSearch::new(Default::default())));
            look(&mut Toy { colours, ..Toy::at(at) }, 1.0, |view| {
                let (mut belief, mut looks) = weighed(view, &[50.0; 10]);
                belief.states.iter_mut().for_each(|state| state.vx = speed);
                belief.expected = State { vx: speed, ..belief.states[0] };
                let streams = Streams::new(1, 0);
                let moved = filter.follow_colours(view, &mut belief, &mut looks, &mut monitor, (streams, t));
                assert_eq!(moved, follows, "frame {t}, speed {speed}, shape at {at}, colours at {colours:?}");
                for state in belief.states {
                    let near = (state.x - 76.0).abs() < 6.0 && (state.vx - (state.x - 50.0 + speed)).abs() < 1e-9;
                    assert!(if moved { near } else { state.x == 50.0 && state.vx == speed }, "{state:?}");
                }
            });
        }
    }

    /// Some particles restart at a better place; each keeps the weight of its own place.
    #[test]
    fn drawn_particles_are_weighed_where_they_are() {
        let mut monitor = beside(false);
        let shown = evidence(&mut monitor);
        monitor.judge(true, &shown, (false, 1));
        let mut filter = parts(Toy::at(70.0)).filter.with_local_search(Some(LocalSearch::new(Default::default())));
        let belief = look(&mut Toy::at(70.0), 1.0, |view| {
            let (mut belief, mut looks) = weighed(view, &[50.0; 10]);
            let when = (false, Streams::new(1, 0), 60);
            filter.search(view, &mut belief, &mut looks, &mut monitor, when, Distractors::default());
            belief
        });
        assert!(!belief.drawn.is_empty());
        for (i, particle) in belief.states.iter().enumerate() {
            let fit = (-SLOPE * (particle.x - 70.0).abs()).max(OFF);
            assert!((belief.log_weights[i] - belief.log_importance[i] - fit).abs() < 1e-9, "particle {i}");
        }
    }
}
