//! Rivals: places where the target is believed to be a little, and is not where it is estimated to be.
//!
//! What tells the target from them is worth learning (`identity/discriminant.rs`): they are the particles' own mistakes.

use crate::geometry::{Extent, State};

/// How many there are at most.
const MOST: usize = 6;
/// How far from the estimate they are at least, and from each other, template units.
const APART: (f64, f64) = (0.7, 0.5);

/// Fills `rivals` with the most probable states away from the estimate and from each other, at most six.
pub fn rivals(states: &[State], log_weights: &[f64], estimate: &State, extent: Extent, rivals: &mut Vec<State>) {
    let scale = estimate.log_scale.exp();
    let far = |a: &State, b: &State, apart: f64| {
        let (u, v) = ((a.x - b.x) / (scale * extent.half_w), (a.y - b.y) / (scale * extent.half_h));
        u * u + v * v > apart * apart
    };
    rivals.clear();
    rivals.reserve(MOST);
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

#[cfg(test)]
mod tests {
    use super::*;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    #[test]
    fn the_best_that_are_apart() {
        let at = |x: f64, y: f64| State { x, y, ..State::default() };
        let states =
            [at(0.0, 0.0), at(6.0, 0.0), at(8.0, 0.0), at(9.0, 0.0), at(0.0, 13.0), at(0.0, 16.0), at(50.0, 0.0)];
        let log_weights = [0.0, -1.0, -3.0, -2.0, -1.5, -4.0, f64::NEG_INFINITY];
        let mut found = vec![State::default()];
        rivals(&states, &log_weights, &State::default(), EXTENT, &mut found);
        assert_eq!(found, [at(9.0, 0.0), at(0.0, 16.0)], "0.6 and 0.65 units are near; -infinity is nobody");
        let many: Vec<State> = (1..20).map(|i| at(10.0 * f64::from(i), 0.0)).collect();
        rivals(&many, &[0.0; 19], &State::default(), EXTENT, &mut found);
        assert_eq!(found.len(), MOST);
        rivals(&many, &[f64::NAN; 19], &State::default(), EXTENT, &mut found);
        assert!(found.is_empty());
    }
}
