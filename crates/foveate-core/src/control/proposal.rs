//! q(xₜ | xₜ₋₁, scene): the proposal of the next particles (Algorithm 1, "predict the next state").

use super::{Dynamics, Leap};
use crate::geometry::State;
use crate::scene::{Image, Scene};
use foveate_base::rng::Streams;
use std::sync::Arc;

/// Draws the next particles, and returns log p/q for their weights.
///
/// Child i must come from `q(· | parents[i], scene)`, and `log_ratio[i]` be log p/q of it, in nats (0 where
/// q = p). Randomness comes from `streams` alone, stream i for the i-th chunk of [`CHUNK`] particles, so that
/// neither the number of threads nor of particles changes a child. All three slices have the same length.
pub trait Proposal: Send + Sync {
    /// Sets the scale at the start: one template unit is `unit` pixels.
    fn size(&mut self, unit: f64);
    /// The density of several frames without detections, independent of the picture; `None` without a closed form.
    fn over(&self, _frames: usize) -> Option<Leap> {
        None
    }
    /// The normal density with the mean and covariance of several frames of the dynamics, without the edges of the picture; `None`
    /// without a closed form.
    fn moments(&self, frames: usize) -> Option<Leap> {
        self.over(frames)
    }
    /// Whether the proposal depends on detections. If not, a tracker refuses detections that nothing else uses.
    fn uses_detections(&self) -> bool {
        true
    }
    /// Fills `children` and `log_ratio`.
    fn propose(
        &mut self,
        scene: Scene<'_>,
        parents: &[State],
        children: &mut [State],
        log_ratio: &mut [f64],
        streams: Streams,
    );
}

/// Particles that share a random stream. Fixed: results must not depend on the number of threads.
pub const CHUNK: usize = 64;

/// The transition prior: q = p, the bootstrap filter (section 6.1: "the transition prior as proposal").
#[derive(Clone)]
pub struct Prior {
    given: Arc<dyn Dynamics>,
    dynamics: Arc<dyn Dynamics>,
    clamp_to_frame: bool,
}

foveate_base::opaque_debug!(Prior);

impl Prior {
    /// Proposes from these dynamics; their lengths are pixels until `size` is called.
    pub fn new(dynamics: Arc<dyn Dynamics>) -> Self {
        Self { given: dynamics.clone(), dynamics, clamp_to_frame: false }
    }
    /// Whether a target's centre that would leave the picture stays at its edge, without the speed that took it there.
    ///
    /// Deviation: the paper does not clamp, so a lost particle leaves the picture forever. The clamp is part of p, so
    /// p/q stays 1.
    pub fn clamp_to_frame(self, clamp_to_frame: bool) -> Self {
        Self { clamp_to_frame, ..self }
    }
}

/// Keeps the centres of states within the pixels of a picture.
pub(super) fn confine(states: &mut [State], image: &Image) {
    let [right, bottom] = [image.width(), image.height()].map(|side| (side - 1) as f64);
    for state in states {
        for (place, speed, end) in [(&mut state.x, &mut state.vx, right), (&mut state.y, &mut state.vy, bottom)] {
            if !(0.0..=end).contains(place) {
                *place = place.clamp(0.0, end);
                *speed = 0.0;
            }
        }
    }
}

impl Proposal for Prior {
    fn size(&mut self, unit: f64) {
        self.dynamics = self.given.sized(unit);
    }

    fn over(&self, frames: usize) -> Option<Leap> {
        if self.clamp_to_frame { None } else { self.dynamics.over(frames) }
    }

    fn moments(&self, frames: usize) -> Option<Leap> {
        self.dynamics.moments(frames)
    }

    fn uses_detections(&self) -> bool {
        false
    }

    // One thread: six normal draws a particle cost less than waking another thread for some thousands of them.
    fn propose(
        &mut self,
        scene: Scene<'_>,
        parents: &[State],
        children: &mut [State],
        log_ratio: &mut [f64],
        streams: Streams,
    ) {
        assert_eq!(parents.len(), children.len(), "one child for each parent");
        log_ratio.fill(0.0);
        for (i, (parents, children)) in parents.chunks(CHUNK).zip(children.chunks_mut(CHUNK)).enumerate() {
            self.dynamics.sample_each(parents, children, &mut streams.rng(i as u64));
        }
        if self.clamp_to_frame {
            confine(children, scene.image);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::conformance::blank_image;
    use crate::control::Autoregressive;

    #[test]
    fn the_prior_keeps_the_law() {
        let frame = blank_image();
        let scene = Scene { image: &frame, detections: &[] };
        let parent = State::from_array([1.0, 2.0, 3.0, 4.0, 0.1, 0.2, 0.3]);
        conformance::proposal(&mut Prior::new(Arc::new(Autoregressive::default())), scene, &parent);
        let still = Autoregressive { velocity: 0.0, position: 0.0, log_scale: 0.0, ..Default::default() };
        conformance::proposal(&mut Prior::new(Arc::new(still)), scene, &parent);
        conformance::proposal(&mut Prior::new(Arc::new(still)).clamp_to_frame(true), scene, &parent);
    }

    #[test]
    fn clamping_keeps_states_in_the_picture() {
        let inside = State { x: 19.0, y: 0.0, vx: 9.0, vy: -9.0, ..State::default() };
        let mut states = [State { x: -3.0, y: 7.5, vx: -4.0, vy: 2.0, ..State::default() }, inside];
        confine(&mut states, &Image::grey(20, 8, 0));
        assert_eq!(states[0].to_array(), [0.0, 7.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(states[1], inside, "its speed is its own until it leaves");
    }
}
