//! Looks beyond the particles: all over the picture for a target that was lost, and around one that was not for what it
//! could be mistaken for.

use super::{Parts, Target, Work, company};
use crate::control::{Promise, REFINEMENTS, rivals};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::Appearance;
use crate::rng::Streams;
use crate::scene::Image;

/// Searches for what looks like the target did at `seen`, draws some of the predicted states again from the best places, and
/// looks at these, so that `w.log_prior` and `w.log_posterior` are those of all states again. Says whether any was drawn.
pub(super) fn search(
    parts: &mut Parts,
    (image, seen, target): (&Image, &State, &Target),
    (promise, visible): (Promise, f64),
    w: &mut Work,
    streams: Streams,
) -> bool {
    let Parts { search: Some(search), appearance, confidence, .. } = parts else { return false };
    let appearance = &mut **appearance;
    let places = search.places((image.width(), image.height()), seen, target.extent);
    appearance.see(image, places, &[Gaze::CENTRE]);
    score(appearance, places, Gaze::CENTRE, &mut w.search);
    for _ in 0..REFINEMENTS {
        score(appearance, search.refine(&w.search), Gaze::CENTRE, &mut w.search);
    }
    let least = promise.on - search.fit * (promise.on - promise.off);
    search.draw(&w.search, least, &mut w.predicted, &mut w.log_prior, &mut w.drawn, streams);
    confidence.searched(search.best());
    appearance.see(image, &w.predicted, w.plan.gazes());
    w.fresh.clear();
    w.fresh.extend(w.drawn.iter().map(|i| w.predicted[*i]));
    w.drawn.iter().for_each(|i| w.log_posterior[*i] = w.log_prior[*i]);
    let n = w.predicted.len();
    let gazes = w.plan.gazes().iter().zip(w.plan.weights()).enumerate();
    for (k, (gaze, weight)) in gazes.filter(|(_, (_, weight))| **weight > 0.0) {
        score(appearance, &w.fresh, *gaze, &mut w.search);
        company::shade(&mut w.search, visible);
        for (i, l) in w.drawn.iter().zip(&w.search) {
            w.log_likelihood[k * n + i] = *l;
            w.log_posterior[*i] += weight * l;
        }
    }
    !w.drawn.is_empty()
}

/// Fills `w.rivals` with the places around the estimate that look most like the target. The log-likelihood of the best;
/// `None` without `Parts::rivals`.
pub(super) fn around(
    parts: &mut Parts,
    (image, estimate, extent): (&Image, &State, Extent),
    w: &mut Work,
) -> Option<f64> {
    let Parts { rivals: Some(around), appearance, .. } = parts else { return None };
    let places = around.places((image.width(), image.height()), estimate, extent);
    // An estimate that has left the picture has nothing around it.
    if places.is_empty() {
        w.rivals.clear();
        return Some(f64::NEG_INFINITY);
    }
    appearance.see(image, places, &[Gaze::CENTRE]);
    score(&mut **appearance, places, Gaze::CENTRE, &mut w.search);
    Some(rivals(places, &w.search, estimate, extent, &mut w.rivals))
}

/// Scores the estimate in other shapes, and gives the target the next one.
pub(super) fn reshape(parts: &mut Parts, image: &Image, estimate: &State, target: &mut Target) {
    let Parts { aspect: Some(aspect), appearance, .. } = parts else { return };
    let scores = aspect.trials(target.extent).map(|extent| {
        let mut score = [0.0];
        appearance.reshape(extent);
        appearance.see(image, &[*estimate], &[Gaze::CENTRE]);
        appearance.log_likelihood(&[*estimate], Gaze::CENTRE, &mut score);
        score[0]
    });
    target.extent = aspect.learn(target.extent, scores);
    appearance.reshape(target.extent);
}

/// Log-likelihoods of states whose surroundings were seen, as many as there are states.
fn score(appearance: &mut dyn Appearance, states: &[State], gaze: Gaze, out: &mut Vec<f64>) {
    out.resize(states.len(), 0.0);
    appearance.log_likelihood(states, gaze, out);
}
