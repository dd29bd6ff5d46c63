//! The covariance of the reported place.
//!
//! Deviation: the particles agree too soon, so their covariance alone underestimates the error of the box.

use serde::{Deserialize, Serialize};

use crate::geometry::Covariance;

/// The inputs of the error of the reported place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlaceEvidence {
    /// Covariance of the belief over x and y, px²: xx, xy, yy.
    pub belief: [f64; 3],
    /// Expected errors of the box regression, right and down, px; 0 without one.
    pub errors: [f64; 2],
    /// Effective sample size, 1 to N; 0 if the box was given.
    pub ess: f64,
    /// Pixels per template unit.
    pub unit: f64,
    /// Displacement of the target since the last frame, right and down, px, without the camera's motion as far as particles follow it; 0 if
    /// the box was given.
    pub moved: [f64; 2],
}

foveate_base::settings! {
    /// How the covariance of the reported place follows from [`PlaceEvidence`]: g (`belief` · Σ + `borders` · diag(e²) + `pixels`² I) +
    /// (`lone` · unit)² / ESS³ I + `speed`² m mᵀ, with the belief's covariance Σ, the expected errors e of the box regression and the
    /// displacement m since the last frame: how far the target moved while the picture was exposed, and so its blur, is unknown.
    /// g is 1, or with `sharp` above 0: r¹² / (r¹² + `sharp`¹²) for the root mean square r of e over the mean half side. True boxes of real
    /// video are inexact, and those of such sharp targets are not.
    #[derive(Copy)]
    pub struct Localisation in "confidence.localisation" {
        /// Factor of the covariance of the particles' positions, 0 to 100.
        pub belief: f64 = 1.0; 0.0 to 100.0,
        /// Factor of the variance of position that the box regression estimates, 0 to 100.
        pub borders: f64 = 1.0; 0.0 to 100.0,
        /// Standard deviation of the rounding of true boxes to whole pixels, px, 0 to 100.
        pub pixels: f64 = 0.0; 0.0 to 100.0,
        /// Standard deviation at an effective sample size of 1, template units, 0 to 10. At size n it is divided by n to the 1.5.
        pub lone: f64 = 0.0; 0.0 to 10.0,
        /// If the box regression estimates a smaller error than this, half boxes, `belief`, `borders` and `pixels` count less; 0 is off, 0 to 1.
        pub sharp: f64 = 0.0; 0.0 to 1.0,
        /// Standard deviation along the motion, as a share of the displacement since the last frame, 0 to 1.
        pub speed: f64 = 0.0; 0.0 to 1.0,
    }
}

impl Localisation {
    /// Returns the share of the belief's covariance that counts, and the covariance to add over x and y, px²: xx, xy, yy. `noise` is the
    /// standard deviation that every place has, template units.
    fn parts(&self, noise: f64, evidence: &PlaceEvidence) -> (f64, [f64; 3]) {
        let PlaceEvidence { errors, ess, unit, moved, .. } = *evidence;
        let squares = errors.map(|e| e * e);
        let mean = 0.5 * (squares[0] + squares[1]) / (unit * unit).max(1e-12);
        let clear = match self.sharp {
            sharp if sharp > 0.0 && mean > 0.0 => (1.0 + (sharp * sharp / mean).powi(6)).recip(),
            _ => 1.0,
        };
        let lone = (self.lone * unit).powi(2) / ess.max(1.0).powi(3);
        let common = clear * self.pixels * self.pixels + lone + (noise * unit).powi(2);
        let ([right, down], [dx, dy]) = (squares, moved.map(|moved| self.speed * moved));
        let borders = clear * self.borders;
        (clear * self.belief, [borders * right + common + dx * dx, dx * dy, borders * down + common + dy * dy])
    }

    /// Returns the covariance of the reported place over x and y, px²: xx, xy, yy.
    pub fn place(&self, noise: f64, evidence: &PlaceEvidence) -> [f64; 3] {
        let (share, more) = self.parts(noise, evidence);
        let [xx, xy, yy] = evidence.belief;
        [share * xx + more[0], share * xy + more[1], share * yy + more[2]]
    }

    /// Puts the covariance of the reported place into `covariance`, which has that of the belief. Correlations of the belief with its place
    /// keep their size relative to the belief's part, so the matrix stays positive semidefinite.
    pub fn apply(&self, noise: f64, evidence: &PlaceEvidence, covariance: &mut Covariance) {
        let (share, more) = self.parts(noise, evidence);
        let ratio = share.sqrt();
        for k in 0..2 {
            covariance.iter_mut().for_each(|row| row[k] *= ratio);
            covariance[k].iter_mut().for_each(|x| *x *= ratio);
        }
        let [xx, xy, yy] = more;
        for (i, j, more) in [(0, 0, xx), (0, 1, xy), (1, 0, xy), (1, 1, yy)] {
            covariance[i][j] += more;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVIDENCE: PlaceEvidence =
        PlaceEvidence { belief: [4.0, 1.0, 9.0], errors: [2.0, 3.0], ess: 4.0, unit: 10.0, moved: [0.0; 2] };

    #[test]
    fn by_default_the_errors_add_to_the_belief() {
        let it = Localisation::default();
        assert_eq!(it.place(0.0, &EVIDENCE), [8.0, 1.0, 18.0]);
        assert_eq!(it.place(0.1, &EVIDENCE), [9.0, 1.0, 19.0], "a tenth of ten pixels");
    }

    /// The formula by hand: r² = (0.04 + 0.09) / 2, g = r¹² / (r¹² + 0.2¹²).
    #[test]
    fn each_part_counts_as_documented() {
        let it = Localisation { belief: 0.5, borders: 2.0, pixels: 0.3, lone: 0.8, sharp: 0.2, speed: 0.0 };
        let g = 0.065f64.powi(6) / (0.065f64.powi(6) + 0.04f64.powi(6));
        let common = g * 0.09 + 64.0 / 64.0;
        let want = [g * (2.0 + 8.0) + common, g * 0.5, g * (4.5 + 18.0) + common];
        for (got, want) in it.place(0.0, &EVIDENCE).into_iter().zip(want) {
            assert!((got - want).abs() < 1e-12, "{got} {want}");
        }
        let without = PlaceEvidence { errors: [0.0; 2], ..EVIDENCE };
        assert_eq!(
            Localisation { lone: 0.0, pixels: 0.0, ..it }.place(0.0, &without),
            [2.0, 0.5, 4.5],
            "no box regression"
        );
        let one = Localisation { lone: 0.3, ..Localisation::default() };
        let collapsed =
            PlaceEvidence { belief: [1e-9, 0.0, 1e-9], errors: [0.0; 2], ess: 1.0, unit: 13.0, moved: [0.0; 2] };
        assert!(one.place(0.0, &collapsed)[0].sqrt() > 3.8, "a sample of one particle is no certainty");
    }

    /// A target that moves 50 pixels a frame, 3 right for 4 up, has an unknown place along its motion and no other.
    #[test]
    fn a_fast_target_is_uncertain_along_its_motion() {
        let moved = PlaceEvidence { moved: [30.0, -40.0], ..EVIDENCE };
        let [still, fast] =
            [0.0, 0.04].map(|speed| Localisation { speed, ..Localisation::default() }.place(0.0, &moved));
        let more: [f64; 3] = std::array::from_fn(|k| fast[k] - still[k]);
        let along = |x: f64, y: f64| more[0] * x * x + 2.0 * more[1] * x * y + more[2] * y * y;
        assert!((along(0.6, -0.8) - 4.0).abs() < 1e-9 && along(0.8, 0.6).abs() < 1e-9, "{more:?}");
        assert_eq!(Localisation { speed: 0.04, ..Localisation::default() }.place(0.0, &EVIDENCE), still, "at rest");
    }

    /// The whole matrix has the covariance of the place, and stays a covariance: its determinants of every leading block are positive.
    #[test]
    fn the_matrix_stays_positive_definite() {
        let mut covariance = Covariance::default();
        // A vector and its multiples, of rank 1, plus a little.
        let v = [2.0, 3.0, 1.0, -1.0, 0.5, 0.2, 0.1];
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, x) in row.iter_mut().enumerate() {
                *x = v[i] * v[j] + if i == j { 1e-3 } else { 0.0 };
            }
        }
        let evidence = PlaceEvidence { belief: [covariance[0][0], covariance[0][1], covariance[1][1]], ..EVIDENCE };
        let it = Localisation { belief: 0.3, borders: 0.0, pixels: 0.01, lone: 0.0, sharp: 0.5, speed: 0.05 };
        let evidence = PlaceEvidence { moved: [-20.0, 30.0], ..evidence };
        let ([xx, xy, yy], before) = (it.place(0.0, &evidence), covariance);
        it.apply(0.0, &evidence, &mut covariance);
        for (got, want) in
            [(covariance[0][0], xx), (covariance[0][1], xy), (covariance[1][0], xy), (covariance[1][1], yy)]
        {
            assert!((got - want).abs() < 1e-12, "{got} {want}");
        }
        assert_eq!(covariance[3][4], before[3][4], "the rest is that of the belief");
        // Gaussian elimination: all pivots of a positive definite matrix are positive.
        for k in 0..7 {
            assert!(covariance[k][k] > 0.0, "pivot {k}: {}", covariance[k][k]);
            for i in k + 1..7 {
                let factor = covariance[i][k] / covariance[k][k];
                let pivot = covariance[k];
                covariance[i].iter_mut().zip(pivot).skip(k).for_each(|(entry, above)| *entry -= factor * above);
            }
        }
    }
}
