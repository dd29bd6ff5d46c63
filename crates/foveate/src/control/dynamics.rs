//! p(xₜ | xₜ₋₁): how the target is expected to move (section 3.1).

use crate::geometry::State;
use crate::rng::Rng;
use crate::{Error, Result};
use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Where a state leads within one frame: a density that can be drawn from.
///
/// `sample` must draw from the density that `log_density` evaluates, or importance weights are wrong and
/// `conformance::dynamics` fails. Both are called from many threads.
pub trait Dynamics: Send + Sync {
    /// One draw from p(· | previous), with randomness from `rng` alone.
    fn sample(&self, previous: &State, rng: &mut Rng) -> State;
    /// log p(next | previous) in nats, exact, with its constants.
    fn log_density(&self, next: &State, previous: &State) -> f64;
    /// One draw for each state: the same bits as calls of `sample` in turn, in one virtual call.
    fn sample_each(&self, previous: &[State], next: &mut [State], rng: &mut Rng) {
        for (next, previous) in next.iter_mut().zip(previous) {
            *next = self.sample(previous, rng);
        }
    }
}

/// Linear, Gaussian, first-order: with n standard normal, each one its own,
/// ```text
/// v'         = damping · v + velocity · n          (both axes)
/// x'         = x + v' + position · n               (both axes)
/// log_scale' = scale_pull · log_scale + scale · n
/// angle'     = angle_pull · angle + turn · n
/// ```
/// A standard deviation of 0 makes its component follow from the others. The density is then one over the
/// remaining components, and −∞ (a probability of none) where the component does not follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Autoregressive {
    /// Share of the velocity that is kept from frame to frame: 1 is constant velocity, 0 a random walk.
    pub damping: f64,
    /// Standard deviation of the velocity's noise, pixels a frame.
    pub velocity: f64,
    /// Standard deviation of the position's own noise, pixels.
    pub position: f64,
    /// Share of the logarithm of scale that is kept: 1 is a random walk, below 1 it returns to the first size.
    pub scale_pull: f64,
    /// Standard deviation of the noise on the natural logarithm of scale.
    pub log_scale: f64,
    /// Share of the angle that is kept: 1 is a random walk, below 1 it returns upright.
    pub angle_pull: f64,
    /// Standard deviation of the angle's noise, radians.
    pub angle: f64,
}

impl Default for Autoregressive {
    /// The prototype's working recipe (for a target of 28 px): nearly constant velocity, hardly any change of size, no turn.
    fn default() -> Self {
        Self {
            damping: 0.95,
            velocity: 0.7,
            position: 0.5,
            scale_pull: 0.9,
            log_scale: 0.01,
            angle_pull: 0.9,
            angle: 0.0,
        }
    }
}

impl Autoregressive {
    /// Fails where a standard deviation is negative or anything is not finite, naming the field.
    pub fn check(&self) -> Result<()> {
        let sds = [self.velocity, self.position, self.log_scale, self.angle];
        for (name, sd) in ["velocity", "position", "log_scale", "angle"].into_iter().zip(sds) {
            if !(sd >= 0.0 && sd.is_finite()) {
                return Err(Error::Config(format!("dynamics.{name} is a standard deviation, 0 or more; it is {sd}")));
            }
        }
        let shares = [self.damping, self.scale_pull, self.angle_pull];
        for (name, share) in ["damping", "scale_pull", "angle_pull"].into_iter().zip(shares) {
            if !(0.0..=1.0).contains(&share) {
                return Err(Error::Config(format!("dynamics.{name} is a share, from 0 to 1; it is {share}")));
            }
        }
        Ok(())
    }
    /// The same motion for a target `factor` times as large: the noises in pixels grow with it.
    pub fn scaled(self, factor: f64) -> Self {
        Self { velocity: self.velocity * factor, position: self.position * factor, ..self }
    }
}

/// A normal draw of standard deviation `sd`; no randomness is spent where `sd` is 0.
#[inline]
fn noise(sd: f64, rng: &mut Rng) -> f64 {
    if sd == 0.0 {
        return 0.0;
    }
    let n: f64 = rng.sample(StandardNormal);
    sd * n
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

impl Dynamics for Autoregressive {
    #[inline]
    fn sample(&self, previous: &State, rng: &mut Rng) -> State {
        let vx = self.damping * previous.vx + noise(self.velocity, rng);
        let vy = self.damping * previous.vy + noise(self.velocity, rng);
        State {
            x: previous.x + vx + noise(self.position, rng),
            y: previous.y + vy + noise(self.position, rng),
            vx,
            vy,
            log_scale: self.scale_pull * previous.log_scale + noise(self.log_scale, rng),
            angle: self.angle_pull * previous.angle + noise(self.angle, rng),
        }
    }

    fn log_density(&self, next: &State, previous: &State) -> f64 {
        log_normal(next.vx, self.damping * previous.vx, self.velocity)
            + log_normal(next.vy, self.damping * previous.vy, self.velocity)
            + log_normal(next.x, previous.x + next.vx, self.position)
            + log_normal(next.y, previous.y + next.vy, self.position)
            + log_normal(next.log_scale, self.scale_pull * previous.log_scale, self.log_scale)
            + log_normal(next.angle, self.angle_pull * previous.angle, self.angle)
    }
}
