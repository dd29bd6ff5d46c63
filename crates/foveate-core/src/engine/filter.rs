//! WHERE is it? `predict` and `select`: the particle filter before and after the looks.

use super::particles::{Particles, mean};
use super::target::Estimate;
use super::waiting::Waiting;
use crate::control::{
    Belief, CHUNK, CameraMotion, DetectionLikelihood, Leap, LocalSearch, Proposal, Redetection, Resampling, normalize,
};
use crate::geometry::{Covariance, Extent, State};
use crate::saved_state::{Valid, Validate, ensure};
use crate::scene::{Detection, Flow, Scene};
use crate::start::StartSpread;
use foveate_base::rng::Purpose::{Dropped, Predict};
use foveate_base::rng::Streams;
use foveate_base::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize};

/// The particles, and the parts that predict, weigh, resample and redraw them.
pub struct Filter {
    /// q(xₜ | xₜ₋₁, scene).
    pub(super) proposal: Box<dyn Proposal>,
    /// The selection step.
    pub(super) resampling: Resampling,
    /// p(x₀): the spread of the first particles around the given box.
    pub(super) start: StartSpread,
    pub(super) camera_motion: Option<CameraMotion>,
    pub(super) detection_likelihood: Option<DetectionLikelihood>,
    pub(super) redetection: Option<Redetection>,
    /// Many targets have none: a box keeps each small.
    pub(super) local_search: Option<Box<LocalSearch>>,
    /// Frames that were dropped before the next one.
    pub(super) dropped: usize,
    pub(super) state: FilterState,
}

/// The state of a filter between frames.
#[derive(Serialize, Deserialize)]
pub(super) struct FilterState {
    /// xₜ⁽ⁱ⁾ and log wₜ⁽ⁱ⁾.
    pub particles: Vec<State>,
    #[serde(deserialize_with = "log_weights")]
    pub log_weights: Vec<f64>,
    /// The belief while the target waits for its next look. The particles are those of the last one.
    pub waiting: Option<Waiting>,
}

foveate_base::opaque_debug!(Filter);

/// The largest number of a saved particle: squares of larger ones overflow sooner or later.
const FARTHEST: f64 = 1e9;

/// The largest log of width / height, relative to frame 1, that a target is given: 20 to 1.
pub(super) const MOST_ASPECT: f64 = 3.0;

/// Reads log weights: JSON has no −∞, which is null there.
fn log_weights<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<Vec<f64>, D::Error> {
    let saved = Vec::<Option<f64>>::deserialize(from)?;
    Ok(saved.into_iter().map(|w| w.unwrap_or(f64::NEG_INFINITY)).collect())
}

impl Validate<&Filter> for FilterState {
    fn validate(&self, filter: &&Filter) -> Valid {
        let (n, particles, weights) = (filter.state.particles.len(), self.particles.len(), self.log_weights.len());
        ensure(particles == n && weights == n, || {
            format!("it has {particles} particles and {weights} weights, this tracker has {n}")
        })?;
        let sum: f64 = self.log_weights.iter().map(|log_weight| log_weight.exp()).sum();
        ensure((sum - 1.0).abs() < 1e-6, || format!("its weights add up to {sum}, not to 1"))?;
        let is_near = |particle: &State| particle.to_array().iter().all(|value| value.abs() <= FARTHEST);
        ensure(self.particles.iter().all(is_near), || format!("it has a particle beyond {FARTHEST:e}"))?;
        ensure(self.waiting.is_none() || filter.leap().is_some(), || "it waits, but its motion is not normal".into())?;
        let is_possible = |it: &Waiting| is_near(&it.mean) && it.has_covariance(FARTHEST);
        ensure(self.waiting.as_ref().is_none_or(is_possible), || "it waits, but without mean and covariance".into())
    }
}

impl Filter {
    /// Creates a filter of `n` particles with the default resampling and start spread.
    ///
    /// # Errors
    /// If `n` is 0.
    pub fn new(proposal: Box<dyn Proposal>, n: usize) -> Result<Self> {
        if n == 0 {
            return Err(Error::Config("particles must be at least 1, got 0; 100 to 1000 are usual".into()));
        }
        Ok(Self {
            proposal,
            resampling: Resampling::default(),
            start: StartSpread::default(),
            camera_motion: None,
            detection_likelihood: None,
            redetection: None,
            local_search: None,
            dropped: 0,
            state: FilterState {
                particles: vec![State::default(); n],
                log_weights: vec![-(n as f64).ln(); n],
                waiting: None,
            },
        })
    }
    /// Sets the proposal that predicts the particles.
    pub fn with_proposal(self, proposal: Box<dyn Proposal>) -> Self {
        Self { proposal, ..self }
    }
    /// Sets the resampling scheme.
    pub fn with_resampling(self, resampling: Resampling) -> Self {
        Self { resampling, ..self }
    }
    /// Sets the spread of the first particles.
    pub fn with_start(self, start: StartSpread) -> Self {
        Self { start, ..self }
    }
    /// Sets the camera motion, which moves particles before they are predicted.
    pub fn with_camera_motion(self, camera_motion: Option<CameraMotion>) -> Self {
        Self { camera_motion, ..self }
    }
    /// Sets the detection likelihood p(detections | xₜ), which weighs particles.
    pub fn with_detection_likelihood(self, detection_likelihood: Option<DetectionLikelihood>) -> Self {
        Self { detection_likelihood, ..self }
    }
    /// Sets the search of the whole picture for a lost target.
    pub fn with_redetection(self, redetection: Option<Redetection>) -> Self {
        Self { redetection, ..self }
    }

    /// Sets the search around the estimate for a target that has moved abruptly.
    pub fn with_local_search(self, local_search: Option<LocalSearch>) -> Self {
        Self { local_search: local_search.map(Box::new), ..self }
    }

    /// Returns whether detections move or weigh particles.
    pub(super) fn uses_detections(&self) -> bool {
        self.detection_likelihood.is_some() || self.proposal.uses_detections()
    }

    /// Draws all particles anew around a state.
    pub(super) fn spread(&mut self, state: &State, extent: Extent, streams: Streams) {
        self.state.waiting = None;
        self.start.draw(state, extent, &mut self.state.particles, streams);
        let even = -(self.state.particles.len() as f64).ln();
        self.state.log_weights.fill(even);
    }
}

impl Filter {
    /// Draws x̃ ~ q(x | x′) and computes log wₜ₋₁ p/q with the detection likelihood: the log weights of frame `t` before the looks. If
    /// nothing detects the target, its sizes stay near that of `held`. The buffers of `reuse` are used again.
    pub(super) fn predict(
        &mut self,
        scene: Scene<'_>,
        extent: Extent,
        held: Option<&State>,
        (streams, t): (Streams, u64),
        reuse: Particles,
    ) -> Particles {
        self.catch_up(streams.at(t - 1, Predict)); // If the particles waited, nothing was drawn in the previous frame.
        let dropped = std::mem::take(&mut self.dropped);
        if let Some(leap) = (dropped > 0).then(|| self.proposal.moments(dropped)).flatten() {
            self.advance(&leap, streams.at(t, Dropped));
        }
        let mut to = reuse;
        let n = self.state.particles.len();
        to.states.resize(n, State::default());
        to.log_importance.resize(n, 0.0);
        self.proposal.propose(
            scene,
            &self.state.particles,
            &mut to.states,
            &mut to.log_importance,
            streams.at(t, Predict),
        );
        to.log_importance
            .iter_mut()
            .zip(&self.state.log_weights)
            .for_each(|(importance, carried)| *importance += carried);
        let weigh = |it: &DetectionLikelihood| it.weigh(scene.detections, &to.states, extent, &mut to.log_importance);
        to.detection_offset = self.detection_likelihood.as_ref().map_or(0.0, weigh);
        to.weights.resize(n, 0.0);
        normalize(&self.state.log_weights, &mut to.weights);
        to.expected = mean(&to.states, &to.weights);
        to.dropped = dropped;
        if let Some(held) = held.filter(|_| !self.uses_detections()) {
            to.hold_size(held);
        }
        to
    }

    /// Resamples if the effective sample size is too small; otherwise all particles keep their weights. Returns the index of each one's
    /// parent, in the buffer `ancestors`.
    pub(super) fn select(
        &mut self,
        belief: &Particles,
        estimate: &Estimate,
        streams: Streams,
        mut ancestors: Vec<usize>,
    ) -> Vec<usize> {
        let n = self.state.particles.len();
        ancestors.resize(n, 0);
        if self.resampling.is_due(estimate.ess, n) {
            self.resampling.select(&belief.weights, &mut ancestors, &mut streams.rng(0));
            self.state.log_weights.fill(-(n as f64).ln());
        } else {
            ancestors.iter_mut().enumerate().for_each(|(i, a)| *a = i);
            self.state.log_weights.iter_mut().zip(&belief.weights).for_each(|(carried, weight)| *carried = weight.ln());
        }
        self.state.particles.iter_mut().zip(&ancestors).for_each(|(particle, a)| *particle = belief.states[*a]);
        ancestors
    }

    /// Changes the size and the shape of all particles.
    pub(super) fn reshape(&mut self, [log_scale, log_aspect]: [f64; 2]) {
        for particle in &mut self.state.particles {
            particle.log_scale += log_scale;
            particle.log_aspect = (particle.log_aspect + log_aspect).clamp(-MOST_ASPECT, MOST_ASPECT);
        }
    }

    /// Moves the belief with the camera.
    pub(super) fn compensate(&mut self, flow: &Flow) {
        match (&self.camera_motion, &mut self.state.waiting) {
            (Some(camera_motion), Some(waiting)) => waiting.shift(camera_motion, flow),
            (Some(camera_motion), None) => camera_motion.shift(flow, &mut self.state.particles),
            (None, _) => {}
        }
    }

    /// Returns the motion of a frame if a normal belief stays normal without looks: the dynamics are, and all particles follow the camera.
    pub(super) fn leap(&self) -> Option<Leap> {
        self.proposal.over(1).filter(|_| self.camera_motion.is_none_or(|it| it.share >= 1.0))
    }

    /// Runs a frame of this motion without a look, with the target's detection if it has one. Returns mean and covariance.
    pub(super) fn wait(&mut self, leap: &Leap, detection: Option<&Detection>, extent: Extent) -> (State, Covariance) {
        let mut waiting = self.state.waiting.unwrap_or_else(|| {
            let weights: Vec<f64> = self.state.log_weights.iter().map(|w| w.exp()).collect();
            Waiting::of(&Belief { states: &self.state.particles, weights: &weights })
        });
        waiting.advance(leap);
        if let (Some(likelihood), Some(detection)) = (&self.detection_likelihood, detection) {
            waiting.measure(detection, likelihood, extent);
        }
        self.state.waiting = Some(waiting);
        (waiting.mean, waiting.covariance)
    }

    /// Draws the particles of a target that has waited.
    fn catch_up(&mut self, streams: Streams) {
        let Some(waiting) = self.state.waiting.take() else { return };
        waiting.draw(&mut self.state.particles, &mut streams.rng(0));
        self.state.log_weights.fill(-(self.state.particles.len() as f64).ln());
    }

    /// Draws all particles after these frames of motion.
    fn advance(&mut self, leap: &Leap, streams: Streams) {
        for (i, particles) in self.state.particles.chunks_mut(CHUNK).enumerate() {
            leap.draw(particles, &mut streams.rng(i as u64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Autoregressive, Prior};
    use crate::scene::Image;
    use foveate_base::rng::Purpose;
    use std::sync::Arc;

    /// Each rule by itself: as many particles, as many weights that add up to 1, and waiting only with normal motion.
    #[test]
    fn a_state_of_another_filter_is_refused() {
        let filter = |tail_probability| {
            let dynamics = Autoregressive { tail_probability, ..Autoregressive::default() };
            Filter::new(Box::new(Prior::new(Arc::new(dynamics))), 3).expect("particles")
        };
        let wait = Waiting { mean: State::default(), covariance: Covariance::default() };
        let state = |particles: usize, weights: usize, waiting: Option<Waiting>| FilterState {
            particles: vec![State::default(); particles],
            log_weights: vec![-(weights as f64).ln(); weights],
            waiting,
        };
        let fits = |state: FilterState, tail: f64| state.validate(&&filter(tail)).is_ok();
        assert!(fits(state(3, 3, None), 0.1) && fits(state(3, 3, Some(wait)), 0.0));
        assert!(!fits(state(2, 3, None), 0.0) && !fits(state(3, 4, None), 0.0));
        assert!(!fits(state(3, 3, Some(wait)), 0.1), "a mixture of normals cannot wait");
        let mut heavy = state(3, 3, None);
        heavy.log_weights[1] = 60.0;
        assert!(!fits(heavy, 0.0), "weights that do not add up to 1");
        let mut far = state(3, 3, None);
        far.particles[1].x = 1e10;
        assert!(!fits(far, 0.0));
        // Neither a negative variance nor a covariance above those of its numbers.
        for (at, value) in [((0, 0), -1.0), ((0, 1), 1.0), ((0, 0), 1e300)] {
            let mut wait = wait;
            wait.covariance[at.0][at.1] = value;
            assert!(!fits(state(3, 3, Some(wait)), 0.0), "{value} at {at:?}");
        }
        let far = Waiting { mean: State { x: 1e10, ..State::default() }, ..wait };
        assert!(!fits(state(3, 3, Some(far)), 0.0));
    }

    /// Logarithms of size and shape add up; a shape stays within its limits.
    #[test]
    fn all_particles_take_a_new_size_and_shape() {
        let mut filter = Filter::new(Box::new(Prior::new(Arc::new(Autoregressive::default()))), 2).expect("particles");
        filter.state.particles[1] = State { log_scale: 0.5, log_aspect: -0.25, ..State::default() };
        filter.reshape([0.125, -0.5]);
        let shapes: Vec<_> = filter.state.particles.iter().map(|it| (it.log_scale, it.log_aspect)).collect();
        assert_eq!(shapes, [(0.125, -0.5), (0.625, -0.75)]);
        filter.reshape([0.0, 1e3]);
        assert!(filter.state.particles.iter().all(|it| it.log_aspect == MOST_ASPECT));
    }

    /// n frames at constant velocity with noises q, p: x has moved by n v, and its variance is n p² + q² Σ k² over k = 1 ... n. With
    /// n - 1 of them dropped, one step gives that; without, that of one frame.
    #[test]
    fn dropped_frames_move_and_spread_the_particles() {
        const MANY: usize = 40_000;
        let (velocity, position) = (0.5, 0.3);
        let dynamics = Autoregressive { damping: 1.0, velocity, position, ..Autoregressive::default() };
        let image = Image::grey(9, 9, 0);
        for n in [1, 2, 5] {
            let mut filter = Filter::new(Box::new(Prior::new(Arc::new(dynamics))), MANY).expect("particles");
            filter.state.particles.fill(State { x: 10.0, vx: 3.0, ..State::default() });
            filter.dropped = n - 1;
            let (scene, extent) = (Scene { image: &image, detections: &[] }, Extent { half_w: 1.0, half_h: 1.0 });
            let streams = Streams::new(7, 0);
            let seen = filter.predict(scene, extent, None, (streams, 1), Particles::default());
            let mean = seen.states.iter().map(|s| s.x).sum::<f64>() / MANY as f64;
            let variance = seen.states.iter().map(|s| (s.x - mean).powi(2)).sum::<f64>() / MANY as f64;
            let squares = (1..=n).map(|k| (k * k) as f64).sum::<f64>();
            let exact = n as f64 * position * position + velocity * velocity * squares;
            assert!((mean - (10.0 + 3.0 * n as f64)).abs() < 4.0 * (exact / MANY as f64).sqrt(), "{n}: {mean}");
            assert!((variance / exact - 1.0).abs() < 0.03, "{n}: {variance}, expected {exact}");
            assert_eq!(filter.dropped, 0, "only before the next frame");
            if n == 1 {
                let mut drawn = vec![State::default(); MANY];
                let mut own = Prior::new(Arc::new(dynamics));
                let parents = vec![State { x: 10.0, vx: 3.0, ..State::default() }; MANY];
                own.propose(scene, &parents, &mut drawn, &mut vec![0.0; MANY], streams.at(1, Purpose::Predict));
                assert!(drawn == seen.states, "the bits of a frame without dropped ones");
            }
        }
    }
}
