//! Looks beyond the particles: all over the picture for a target that was lost, and around one that was not for what it
//! could be mistaken for.

use super::{Parts, Target, Work, company};
use crate::control::{Promise, REFINEMENTS, rivals};
use crate::geometry::{Extent, Gaze, State};
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
    let places = search.places((image.width(), image.height()), seen, target.extent);
    w.search.resize(places.len(), 0.0);
    appearance.see(image, places, &[Gaze::CENTRE]);
    appearance.log_likelihood(places, Gaze::CENTRE, &mut w.search);
    for _ in 0..REFINEMENTS {
        let places = search.refine(&w.search);
        w.search.resize(places.len(), 0.0);
        appearance.log_likelihood(places, Gaze::CENTRE, &mut w.search);
    }
    let least = promise.on - search.fit * (promise.on - promise.off);
    search.draw(&w.search, least, &mut w.predicted, &mut w.log_prior, &mut w.drawn, streams);
    confidence.searched(search.best());
    appearance.see(image, &w.predicted, w.plan.gazes());
    w.fresh.clear();
    w.fresh.extend(w.drawn.iter().map(|i| w.predicted[*i]));
    w.drawn.iter().for_each(|i| w.log_posterior[*i] = w.log_prior[*i]);
    w.search.resize(w.fresh.len(), 0.0);
    let n = w.predicted.len();
    for (k, gaze) in w.plan.gazes().iter().enumerate().filter(|(k, _)| w.plan.used()[*k]) {
        appearance.log_likelihood(&w.fresh, *gaze, &mut w.search);
        company::shade(&mut w.search, visible);
        for (i, l) in w.drawn.iter().zip(&w.search) {
            w.log_likelihood[k * n + i] = *l;
            w.log_posterior[*i] += l;
        }
    }
    !w.drawn.is_empty()
}

/// Fills `w.rivals`, from what is around the estimate or, without `Parts::rivals`, from the particles. The log-likelihood of
/// the best of those around.
pub(super) fn beside(
    parts: &mut Parts,
    (image, estimate, extent): (&Image, &State, Extent),
    w: &mut Work,
) -> Option<f64> {
    let Parts { rivals: Some(around), appearance, .. } = parts else {
        if parts.appearance.adapts() {
            rivals(&w.predicted, &w.log_posterior, estimate, extent, &mut w.rivals);
        }
        return None;
    };
    let places = around.places((image.width(), image.height()), estimate, extent);
    w.search.resize(places.len(), 0.0);
    appearance.see(image, places, &[Gaze::CENTRE]);
    appearance.log_likelihood(places, Gaze::CENTRE, &mut w.search);
    Some(rivals(places, &w.search, estimate, extent, &mut w.rivals))
}
