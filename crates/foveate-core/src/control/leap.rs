//! Several frames of linear, Gaussian motion at once.
//!
//! Along an axis, with n and m standard normal, d the damping and q, p the deviations of velocity and place,
//! ```text
//! v' = d v + q n        x' = x + v' + p m
//! ```
//! k steps are normal again: v with mean dᵏ v, x with mean x + (d + d² + ... + dᵏ) v, and two intervals combine into
//! one. So dropped frames cost as much as one, and a frame without a look as much as one of a Kalman filter.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::geometry::{Covariance, State};
use foveate_base::rng::Rng;

/// The law of some frames of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leap {
    /// Share of the velocity that is kept, and the frames' worth of it that the place has moved.
    kept: f64,
    led: f64,
    /// Variance of the velocity, its covariance with the place, variance of the place.
    noise: [f64; 3],
    /// Shares of log scale, angle and log aspect that are kept, and the variances of their noises.
    pull: [f64; 3],
    shape: [f64; 3],
}

/// One frame of motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    pub damping: f64,
    pub velocity: f64,
    pub position: f64,
    /// Of log scale, angle and log aspect.
    pub pull: [f64; 3],
    pub shape: [f64; 3],
}

impl Leap {
    /// So many frames of this motion.
    pub(super) fn of(Pace { damping, velocity, position, pull, shape }: Pace, frames: usize) -> Self {
        let (v, p) = (velocity * velocity, position * position);
        let frame = Self { kept: damping, led: damping, noise: [v, v, v + p], pull, shape: shape.map(|sd| sd * sd) };
        let still = Self { kept: 1.0, led: 0.0, noise: [0.0; 3], pull: [1.0; 3], shape: [0.0; 3] };
        // By the binary digits of the number: however long the wait, it is known at once.
        let (mut all, mut part, mut left) = (still, frame, frames);
        while left > 0 {
            if left % 2 == 1 {
                all = all.then(&part);
            }
            (part, left) = (part.then(&part), left / 2);
        }
        all
    }

    /// These frames, and then those.
    fn then(&self, next: &Self) -> Self {
        let ([v, vx, x], [next_v, next_vx, next_x]) = (self.noise, next.noise);
        let noise = [
            next.kept * next.kept * v + next_v,
            next.kept * (vx + next.led * v) + next_vx,
            x + 2.0 * next.led * vx + next.led * next.led * v + next_x,
        ];
        Self {
            kept: next.kept * self.kept,
            led: self.led + next.led * self.kept,
            noise,
            pull: std::array::from_fn(|k| next.pull[k] * self.pull[k]),
            shape: std::array::from_fn(|k| next.pull[k] * next.pull[k] * self.shape[k] + next.shape[k]),
        }
    }

    /// Draws each state after these frames.
    pub fn draw(&self, states: &mut [State], rng: &mut Rng) {
        let [v, vx, x] = self.noise;
        let speed = v.sqrt();
        // Cholesky: the place's part that goes with the velocity's noise, and its own.
        let tied = if speed > 0.0 { vx / speed } else { 0.0 };
        let own = (x - tied * tied).max(0.0).sqrt();
        let [scale, angle, aspect] = self.shape.map(f64::sqrt);
        let mut normal = |sd: f64| if sd > 0.0 { rng.sample::<f64, _>(StandardNormal) } else { 0.0 };
        for s in states {
            for (place, velocity) in [(&mut s.x, &mut s.vx), (&mut s.y, &mut s.vy)] {
                let n = normal(speed);
                *place += self.led * *velocity + tied * n + own * normal(own);
                *velocity = self.kept * *velocity + speed * n;
            }
            s.log_scale = self.pull[0] * s.log_scale + scale * normal(scale);
            s.angle = self.pull[1] * s.angle + angle * normal(angle);
            s.log_aspect = self.pull[2] * s.log_aspect + aspect * normal(aspect);
        }
    }

    /// Mean and covariance after these frames, from those before.
    pub fn spread(&self, mean: &mut State, covariance: &mut Covariance) {
        let lead = |a: &mut [f64; State::N]| {
            a[0] += self.led * a[2];
            a[1] += self.led * a[3];
            a[2] *= self.kept;
            a[3] *= self.kept;
            a[4..].iter_mut().zip(self.pull).for_each(|(a, pull)| *a *= pull);
        };
        let mut at = mean.to_array();
        lead(&mut at);
        *mean = State::from_array(at);
        // A C Aᵀ: every row, then every column.
        covariance.iter_mut().for_each(lead);
        (0..State::N).for_each(|j| {
            let mut column = std::array::from_fn(|i| covariance[i][j]);
            lead(&mut column);
            covariance.iter_mut().zip(column).for_each(|(row, value)| row[j] = value);
        });
        let [v, vx, x] = self.noise;
        for axis in 0..2 {
            covariance[axis][axis] += x;
            covariance[axis + 2][axis + 2] += v;
            covariance[axis][axis + 2] += vx;
            covariance[axis + 2][axis] += vx;
        }
        for (i, noise) in (4..).zip(self.shape) {
            covariance[i][i] += noise;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::dynamics::tests::ALL;
    use super::super::{Autoregressive, Belief, Dynamics};
    use super::*;
    use foveate_base::rng::Streams;

    const FROM: State = State { x: 10.0, y: -5.0, vx: 2.0, vy: 1.0, log_scale: 0.2, angle: 0.5, log_aspect: -0.3 };

    fn belief(states: &[State]) -> (State, Covariance) {
        let weights = vec![1.0 / states.len() as f64; states.len()];
        let belief = Belief { states, weights: &weights };
        (belief.mean(), belief.covariance())
    }

    /// Seven frames at once, in closed form and drawn, against 40,000 draws of seven frames one by one. A mean or a covariance of so
    /// many draws is off by five of its standard errors with a probability below 1e-6; the seed is fixed.
    #[test]
    fn it_is_frame_after_frame() {
        const DRAWS: usize = 40_000;
        for dynamics in
            [ALL, Autoregressive { velocity: 0.0, ..ALL }, Autoregressive { position: 0.0, damping: 1.0, ..ALL }]
        {
            let mut rng = Streams::new(3, 0).rng(1);
            let mut slow = vec![FROM; DRAWS];
            for _ in 0..7 {
                slow.iter_mut().for_each(|state| *state = dynamics.sample(state, &mut rng));
            }
            let leap = dynamics.over(7).expect("normal noise");
            let (mut at_once, mut closed) = (vec![FROM; DRAWS], (FROM, Covariance::default()));
            leap.draw(&mut at_once, &mut rng);
            leap.spread(&mut closed.0, &mut closed.1);
            let sd = |i: usize| closed.1[i][i].sqrt();
            for (mean, covariance) in [belief(&slow), belief(&at_once)] {
                let (drawn, exact) = (mean.to_array(), closed.0.to_array());
                for (i, j) in (0..State::N * State::N).map(|k| (k / State::N, k % State::N)) {
                    let off = (drawn[i] - exact[i]).abs();
                    assert!(off <= 5.0 * sd(i) / (DRAWS as f64).sqrt() + 1e-9, "mean {i} is off by {off}");
                    let off = (covariance[i][j] - closed.1[i][j]).abs();
                    let most = 5.0 * sd(i) * sd(j) * (2.0 / DRAWS as f64).sqrt() + 1e-9;
                    assert!(off <= most, "({i}, {j}) is off by {off}");
                }
            }
        }
    }

    /// Frames add up: five and then two are seven.
    #[test]
    fn leaps_add_up() {
        let over = |frames| ALL.over(frames).expect("normal noise");
        let mut covariance = Covariance::default();
        (0..State::N).for_each(|i| covariance[i][i] = 0.1 + i as f64);
        covariance[0][2] = 0.3;
        covariance[2][0] = 0.3;
        let (mut whole, mut parts) = ((FROM, covariance), (FROM, covariance));
        over(7).spread(&mut whole.0, &mut whole.1);
        over(5).spread(&mut parts.0, &mut parts.1);
        over(2).spread(&mut parts.0, &mut parts.1);
        let off = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{a} is not {b}");
        (0..State::N).for_each(|i| off(whole.0.to_array()[i], parts.0.to_array()[i]));
        (0..State::N).for_each(|i| whole.1[i].iter().zip(parts.1[i]).for_each(|(a, b)| off(*a, b)));
        assert!(Autoregressive { tail_probability: 0.1, ..ALL }.over(2).is_none(), "a mixture of normals is none");
    }
}
