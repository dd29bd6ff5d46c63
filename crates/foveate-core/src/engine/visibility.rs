//! The visibility of a target: other objects occlude a part of it, and two targets cannot be in one place.
//!
//! If the boxes of two targets overlap, a look at one may show the other. The association is joint and soft, as in the joint probabilistic
//! data association filter: a place belongs to a target in proportion to the density of the target's prediction there, among the
//! predictions of all overlapping targets. The part of a look that belongs to others counts as a look at any other place of the picture.
//! MacCormick and Blake (2000) call this the exclusion principle; Khan, Balch and Dellaert (2005) use it as a prior.

use crate::geometry::State;
use crate::reference::ReferenceLikelihood;

/// The predicted place of a target: a normal density, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Claim {
    pub centre: (f64, f64),
    pub variance: (f64, f64),
}

impl Claim {
    /// Returns the log density, up to a constant that all claims share.
    fn log_density(&self, state: &State) -> f64 {
        let axis = |off: f64, variance: f64| off * off / variance + variance.ln();
        -0.5 * (axis(state.x - self.centre.0, self.variance.0) + axis(state.y - self.centre.1, self.variance.1))
    }
}

/// Least visible fraction at which evidence is judged: the likelihood of a mostly occluded target is uninformative.
const LEAST_JUDGED: f64 = 0.5;
/// The same while another target overlaps: covering a tenth of the target costs more than a tenth of the evidence.
const LEAST_JUDGED_BESIDE: f64 = 0.9;
/// If the target's share of its expected place is smaller than this, another target may be visible there.
const OWN_PLACE: f64 = 0.8;

/// The visibility of a target in one frame: the visible fraction, and the places that other targets claim.
#[derive(Clone, Debug)]
pub(super) struct Visibility {
    /// Fraction of the target that is not occluded, 0 to 1.
    fraction: f64,
    own: Claim,
    others: Vec<Claim>,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { fraction: 1.0, own: Claim::default(), others: vec![] }
    }
}

impl Visibility {
    /// Sets the visible fraction; a value that is not finite counts as 1.
    pub(super) fn set_fraction(&mut self, fraction: f64) {
        self.fraction = if fraction.is_finite() { fraction.clamp(0.0, 1.0) } else { 1.0 };
    }

    /// Returns the visible fraction, 0 to 1.
    pub(super) fn fraction(&self) -> f64 {
        self.fraction
    }

    /// Returns whether the visible fraction of the target is large enough to judge whether it is lost.
    pub(super) fn is_judged(&self, expected: &State) -> bool {
        let least = if self.meets_another() { LEAST_JUDGED_BESIDE } else { LEAST_JUDGED };
        self.fraction >= least && !self.is_contested(expected)
    }

    /// Returns whether another target may be visible at the place where this one is expected.
    pub(super) fn is_contested(&self, expected: &State) -> bool {
        self.share(expected) < OWN_PLACE
    }

    /// Returns whether another target claims places where this one may be.
    pub(super) fn meets_another(&self) -> bool {
        !self.others.is_empty()
    }

    /// Starts a frame with the claim of this target.
    pub(super) fn begin(&mut self, own: Claim) {
        self.own = own;
        self.others.clear();
    }

    /// Adds another target's claim.
    pub(super) fn add(&mut self, other: Claim) {
        self.others.push(other);
    }

    /// Returns this target's share of a place, 0 to 1.
    pub(super) fn share(&self, state: &State) -> f64 {
        if !self.meets_another() {
            return 1.0;
        }
        let own = self.own.log_density(state);
        1.0 / (1.0 + self.others.iter().map(|other| (other.log_density(state) - own).exp()).sum::<f64>())
    }

    /// Reduces each log-likelihood to the part of it that belongs to this target and is visible.
    // Deviation: the paper has no second target. Occlusion reduces the weight of a target's log-likelihood in proportion.
    pub(super) fn apply(&self, states: &[State], log_likelihood: &mut [f64], reference: ReferenceLikelihood) {
        if self.meets_another() {
            for (l, state) in log_likelihood.iter_mut().zip(states) {
                *l = reference.off + self.share(state) * (*l - reference.off);
            }
        }
        if self.fraction < 1.0 {
            log_likelihood.iter_mut().for_each(|l| *l *= self.fraction);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(x: f64, sd: f64) -> Claim {
        Claim { centre: (x, 10.0), variance: (sd * sd, 4.0) }
    }

    fn at(x: f64) -> State {
        State { x, y: 12.0, ..State::default() }
    }

    fn met(own: Claim, others: &[Claim]) -> Visibility {
        Visibility { fraction: 1.0, own, others: others.to_vec() }
    }

    /// Against Bayes' rule with the densities written out.
    #[test]
    fn a_place_is_shared_by_the_densities_there() {
        let density = |c: &Claim, s: &State| {
            let axis = |x: f64, v: f64| (-x * x / (2.0 * v)).exp() / (std::f64::consts::TAU * v).sqrt();
            axis(s.x - c.centre.0, c.variance.0) * axis(s.y - c.centre.1, c.variance.1)
        };
        let beside = Claim { centre: (-3.0, 17.0), variance: (16.0, 9.0) };
        let (own, others) = (claim(0.0, 2.0), [claim(5.0, 1.0), beside]);
        for x in [-8.0, -1.0, 0.0, 2.5, 5.0, 9.0] {
            let p = density(&own, &at(x));
            let wanted = p / (p + others.iter().map(|c| density(c, &at(x))).sum::<f64>());
            assert!((met(own, &others).share(&at(x)) - wanted).abs() < 1e-12, "{x}");
        }
        assert_eq!(met(own, &[own]).share(&at(3.0)), 0.5, "two in one place have half of it each");
    }

    #[test]
    fn a_place_of_another_target_counts_as_any_other_place() {
        let reference = ReferenceLikelihood { on: -2.0, off: -12.0 };
        let (states, mut looks) = ([at(0.0), at(40.0), at(20.0)], [-2.0, -2.0, -2.0]);
        met(claim(0.0, 2.0), &[claim(40.0, 2.0)]).apply(&states, &mut looks, reference);
        assert_eq!(looks, [-2.0, -12.0, -7.0]);
        let mut alone = [-2.5, -30.0, f64::NEG_INFINITY];
        met(claim(0.0, 2.0), &[]).apply(&states, &mut alone, reference);
        assert_eq!(alone, [-2.5, -30.0, f64::NEG_INFINITY], "not a bit without another target");
    }

    /// Half of the target gives half of the evidence.
    #[test]
    fn the_visible_fraction_scales_the_evidence() {
        let mut visibility = Visibility::default();
        visibility.set_fraction(0.5);
        let mut looks = [-2.0, -12.0];
        visibility.apply(&[at(0.0), at(1.0)], &mut looks, ReferenceLikelihood { on: 0.0, off: -12.0 });
        assert_eq!(looks, [-1.0, -6.0]);
    }
}
