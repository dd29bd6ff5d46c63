//! p(xₜ | xₜ₋₁): how the target is expected to move (section 3.1).

use super::leap::{Leap, Pace};
use crate::geometry::State;
use foveate_base::rng::Rng;
use foveate_kernels::Normals;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::sync::Arc;

// Deviation: the paper writes p(xₜ | xₜ₋₁, aₜ₋₁), but nothing in it lets the action move the target.
/// The transition density of one frame, which can be sampled.
///
/// `sample` must draw from the density that `log_density` evaluates, or importance weights are wrong and
/// `conformance::dynamics` fails. Both are called from many threads.
pub trait Dynamics: Send + Sync {
    /// One draw from p(· | previous), with randomness from `rng` alone.
    fn sample(&self, previous: &State, rng: &mut Rng) -> State;
    /// log p(next | previous) in nats, exact, with its constants.
    fn log_density(&self, next: &State, previous: &State) -> f64;
    /// The noise-free successor of a state.
    fn expected(&self, previous: &State) -> State;
    /// Standard deviation of a draw's place about that, along an axis.
    fn spread(&self) -> f64;
    /// The same motion for a target of which one template unit is `unit` pixels.
    fn sized(&self, unit: f64) -> Arc<dyn Dynamics>;
    /// The transition density of several frames, if it has a closed form. Otherwise a waiting target moves frame by
    /// frame.
    fn over(&self, _frames: usize) -> Option<Leap> {
        None
    }
    /// The normal density with the mean and covariance of several frames of motion; `None` without a closed form.
    fn moments(&self, frames: usize) -> Option<Leap> {
        self.over(frames)
    }
    /// One draw for each state, in one virtual call; not the bits that calls of `sample` give, but of the same law.
    /// The draws for fewer states are the first ones of those for more.
    fn sample_each(&self, previous: &[State], next: &mut [State], rng: &mut Rng) {
        for (next, previous) in next.iter_mut().zip(previous) {
            *next = self.sample(previous, rng);
        }
    }
}

foveate_base::settings! {
    /// Linear, Gaussian, first-order: with n standard normal, each one its own,
    /// ```text
    /// v'          = damping · v + velocity · n          (both axes)
    /// x'          = x + v' + position · n               (both axes)
    /// log_scale'  = scale_pull · log_scale + scale · n
    /// angle'      = angle_pull · angle + turn · n
    /// log_aspect' = aspect_pull · log_aspect + aspect · n
    /// ```
    /// Lengths are in pixels, or in template units where a configuration gives them, to be [`Dynamics::sized`].
    /// Deviation: a share `tail_probability` of the states has the noises of position, scale, angle and aspect `tail_scale` times as large: a
    /// mixture of two normals, of heavy tails.
    ///
    /// A standard deviation of 0 makes its component follow from the others. The density is then one over the
    /// remaining components, and −∞ (a probability of none) where the component does not follow.
    ///
    /// By default the prototype's working recipe, in template units (it had 0.7 and 0.5 px for a target of 28 px): nearly constant velocity, hardly
    /// any change of size, no turn.
    #[derive(Copy)]
    pub struct Autoregressive in "dynamics" {
        /// Share of the velocity kept from frame to frame: 1 is constant velocity, 0 a random walk.
        pub damping: f64 = 0.95; 0.0 to 1.0,
        /// Standard deviation of the velocity noise, template units a frame.
        pub velocity: f64 = 0.05; 0.0 to 100.0,
        /// Standard deviation of the position noise, template units.
        pub position: f64 = 0.035; 0.0 to 100.0,
        /// Share of the log scale kept: 1 is a random walk, below 1 it returns to the first size.
        pub scale_pull: f64 = 0.9; 0.0 to 1.0,
        /// Standard deviation of the log scale noise in a frame.
        pub log_scale: f64 = 0.01; 0.0 to 5.0,
        /// Share of the angle kept: 1 is a random walk, below 1 it returns upright.
        pub angle_pull: f64 = 0.9; 0.0 to 1.0,
        /// Standard deviation of the angle noise, radians.
        pub angle: f64 = 0.0; 0.0 to 100.0,
        /// Share of the log aspect kept: 1 is a random walk, below 1 it returns to the first shape.
        pub aspect_pull: f64 = 1.0; 0.0 to 1.0,
        /// Standard deviation of the log aspect noise in a frame.
        pub aspect: f64 = 0.0; 0.0 to 5.0,
        /// Share of the particles with heavy-tailed noise, for hand-held cameras, 0 to 1.
        pub tail_probability: f64 = 0.0; 0.0 to 1.0,
        /// Factor of the heavy-tailed noise of position, scale, angle and aspect, 1 to 100.
        pub tail_scale: f64 = 5.0; 1.0 to 100.0,
    }
}

impl Autoregressive {
    /// The same motion for a target `factor` times as large: the noises in pixels grow with it.
    pub fn scaled(self, factor: f64) -> Self {
        Self { velocity: self.velocity * factor, position: self.position * factor, ..self }
    }
}

/// log of the normal density of `value` around `mean`; for `sd` 0, whether they agree but for rounding: 0 or −∞.
fn log_normal(value: f64, mean: f64, sd: f64) -> f64 {
    /// ½ ln 2π.
    const HALF_LN_TAU: f64 = 0.918_938_533_204_672_8;
    if sd == 0.0 {
        let rounding = 1e-9 * (1.0 + mean.abs());
        return if (value - mean).abs() <= rounding { 0.0 } else { f64::NEG_INFINITY };
    }
    let z = (value - mean) / sd;
    -0.5 * z * z - sd.ln() - HALF_LN_TAU
}

/// Noises of standard deviation 1 on (vx, vy), (x, y), (log_scale, angle) and log_aspect.
type Noise = ([[f64; 2]; 3], f64);

impl Autoregressive {
    /// The successor of `previous` with this noise.
    #[inline]
    fn step(&self, previous: &State, ([velocity, position, shape], aspect): Noise) -> State {
        let vx = self.damping * previous.vx + self.velocity * velocity[0];
        let vy = self.damping * previous.vy + self.velocity * velocity[1];
        State {
            x: previous.x + vx + self.position * position[0],
            y: previous.y + vy + self.position * position[1],
            vx,
            vy,
            log_scale: self.scale_pull * previous.log_scale + self.log_scale * shape[0],
            angle: self.angle_pull * previous.angle + self.angle * shape[1],
            log_aspect: self.aspect_pull * previous.log_aspect + self.aspect * aspect,
        }
    }
    /// Several frames of this motion, with the variances of position and shape `wider` times as large.
    fn leap(&self, wider: f64, frames: usize) -> Leap {
        let &Self { damping, velocity, position, .. } = self;
        let pull = [self.scale_pull, self.angle_pull, self.aspect_pull];
        let shape = [self.log_scale, self.angle, self.aspect].map(|sd| wider.sqrt() * sd);
        Leap::of(Pace { damping, velocity, position: wider.sqrt() * position, pull, shape }, frames)
    }
    /// The variance of heavy-tailed noise relative to that of the narrow part.
    fn wider(&self) -> f64 {
        1.0 + self.tail_probability * (self.tail_scale * self.tail_scale - 1.0)
    }
    /// The noises of a state from the heavy tail.
    fn tail(&self, ([velocity, position, shape], aspect): Noise) -> Noise {
        let wide = |x: f64| self.tail_scale * x;
        ([velocity, position.map(wide), shape.map(wide)], wide(aspect))
    }
}

impl Dynamics for Autoregressive {
    fn expected(&self, previous: &State) -> State {
        self.step(previous, Noise::default())
    }

    fn spread(&self) -> f64 {
        (self.velocity * self.velocity + self.wider() * self.position * self.position).sqrt()
    }

    fn sized(&self, unit: f64) -> Arc<dyn Dynamics> {
        Arc::new(self.scaled(unit))
    }

    fn over(&self, frames: usize) -> Option<Leap> {
        (self.tail_probability <= 0.0).then(|| self.leap(1.0, frames))
    }

    fn moments(&self, frames: usize) -> Option<Leap> {
        Some(self.leap(self.wider(), frames))
    }

    fn sample(&self, previous: &State, rng: &mut Rng) -> State {
        let mut pair = || [rng.sample(StandardNormal), rng.sample(StandardNormal)];
        let noise = [pair(), pair(), pair()];
        let noise = (noise, if self.aspect == 0.0 { 0.0 } else { rng.sample(StandardNormal) });
        let in_tail = self.tail_probability > 0.0 && rng.random::<f64>() < self.tail_probability;
        self.step(previous, if in_tail { self.tail(noise) } else { noise })
    }

    fn sample_each(&self, previous: &[State], next: &mut [State], rng: &mut Rng) {
        const BATCH: usize = 64;
        let mut stream = Normals::new(rng.random());
        let [mut velocity, mut position, mut shape] = [[[0.0; 2]; BATCH]; 3];
        let mut aspect = [0.0; BATCH];
        for (previous, next) in previous.chunks(BATCH).zip(next.chunks_mut(BATCH)) {
            for (noise, needed) in [
                (&mut velocity, self.velocity != 0.0),
                (&mut position, self.position != 0.0),
                (&mut shape, self.log_scale != 0.0 || self.angle != 0.0),
            ] {
                if needed {
                    stream.fill(noise.as_flattened_mut());
                }
            }
            if self.aspect != 0.0 {
                stream.fill(&mut aspect);
            }
            // Every so many are of the heavy tail, from a random one on: each with the same probability, and always about as many.
            let mut turn = if self.tail_probability > 0.0 { rng.random::<f64>() } else { 0.0 };
            for i in 0..previous.len().min(next.len()).min(BATCH) {
                let noise = ([velocity[i], position[i], shape[i]], aspect[i]);
                turn += self.tail_probability;
                let in_tail = turn >= 1.0;
                turn -= f64::from(u8::from(in_tail));
                next[i] = self.step(&previous[i], if in_tail { self.tail(noise) } else { noise });
            }
        }
    }

    fn log_density(&self, next: &State, previous: &State) -> f64 {
        let of_speed = log_normal(next.vx, self.damping * previous.vx, self.velocity)
            + log_normal(next.vy, self.damping * previous.vy, self.velocity);
        let of_rest = |factor: f64| {
            log_normal(next.x, previous.x + next.vx, factor * self.position)
                + log_normal(next.y, previous.y + next.vy, factor * self.position)
                + log_normal(next.log_scale, self.scale_pull * previous.log_scale, factor * self.log_scale)
                + log_normal(next.angle, self.angle_pull * previous.angle, factor * self.angle)
                + log_normal(next.log_aspect, self.aspect_pull * previous.log_aspect, factor * self.aspect)
        };
        let [body, tail] =
            [(1.0 - self.tail_probability).ln() + of_rest(1.0), self.tail_probability.ln() + of_rest(self.tail_scale)];
        let most = body.max(tail);
        if most == f64::NEG_INFINITY {
            return most;
        }
        of_speed + most + ((body - most).exp() + (tail - most).exp()).ln()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::conformance;

    /// Every noise, none of the usual size.
    pub(in crate::control) const ALL: Autoregressive = Autoregressive {
        damping: 0.9,
        velocity: 0.7,
        position: 0.4,
        scale_pull: 0.95,
        log_scale: 0.02,
        angle_pull: 1.0,
        angle: 0.1,
        aspect_pull: 0.9,
        aspect: 0.03,
        tail_probability: 0.0,
        tail_scale: 3.0,
    };
    const FROM: State = State { x: 10.0, y: -5.0, vx: 2.0, vy: 1.0, log_scale: 0.2, angle: 0.5, log_aspect: -0.3 };

    #[test]
    fn draws_follow_the_density_with_and_without_each_noise() {
        for dynamics in [
            ALL,
            Autoregressive { position: 0.0, ..ALL },
            Autoregressive { velocity: 0.0, ..ALL },
            Autoregressive { angle: 0.0, log_scale: 0.0, ..ALL },
            Autoregressive { aspect: 0.0, ..ALL },
            Autoregressive { velocity: 0.0, position: 0.0, log_scale: 0.0, angle: 0.0, aspect: 0.0, ..ALL },
            Autoregressive::default(),
            Autoregressive { tail_probability: 0.2, ..ALL },
        ] {
            conformance::dynamics(&dynamics, &FROM);
        }
    }

    #[test]
    #[should_panic(expected = "the density of sample's draws")]
    fn the_law_finds_a_wrong_density() {
        struct Wrong;
        impl Dynamics for Wrong {
            fn expected(&self, previous: &State) -> State {
                ALL.expected(previous)
            }
            fn spread(&self) -> f64 {
                ALL.spread()
            }
            fn sized(&self, _: f64) -> Arc<dyn Dynamics> {
                Arc::new(Wrong)
            }
            fn sample(&self, previous: &State, rng: &mut Rng) -> State {
                ALL.sample(previous, rng)
            }
            fn log_density(&self, next: &State, previous: &State) -> f64 {
                Autoregressive { velocity: 0.75, ..ALL }.log_density(next, previous)
            }
        }
        conformance::dynamics(&Wrong, &FROM);
    }

    #[test]
    fn density_in_closed_form() {
        // One deviation off in vx, two in y, at the mean elsewhere.
        let mean = ALL.damping * FROM.vx;
        let (vx, vy) = (mean + ALL.velocity, ALL.damping * FROM.vy);
        let next = State {
            vx,
            vy,
            x: FROM.x + vx,
            y: FROM.y + vy - 2.0 * ALL.position,
            log_scale: ALL.scale_pull * FROM.log_scale,
            angle: FROM.angle,
            log_aspect: ALL.aspect_pull * FROM.log_aspect,
        };
        let volume: f64 = [0.7, 0.7, 0.4, 0.4, 0.02, 0.1, 0.03].iter().product();
        let exact = -0.5 - 2.0 - volume.ln() - 3.5 * std::f64::consts::TAU.ln();
        assert!((ALL.log_density(&next, &FROM) - exact).abs() < 1e-12);
        // One of the heavy tail has a density of a mixture, of the other five components.
        let leaping = Autoregressive { tail_probability: 0.25, ..ALL };
        let far = |factor: f64| {
            -0.5 - 2.0 / factor.powi(2) - 5.0 * factor.ln() - volume.ln() - 3.5 * std::f64::consts::TAU.ln()
        };
        let mixture = (0.75 * far(1.0).exp() + 0.25 * far(ALL.tail_scale).exp()).ln();
        assert!((leaping.log_density(&next, &FROM) - mixture).abs() < 1e-12);
        let still = Autoregressive { angle: 0.0, aspect: 0.0, ..ALL };
        for moved in [State { angle: 0.6, ..next }, State { log_aspect: 0.1, ..next }] {
            assert_eq!(still.log_density(&moved, &FROM), f64::NEG_INFINITY);
        }
    }
}
