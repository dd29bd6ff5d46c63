//! The belief about a target that waits for its next look: a normal distribution in place of the particles.
//!
//! Without a look, the dynamics, the motion of the camera and the target's own detection are linear with normal noise, so a frame is a
//! Kalman filter's. Before the next look the particles are drawn from the distribution.
//!
//! Deviation: the paper draws every particle in every frame.

use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::control::{Belief, CameraMotion, DetectionLikelihood, Leap};
use crate::geometry::{Covariance, Extent, State};
use crate::scene::{Detection, Flow};
use foveate_base::rng::Rng;

/// Mean and covariance of a waiting target.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Waiting {
    pub mean: State,
    pub covariance: Covariance,
}

/// The places of x, y and log scale among the numbers of a state.
const MEASURED: [usize; 3] = [0, 1, 4];

impl Waiting {
    pub(super) fn of(belief: &Belief<'_>) -> Self {
        Self { mean: belief.mean(), covariance: belief.covariance() }
    }

    /// Returns whether its covariance is one, up to rounding: variances are not negative, none exceeds `most` squared, and no covariance exceeds
    /// those of its two numbers.
    pub(super) fn has_covariance(&self, most: f64) -> bool {
        let c = &self.covariance;
        let fits = |i: usize, j: usize| c[i][j] * c[i][j] <= c[i][i] * c[j][j] * (1.0 + 1e-6) + 1e-12;
        (0..State::N).all(|i| (-1e-12..=most * most).contains(&c[i][i]) && (0..State::N).all(|j| fits(i, j)))
    }

    /// Moves it with the camera.
    pub(super) fn shift(&mut self, camera_motion: &CameraMotion, flow: &Flow) {
        camera_motion.shift(flow, std::slice::from_mut(&mut self.mean));
    }

    /// Moves it by some frames of motion.
    pub(super) fn advance(&mut self, leap: &Leap) {
        leap.spread(&mut self.mean, &mut self.covariance);
    }

    /// Updates it by the target's detection, unless a false detection explains that one better.
    pub(super) fn measure(&mut self, detection: &Detection, likelihood: &DetectionLikelihood, extent: Extent) {
        let Some(measurement) = likelihood.measurements(std::slice::from_ref(detection), extent).next() else { return };
        let (mut mean, mut covariance, mut log_evidence) = (self.mean.to_array(), self.covariance, 0.0);
        // Their errors are independent: one after the other.
        for ((k, value), sd) in MEASURED.into_iter().zip(measurement.values).zip(measurement.sd) {
            let (off, row) = (value - mean[k], covariance[k]);
            let variance = row[k] + sd * sd;
            log_evidence += 0.5 * ((sd * sd / variance).ln() - off * off / variance);
            for i in 0..State::N {
                mean[i] += row[i] * off / variance;
                for j in 0..State::N {
                    covariance[i][j] -= row[i] * row[j] / variance;
                }
            }
        }
        if (1.0 - likelihood.outlier) * log_evidence.exp() >= likelihood.outlier {
            (self.mean, self.covariance) = (State::from_array(mean), covariance);
        }
    }

    /// Draws all particles.
    pub(super) fn draw(&self, particles: &mut [State], rng: &mut Rng) {
        let (mean, root) = (self.mean.to_array(), cholesky(&self.covariance));
        for particle in particles {
            let mut to = mean;
            for j in (0..State::N).filter(|j| root[*j][*j] > 0.0) {
                let normal: f64 = rng.sample(StandardNormal);
                (j..State::N).for_each(|i| to[i] += root[i][j] * normal);
            }
            *particle = State::from_array(to);
        }
    }
}

/// Returns the lower triangular L with L Lᵀ = C. What has no variance beside the numbers before it has a column of zeros.
fn cholesky(covariance: &Covariance) -> Covariance {
    let mut root = Covariance::default();
    for j in 0..State::N {
        let left =
            |root: &Covariance, i: usize| covariance[i][j] - (0..j).map(|k| root[i][k] * root[j][k]).sum::<f64>();
        let variance = left(&root, j);
        if variance > 1e-12 * covariance[j][j] {
            let deviation = variance.sqrt();
            for i in j..State::N {
                root[i][j] = left(&root, i) / deviation;
            }
        }
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Autoregressive, Dynamics};
    use crate::geometry::BBox;
    use foveate_base::rng::Streams;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };
    const FROM: State = State { x: 50.0, y: 60.0, vx: 2.0, vy: -1.0, log_scale: 0.1, angle: 0.0, log_aspect: 0.0 };

    fn waiting() -> Waiting {
        let mut covariance = Covariance::default();
        [4.0, 9.0, 0.5, 0.25, 0.01, 0.0, 0.04].into_iter().enumerate().for_each(|(k, v)| covariance[k][k] = v);
        (covariance[0][2], covariance[2][0]) = (1.0, 1.0);
        Waiting { mean: FROM, covariance }
    }

    fn of(states: &[State], weights: &[f64]) -> Waiting {
        Waiting::of(&Belief { states, weights })
    }

    /// Asserts that both agree within five standard errors of so many draws, of a probability below 1e-6 for each number; the seed is fixed.
    fn agree(drawn: &Waiting, exact: &Waiting, draws: f64) {
        let sd = |i: usize| exact.covariance[i][i].max(0.0).sqrt();
        for i in 0..State::N {
            let off = (drawn.mean.to_array()[i] - exact.mean.to_array()[i]).abs();
            assert!(off <= 5.0 * sd(i) / draws.sqrt() + 1e-9, "mean {i} is off by {off}");
            for j in 0..State::N {
                let off = (drawn.covariance[i][j] - exact.covariance[i][j]).abs();
                assert!(off <= 5.0 * sd(i) * sd(j) * (2.0 / draws).sqrt() + 1e-9, "({i}, {j}) is off by {off}");
            }
        }
    }

    /// A frame of motion and a detection, in closed form and by a particle filter of 400,000 particles.
    #[test]
    fn it_is_the_particle_filter() {
        const DRAWS: usize = 400_000;
        let motion = Autoregressive { velocity: 0.7, position: 0.4, log_scale: 0.05, ..Autoregressive::default() };
        let likelihood = DetectionLikelihood { place: 0.2, size: 0.1, outlier: 1e-9 };
        let detection = Detection::new(BBox::around(55.0, 57.0, 26.0, 50.0), 1.0);
        let (mut exact, mut rng) = (waiting(), Streams::new(5, 0).rng(0));
        let mut states = vec![State::default(); DRAWS];
        exact.draw(&mut states, &mut rng);
        agree(&of(&states, &vec![1.0 / DRAWS as f64; DRAWS]), &exact, DRAWS as f64);
        states.iter_mut().for_each(|state| *state = motion.sample(state, &mut rng));
        let mut weights: Vec<f64> =
            states.iter().map(|state| likelihood.log_likelihood(&[detection], state, EXTENT).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= sum);
        exact.advance(&motion.over(1).expect("normal"));
        exact.measure(&detection, &likelihood, EXTENT);
        let effective = Belief { states: &states, weights: &weights }.ess();
        agree(&of(&states, &weights), &exact, effective);
        assert!(exact.mean.x > 52.5 && exact.covariance[0][0] < 4.0 && exact.covariance[2][2] < 0.99, "{exact:?}");
    }

    /// A detection that is less likely than a false one changes nothing; nor does one without an area.
    #[test]
    fn false_detections_are_ignored() {
        let likelihood = DetectionLikelihood { place: 0.2, size: 0.1, outlier: 1e-3 };
        for (x, w, moves) in [(52.0, 22.0, true), (75.0, 22.0, false), (52.0, 0.0, false), (52.0, 100.0, false)] {
            let mut it = waiting();
            it.measure(&Detection::new(BBox::around(x, 60.0, w, 44.0), 1.0), &likelihood, EXTENT);
            assert_eq!(it.mean != FROM, moves, "at {x}, {w} wide");
        }
    }

    /// Of numbers that determine each other, one has noise.
    #[test]
    fn the_root_of_a_singular_covariance() {
        let mut covariance = waiting().covariance;
        (covariance[0][2], covariance[2][0], covariance[2][2]) = (1.0, 1.0, 0.25);
        let root = cholesky(&covariance);
        for (i, j) in (0..State::N * State::N).map(|k| (k / State::N, k % State::N)) {
            let product: f64 = (0..State::N).map(|k| root[i][k] * root[j][k]).sum();
            assert!((product - covariance[i][j]).abs() < 1e-12, "({i}, {j})");
        }
        assert_eq!((root[2][2], root[5][5]), (0.0, 0.0));
    }
}
