//! q = (1 − α) p + α · mean over detections: some particles start at detections.
//!
//! The paper's "mixture proposal" of detections and transition prior (section 6.3), after the boosted particle filter of
//! Okuma et al. (2004). With p the dynamics and d a detection,
//! ```text
//! q(x | x', d₁..ₖ) = (1 − α) p(x | x') + α/k Σ q_d(x | x')
//! q_d(x | x') = N(place; centre of d, spread) · N(log_scale; that of d's box, size) · p(the rest | x', place)
//! ```
//! The rest is angle and aspect, the velocity given the place, and the scale where `size` is not given. It is p's own, so it drops
//! out of p/q, whose logarithm comes from place and scale alone and is never above −log(1 − α), for every child, whichever
//! part it came from.
//!
//! With `update = "kalman"` a detection is a measurement of the parent's child instead: q_d(x | x') = p(x | x', d), the posterior of place and scale
//! where d was measured with the deviations `spread` and `size`. That is the proposal of the unscented particle filter (van der Merwe,
//! Doucet, de Freitas & Wan 2000; section 5.1 of the paper): dynamics and measurement (centre and logarithm of size) are linear with normal
//! noises here, so that the unscented transform is exact, and the Kalman filter. Where detections are precise beside the motion it is
//! nearly the same; if they are not, its children lie between the parent's prediction and the detection.
//!
//! Only detections within `gate` of the predicted position count, with equal weight: scores of different detectors
//! have no common unit, and the likelihood decides between them. A parent without detections uses p alone.
//!
//! Clamping to the frame moves children after they are drawn and weighed. What moves x ~ q and x ~ p by the same rule keeps the
//! weights p/q, so that the piles at the edge of the frame are p's too and need no density.

use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::detection_density::Density;
use super::proposal::confine;
use super::{Autoregressive, CHUNK, Leap, Prior, Proposal};
use crate::geometry::State;
use crate::scene::{Detection, Scene};
use foveate_base::Result;
use foveate_base::error::within;
use foveate_base::rng::{Rng, Streams};

foveate_base::settings! {
    /// How detections are mixed with the prior. Lengths are template units at the parent's size: 1 is half the box.
    #[derive(Copy)]
    pub struct Mixing in "proposal" and rules {
        /// α, the share of particles that start at a detection, 0 to 0.99.
        pub alpha: f64 = 0.25; 0.0 to 0.99,
        /// Standard deviation of their positions about the detection's centre, template units, 0.01 to 10.
        pub spread: f64 = 0.3; 0.01 to 10.0,
        /// Standard deviation of their log scale about that of the detection, 0.001 to 5. Without it the detection's size is ignored.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub size: Option<f64> = None,
        /// Largest distance of a detection from a particle's predicted position, template units, 0 to 1000.
        pub gate: f64 = 4.0; 0.0 to 1000.0,
        /// How a detection changes the prediction of a particle.
        #[serde(skip_serializing_if = "Update::is_replace")]
        pub update: Update = Update::Replace,
    }
}

/// How a detection changes the prediction of a particle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Update {
    /// The detection replaces the prediction.
    #[default]
    Replace,
    /// The detection is a measurement. The particle is drawn from the posterior.
    Kalman,
}

impl Update {
    fn is_replace(&self) -> bool {
        *self == Self::Replace
    }
}

impl Mixing {
    fn rules(&self) -> Result<()> {
        within("proposal.size", self.size.unwrap_or(1.0), 0.001, 5.0)
    }
}

/// The mixture. It needs more of the dynamics than draws: the law of the place alone, and of the velocity given the place.
/// Both are normal laws: dynamics of heavy tails have none, and a configuration with both is refused.
#[derive(Clone, Debug)]
pub struct Mixture {
    mixing: Mixing,
    given: Autoregressive,
    motion: Autoregressive,
    prior: Prior,
    clamp_to_frame: bool,
    unit: f64,
    /// Centres and log scales of the detections of this frame.
    found: Vec<[f64; 3]>,
    /// The densities of those near a particle.
    near: Vec<Density>,
}

/// Name of the streams that choose the particles at detections, distinct from those of the prior's draws.
const CHOICE: u64 = 1 << 32;

impl Mixture {
    /// Mixes detections with these dynamics; their lengths are pixels until `size` is called.
    pub fn new(motion: Autoregressive, mixing: Mixing) -> Self {
        let prior = Prior::new(Arc::new(motion));
        Self { mixing, given: motion, motion, prior, clamp_to_frame: false, unit: 1.0, found: vec![], near: vec![] }
    }
    /// As [`Prior::clamp_to_frame`].
    pub fn clamp_to_frame(self, clamp_to_frame: bool) -> Self {
        Self { clamp_to_frame, ..self }
    }
}

impl Proposal for Mixture {
    fn size(&mut self, unit: f64) {
        (self.unit, self.motion) = (unit, self.given.scaled(unit));
        self.prior.size(unit);
    }

    fn over(&self, frames: usize) -> Option<Leap> {
        if self.clamp_to_frame { None } else { self.prior.over(frames) }
    }

    fn moments(&self, frames: usize) -> Option<Leap> {
        self.prior.moments(frames)
    }

    fn propose(
        &mut self,
        scene: Scene<'_>,
        parents: &[State],
        children: &mut [State],
        log_ratio: &mut [f64],
        streams: Streams,
    ) {
        self.prior.propose(scene, parents, children, log_ratio, streams);
        // A place without noise of its own has no density to mix with.
        let moves = self.motion.velocity > 0.0 || self.motion.position > 0.0;
        if moves && !scene.detections.is_empty() {
            self.found.clear();
            self.found.extend(scene.detections.iter().filter(|d| d.bbox.is_sane()).map(
                |Detection { bbox: b, .. }| {
                    let (x, y) = b.centre();
                    [x, y, 0.5 * (b.w * b.h).ln() - (2.0 * self.unit).ln()]
                },
            ));
            let (found, mut near) = (std::mem::take(&mut self.found), std::mem::take(&mut self.near));
            let chunks = parents.chunks(CHUNK).zip(children.chunks_mut(CHUNK)).zip(log_ratio.chunks_mut(CHUNK));
            for (i, ((parents, children), log_ratio)) in (CHOICE..).zip(chunks) {
                let mut rng = streams.rng(i);
                for ((parent, child), log_ratio) in parents.iter().zip(children).zip(log_ratio) {
                    *log_ratio = self.mix(&found, &mut near, parent, child, &mut rng);
                }
            }
            (self.found, self.near) = (found, near);
        }
        if self.clamp_to_frame {
            confine(children, scene.image);
        }
    }
}

impl Mixture {
    /// Moves `child`, a draw from p, to a detection with probability α. Returns log p/q of the result.
    fn mix(
        &self,
        found: &[[f64; 3]],
        near: &mut Vec<Density>,
        parent: &State,
        child: &mut State,
        rng: &mut Rng,
    ) -> f64 {
        let (m, Mixing { alpha, spread, size, gate, update }) = (&self.motion, self.mixing);
        let size = size.filter(|_| m.log_scale > 0.0).unwrap_or(0.0);
        let unit = self.unit * parent.log_scale.exp();
        let drift = [m.damping * parent.vx, m.damping * parent.vy];
        let mean = [parent.x + drift[0], parent.y + drift[1], m.scale_pull * parent.log_scale];
        let (far, reach) = (|[x, y, _]: [f64; 3]| (x - mean[0]).powi(2) + (y - mean[1]).powi(2), gate * unit);
        near.clear();
        if found.iter().all(|at| far(*at) > reach * reach) {
            return 0.0;
        }
        let variance = m.velocity * m.velocity + m.position * m.position;
        let p = Density::new(mean, variance.sqrt(), if size > 0.0 { m.log_scale } else { 0.0 });
        // How far a detection draws the mean from the parent's, and what deviation is left.
        let (pull, start) = match update {
            Update::Replace => ([1.0; 2], Density::new([0.0; 3], spread * unit, size)),
            Update::Kalman => {
                let ([place, by_place], [scale, by_size]) =
                    (posterior(variance.sqrt(), spread * unit), posterior(m.log_scale, size));
                ([by_place, by_size], Density::new([0.0; 3], place, if size > 0.0 { scale } else { 0.0 }))
            }
        };
        near.extend(found.iter().filter(|at| far(**at) <= reach * reach).map(|at| {
            let toward = |k: usize, pull: f64| mean[k] + pull * (at[k] - mean[k]);
            Density { mean: [toward(0, pull[0]), toward(1, pull[0]), toward(2, pull[1])], ..start }
        }));
        if rng.random::<f64>() < alpha {
            let d = near[rng.random_range(0..near.len())];
            let mut normal = || rng.sample::<f64, _>(StandardNormal);
            (child.x, child.y) = (d.mean[0] + d.place * normal(), d.mean[1] + d.place * normal());
            // p(velocity | place): Gaussian, with as much of the innovation as the velocity's noise has of both noises.
            let gain = m.velocity * m.velocity / variance;
            let left = m.velocity * m.position / variance.sqrt();
            child.vx = drift[0] + gain * (child.x - mean[0]) + left * normal();
            child.vy = drift[1] + gain * (child.y - mean[1]) + left * normal();
            if size > 0.0 {
                child.log_scale = d.mean[2] + d.size * normal();
            }
        }
        let log_p = p.log_density(child);
        let top = near.iter().map(|d| d.log_density(child)).fold(log_p, f64::max);
        let detected: f64 = near.iter().map(|d| (d.log_density(child) - top).exp()).sum();
        log_p - top - ((1.0 - alpha) * (log_p - top).exp() + alpha * detected / near.len() as f64).ln()
    }
}

/// Of a normal law of deviation `prior`, measured with deviation `noise`: the deviation left, and Kalman's gain.
fn posterior(prior: f64, noise: f64) -> [f64; 2] {
    let gain = prior * prior / (prior * prior + noise * noise);
    [(1.0 - gain).sqrt() * prior, gain]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::conformance::blank_image;
    use crate::control::dynamics::tests::ALL;
    use crate::control::{Belief, Dynamics, normalize};
    use crate::geometry::BBox;
    use foveate_base::rng::Purpose;

    const MOTION: Autoregressive = Autoregressive { log_scale: 0.05, tail_scale: 1.0, ..ALL };
    const FROM: State = State { x: 10.0, y: 20.0, vx: 2.0, vy: 1.0, log_scale: 0.2, angle: 0.5, log_aspect: -0.3 };
    const MIXING: Mixing = Mixing { alpha: 0.4, spread: 0.5, size: Some(0.1), gate: 6.0, update: Update::Replace };

    fn detection(x: f64, y: f64, side: f64) -> Detection {
        Detection::new(BBox::around(x, y, side, side), 1.0)
    }

    /// One at the prediction (11.8, 20.9), one three deviations off, one beyond the gate, and one without an area.
    fn detections() -> [Detection; 4] {
        [detection(12.5, 20.0, 2.5), detection(14.0, 22.0, 2.0), detection(30.0, 20.0, 2.0), detection(12.0, 20.0, 0.0)]
    }

    #[test]
    fn it_keeps_the_law() {
        let (frame, found) = (blank_image(), detections());
        let scene = Scene { image: &frame, detections: &found };
        for motion in [
            MOTION,
            Autoregressive { position: 0.0, ..MOTION },
            Autoregressive { velocity: 0.0, angle: 0.0, ..MOTION },
            Autoregressive { log_scale: 0.0, ..MOTION },
            Autoregressive { velocity: 0.0, position: 0.0, ..MOTION },
        ] {
            let kalman = Mixing { update: Update::Kalman, ..MIXING };
            for mixing in [
                MIXING,
                Mixing { size: None, ..MIXING },
                Mixing { alpha: 0.9, spread: 2.0, ..MIXING },
                kalman,
                Mixing { size: None, ..kalman },
                Mixing { alpha: 0.9, spread: 2.0, ..kalman },
            ] {
                conformance::proposal(&mut Mixture::new(motion, mixing), scene, &FROM);
                let p = &mut Prior::new(Arc::new(motion));
                conformance::proposal_weights(&mut Mixture::new(motion, mixing), p, scene, &FROM);
            }
        }
    }

    /// The frame of one pixel makes all children pile up at its edge; p's do so with the same weights.
    #[test]
    fn clamping_keeps_the_weights() {
        let (frame, found) = (blank_image(), [detection(0.5, 0.0, 2.0), detection(-1.0, 0.3, 2.0)]);
        let (scene, parent) =
            (Scene { image: &frame, detections: &found }, State { x: 0.0, y: 0.0, ..State::default() });
        let p = &mut Prior::new(Arc::new(MOTION)).clamp_to_frame(true);
        conformance::proposal_weights(&mut Mixture::new(MOTION, MIXING).clamp_to_frame(true), p, scene, &parent);
    }

    #[test]
    #[should_panic(expected = "weighted children")]
    fn the_law_finds_children_that_pay_nothing() {
        struct Free(Mixture);
        impl Proposal for Free {
            fn size(&mut self, _: f64) {}
            fn propose(
                &mut self,
                scene: Scene<'_>,
                parents: &[State],
                children: &mut [State],
                owed: &mut [f64],
                s: Streams,
            ) {
                self.0.propose(scene, parents, children, owed, s);
                owed.fill(0.0);
            }
        }
        let (frame, found) = (blank_image(), detections());
        let scene = Scene { image: &frame, detections: &found };
        let p = &mut Prior::new(Arc::new(MOTION));
        conformance::proposal_weights(&mut Free(Mixture::new(MOTION, MIXING)), p, scene, &FROM);
    }

    /// Where all children start at one detection, they have the mean and covariance of a Kalman filter of (place, velocity) along each axis,
    /// and of the scale; means of 65,536 draws, within five standard errors.
    #[test]
    fn a_measured_child_comes_from_the_kalman_posterior() {
        let motion = Autoregressive { angle: 0.0, ..MOTION };
        let mixing = Mixing { alpha: 0.99, spread: 0.7, size: Some(0.08), gate: 100.0, update: Update::Kalman };
        let found = [detection(13.0, 19.0, 2.6)];
        let (children, log_ratio) = draw(&mut Mixture::new(motion, mixing), &found, 1 << 16, 5);
        let spread = 0.7 * FROM.log_scale.exp();
        let (v, p) = (motion.velocity * motion.velocity, motion.position * motion.position);
        // Prior of (place, velocity): place' = place + velocity' + noise.
        let prior = [[v + p, v], [v, v]];
        let gain = [prior[0][0], prior[1][0]].map(|c| c / (prior[0][0] + spread * spread));
        let expected = |place: f64, speed: f64, z: f64| {
            let (speed, place) = (motion.damping * speed, place + motion.damping * speed);
            [place + gain[0] * (z - place), speed + gain[1] * (z - place)]
        };
        // All but one in a hundred are of the posterior: those of p differ by their weight.
        let posterior: Vec<&State> =
            children.iter().zip(&log_ratio).filter(|(_, r)| r.is_finite()).map(|(c, _)| c).collect();
        let n = posterior.len() as f64;
        let mean = |of: &dyn Fn(&State) -> f64| posterior.iter().map(|c| of(c)).sum::<f64>() / n;
        let near = |what: &str, found: f64, kalman: f64, prior: f64, deviation: f64| {
            let expected = 0.99 * kalman + 0.01 * prior;
            let allowed = 5.0 * deviation / n.sqrt() + 1e-9;
            assert!((found - expected).abs() < allowed, "{what}: {found}, not {expected} +- {allowed}");
        };
        let ([x, vx], [y, vy]) = (expected(FROM.x, FROM.vx, 13.0), expected(FROM.y, FROM.vy, 19.0));
        let led = [FROM.x + motion.damping * FROM.vx, FROM.y + motion.damping * FROM.vy];
        let wide = prior[0][0].sqrt() + 3.0;
        near("x", mean(&|c| c.x), x, led[0], wide);
        near("y", mean(&|c| c.y), y, led[1], wide);
        near("vx", mean(&|c| c.vx), vx, motion.damping * FROM.vx, wide);
        near("vy", mean(&|c| c.vy), vy, motion.damping * FROM.vy, wide);
        let by_size = motion.log_scale.powi(2) / (motion.log_scale.powi(2) + 0.08 * 0.08);
        let (led, measured) = (motion.scale_pull * FROM.log_scale, (2.6f64 / 2.0).ln());
        near("log scale", mean(&|c| c.log_scale), led + by_size * (measured - led), led, 0.2);
        // The variance left.
        let left = prior[0][0] * (1.0 - gain[0]);
        let off = mean(&|c| (c.x - x).powi(2).min(25.0 * left));
        assert!((off / left - 1.0).abs() < 0.2, "variance of x: {off}, not {left}");
    }

    fn draw(proposal: &mut dyn Proposal, found: &[Detection], n: usize, seed: u64) -> (Vec<State>, Vec<f64>) {
        let (frame, mut children, mut log_ratio) = (blank_image(), vec![State::default(); n], vec![f64::NAN; n]);
        let scene = Scene { image: &frame, detections: found };
        let streams = Streams::new(seed, 0).at(1, Purpose::Predict);
        proposal.propose(scene, &vec![FROM; n], &mut children, &mut log_ratio, streams);
        (children, log_ratio)
    }

    #[test]
    fn without_detections_it_is_the_prior_bit_for_bit() {
        let mut prior = Prior::new(Arc::new(MOTION));
        prior.size(3.0);
        for (mixing, found) in [
            (MIXING, vec![]),
            (MIXING, vec![detection(60.0, 60.0, 2.0), detection(f64::NAN, 20.0, 2.0), detection(12.0, 20.0, f64::NAN)]),
        ] {
            let mut mixture = Mixture::new(MOTION, mixing);
            mixture.size(3.0);
            assert!(draw(&mut mixture, &found, 200, 1) == draw(&mut prior, &found, 200, 1));
        }
        for clamp_to_frame in [false, true] {
            let mut prior = Prior::new(Arc::new(MOTION)).clamp_to_frame(clamp_to_frame);
            let mut mixture = Mixture::new(MOTION, MIXING).clamp_to_frame(clamp_to_frame);
            assert!(draw(&mut mixture, &[], 200, 1) == draw(&mut prior, &[], 200, 1));
        }
    }

    /// The whole of q written out: the joint density of seven components, the velocity given the place by its own formula.
    #[test]
    fn log_ratio_is_that_of_the_joint_densities() {
        let normal = |v: f64, mean: f64, variance: f64| {
            -0.5 * (v - mean).powi(2) / variance - 0.5 * (std::f64::consts::TAU * variance).ln()
        };
        let (vv, pp) = (MOTION.velocity.powi(2), MOTION.position.powi(2));
        let unit = FROM.log_scale.exp();
        let log_detected = |c: &State, d: &Detection| {
            let (x, y) = d.bbox.centre();
            let along = |place: f64, speed: f64, (from, drift): (f64, f64), centre: f64| {
                // Speed given place, by completing the square of N(speed; drift, vv) N(place; from + speed, pp).
                let variance = 1.0 / (1.0 / vv + 1.0 / pp);
                let mean = variance * (drift / vv + (place - from) / pp);
                normal(place, centre, (MIXING.spread * unit).powi(2)) + normal(speed, mean, variance)
            };
            along(c.x, c.vx, (FROM.x, MOTION.damping * FROM.vx), x)
                + along(c.y, c.vy, (FROM.y, MOTION.damping * FROM.vy), y)
                + normal(c.log_scale, (d.bbox.w / 2.0).ln(), 0.01)
                + normal(c.angle, FROM.angle, MOTION.angle.powi(2))
                + normal(c.log_aspect, MOTION.aspect_pull * FROM.log_aspect, MOTION.aspect.powi(2))
        };
        let found = detections();
        let (children, log_ratio) = draw(&mut Mixture::new(MOTION, MIXING), &found, 500, 2);
        for (child, log_ratio) in children.iter().zip(log_ratio) {
            let log_p = MOTION.log_density(child, &FROM);
            let detected = 0.5 * (log_detected(child, &found[0]).exp() + log_detected(child, &found[1]).exp());
            let exact = log_p - (0.6 * log_p.exp() + 0.4 * detected).ln();
            assert!((log_ratio - exact).abs() < 1e-9, "{log_ratio} is not {exact} at {child:?}");
            assert!(log_ratio <= -(0.6f64.ln()) + 1e-12, "no weight is above 1 / (1 - alpha)");
        }
    }

    /// One frame of a two-dimensional toy: posterior means of place and velocity by weighted children of p, of q, and by
    /// sums over a grid of 401 × 401. Estimates of 64 × 2,048 children lie within 5 standard errors (6 comparisons; a
    /// correct one fails less than once in 10⁵), and those of q are closer where the likelihood is far from p.
    #[test]
    fn posterior_means_are_the_grids() {
        let found = detections();
        let log_likelihood = |x: f64, y: f64| -0.5 * ((x - 14.2) / 0.5).powi(2) - 0.5 * ((y - 21.5) / 0.6).powi(2);
        let (sd, mean) = ((0.49f64 + 0.16).sqrt(), (FROM.x + 0.9 * FROM.vx, FROM.y + 0.9 * FROM.vy));
        let (mut sum, mut exact) = (0.0, [0.0; 3]);
        for k in 0..401 * 401 {
            let (x, y) = (9.0 + 0.02 * (k % 401) as f64, 18.0 + 0.02 * (k / 401) as f64);
            let log_p = -0.5 * ((x - mean.0) / sd).powi(2) - 0.5 * ((y - mean.1) / sd).powi(2);
            let w = (log_p + log_likelihood(x, y)).exp();
            let speed = 0.9 * FROM.vx + 0.49 / 0.65 * (x - mean.0); // E[velocity | place]
            sum += w;
            [x, y, speed].iter().zip(&mut exact).for_each(|(v, e)| *e += w * v);
        }
        let exact = exact.map(|e| e / sum);
        let mut errors = vec![];
        let filters: [Box<dyn Proposal>; 2] =
            [Box::new(Prior::new(Arc::new(MOTION))), Box::new(Mixture::new(MOTION, MIXING))];
        for mut proposal in filters {
            let mut runs = vec![];
            for seed in 0..64 {
                let (states, mut log_weights) = draw(&mut *proposal, &found, 2048, 100 + seed);
                let mut weights = vec![0.0; states.len()];
                states.iter().zip(&mut log_weights).for_each(|(s, w)| *w += log_likelihood(s.x, s.y));
                normalize(&log_weights, &mut weights);
                let got = Belief { states: &states, weights: &weights }.mean();
                runs.push([got.x, got.y, got.vx]);
            }
            for k in 0..3 {
                let n = runs.len() as f64;
                let got = runs.iter().map(|r| r[k]).sum::<f64>() / n;
                let error = (runs.iter().map(|r| (r[k] - got).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
                // The bias of self-normalised estimates, of order 1 / 2048, hides in the second term.
                let allowed = 5.0 * error + 0.002;
                assert!((got - exact[k]).abs() < allowed, "component {k}: {got} is not {} ± {allowed}", exact[k]);
                errors.push(error);
            }
        }
        assert!(errors[3] < 0.7 * errors[0], "detections make it surer: {errors:?}");
    }
}
