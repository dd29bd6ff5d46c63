//! Rivals: believed places of the target that are not where it is estimated to be.

use crate::geometry::{Extent, State};

/// How many there are at most.
const MOST: usize = 6;
/// How far from the estimate they are at least, and from each other, in boxes of the target (template units).
const APART: (f64, f64) = (0.7, 0.5);

/// Fills `rivals` with the most probable states away from the estimate and from each other, at most six.
pub fn rivals(states: &[State], log_weights: &[f64], estimate: &State, extent: Extent, rivals: &mut Vec<State>) {
    let scale = estimate.log_scale.exp();
    let far = |a: &State, b: &State, apart: f64| {
        let (u, v) = ((a.x - b.x) / (scale * extent.half_w), (a.y - b.y) / (scale * extent.half_h));
        u * u + v * v > apart * apart
    };
    rivals.clear();
    while rivals.len() < MOST {
        let candidates = states.iter().zip(log_weights).filter(|(state, log_weight)| {
            log_weight.is_finite()
                && far(state, estimate, APART.0)
                && rivals.iter().all(|rival| far(state, rival, APART.1))
        });
        match candidates.max_by(|a, b| a.1.total_cmp(b.1)) {
            Some((state, _)) => rivals.push(*state),
            None => break,
        }
    }
}
