//! WHERE is it? `predict` and `select`: the particle filter around the looks.

use super::{Engine, Estimate};
use crate::control::{
    Belief, CHUNK, CameraMotion, DetectionLikelihood, Leap, LocalSearch, Proposal, Redetection, Resampling, normalize,
};
use crate::geometry::{Extent, State};
use crate::scene::{Flow, Scene};
use crate::start::StartSpread;
use foveate_base::rng::Purpose::{Predict, Select};
use foveate_base::rng::Streams;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// The particles, and how they are predicted, weighed by detections, selected and drawn again.
pub struct Filter {
    /// q(xₜ | xₜ₋₁, scene).
    pub(super) proposal: Box<dyn Proposal>,
    /// The selection step.
    pub(super) resampling: Resampling,
    /// p(x₀): how far from the given box the first particles are.
    pub(super) start: StartSpread,
    pub(super) camera_motion: Option<CameraMotion>,
    pub(super) detection_likelihood: Option<DetectionLikelihood>,
    pub(super) redetection: Option<Redetection>,
    pub(super) local_search: Option<LocalSearch>,
    /// xₜ⁽ⁱ⁾ and log wₜ⁽ⁱ⁾, between frames.
    pub(super) particles: Vec<State>,
    pub(super) log_weights: Vec<f64>,
    /// Where nobody looks, they stay behind until somebody does.
    pub(super) waiting: Option<Waiting>,
}

/// Frames that the particles are behind, and what is believed meanwhile.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Waiting {
    pub frames: usize,
    mean: State,
    covariance: [[f64; 6]; 6],
}

impl Filter {
    /// A filter of `n` particles with the usual resampling and first spread.
    ///
    /// Fails where `n` is 0.
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
            particles: vec![State::default(); n],
            log_weights: vec![-(n as f64).ln(); n],
            waiting: None,
        })
    }
    /// The same, with particles put by this proposal.
    pub fn proposing(self, proposal: Box<dyn Proposal>) -> Self {
        Self { proposal, ..self }
    }
    /// The same, selecting by this rule.
    pub fn resampling(self, resampling: Resampling) -> Self {
        Self { resampling, ..self }
    }
    /// The same, with the first particles spread like this.
    pub fn starting(self, start: StartSpread) -> Self {
        Self { start, ..self }
    }
    /// The same; particles move with the camera before they are predicted.
    pub fn compensating(self, camera_motion: Option<CameraMotion>) -> Self {
        Self { camera_motion, ..self }
    }
    /// The same; detections weigh particles: p(detections | xₜ).
    pub fn weighing(self, detection_likelihood: Option<DetectionLikelihood>) -> Self {
        Self { detection_likelihood, ..self }
    }
    /// The same; a lost target is looked for all over the picture.
    pub fn redetecting(self, redetection: Option<Redetection>) -> Self {
        Self { redetection, ..self }
    }

    /// The same; a target that has leapt is looked for around the estimate.
    pub fn searching_around(self, local_search: Option<LocalSearch>) -> Self {
        Self { local_search, ..self }
    }

    /// Whether detections move or weigh particles.
    pub(super) fn uses_detections(&self) -> bool {
        self.detection_likelihood.is_some() || self.proposal.uses_detections()
    }

    /// Draws all particles anew, about a state.
    pub(super) fn spread(&mut self, state: &State, extent: Extent, streams: Streams) {
        self.waiting = None;
        self.start.draw(state, extent, &mut self.particles, streams);
        let even = -(self.particles.len() as f64).ln();
        self.log_weights.fill(even);
    }
}

impl Engine {
    /// Moves the particles, and what else is known of the target, with the picture; before [`Engine::step`] with the picture
    /// it moved to.
    pub fn compensate(&mut self, flow: &Flow, also: &mut State) {
        let filter = &mut self.parts.filter;
        if let Some(camera_motion) = &filter.camera_motion {
            camera_motion.shift(flow, &mut filter.particles);
            // It is one state: there is no share of it.
            CameraMotion { share: 1.0, ..*camera_motion }.shift(flow, std::slice::from_mut(also));
        }
        self.second.iter_mut().for_each(|second| second.compensate(flow, &mut State::default()));
    }

    /// x̃ ~ q(x | x'), and log wₜ₋₁ p/q, which the weights owe for not sampling from p, times what detections say.
    pub(super) fn predict(&mut self, scene: Scene<'_>) {
        self.catch_up();
        let extent = self.target().extent;
        let (f, w) = (&mut self.parts.filter, &mut self.work);
        let n = f.particles.len();
        w.predicted.resize(n, State::default());
        w.log_prior.resize(n, 0.0);
        let streams = self.streams.at(self.frame, Predict);
        f.proposal.propose(scene, &f.particles, &mut w.predicted, &mut w.log_prior, streams);
        w.log_prior.iter_mut().zip(&f.log_weights).for_each(|(prior, carried)| *prior += carried);
        let weigh = |it: &DetectionLikelihood| it.weigh(scene.detections, &w.predicted, extent, &mut w.log_prior);
        w.detected = f.detection_likelihood.as_ref().map_or(0.0, weigh);
    }

    /// Whether a frame without a look needs none of the particles, and so no buffers: nothing is detected, the camera does not move
    /// them, and the motion of many frames has a closed form.
    pub fn waits(&self, detected: bool) -> bool {
        self.leap(detected).is_some()
    }

    /// The motion of such a frame.
    fn leap(&self, detected: bool) -> Option<Leap> {
        let filter = &self.parts.filter;
        filter.proposal.over(1).filter(|_| !detected && filter.camera_motion.is_none())
    }

    /// Mean and covariance after a frame of this motion; the particles stay behind.
    fn wait(&mut self, leap: &Leap) -> (State, [[f64; 6]; 6]) {
        let filter = &mut self.parts.filter;
        let mut waiting = filter.waiting.unwrap_or_else(|| {
            let weights: Vec<f64> = filter.log_weights.iter().map(|w| w.exp()).collect();
            let belief = Belief { states: &filter.particles, weights: &weights };
            Waiting { frames: 0, mean: belief.mean(), covariance: belief.covariance() }
        });
        waiting.frames += 1;
        leap.spread(&mut waiting.mean, &mut waiting.covariance);
        filter.waiting = Some(waiting);
        (waiting.mean, waiting.covariance)
    }

    /// Moves particles that waited to where they are before this frame.
    fn catch_up(&mut self) {
        let filter = &mut self.parts.filter;
        let Some(waiting) = filter.waiting.take() else { return };
        let leap = filter.proposal.over(waiting.frames).expect("it had one when they began to wait");
        // Nothing was drawn in the frame before: they waited.
        let streams = self.streams.at(self.frame - 1, Predict);
        for (i, particles) in filter.particles.chunks_mut(CHUNK).enumerate() {
            leap.draw(particles, &mut streams.rng(i as u64));
        }
    }

    /// A frame without a look: the belief is predicted, detections weigh it, and it is selected from. Mean and covariance.
    pub fn coast(&mut self, scene: Scene<'_>) -> (State, [[f64; 6]; 6]) {
        self.frame += 1;
        if let Some(leap) = self.leap(!scene.detections.is_empty()) {
            return self.wait(&leap);
        }
        self.predict(scene);
        let w = &mut self.work;
        w.weights.resize(w.log_prior.len(), 0.0);
        normalize(&w.log_prior, &mut w.weights);
        let estimate = self.estimate();
        self.select(&estimate);
        (estimate.mean, estimate.covariance)
    }

    /// Children of heavy particles start the next frame, where the effective sample size asks for it; else all go on with
    /// their weights.
    pub(super) fn select(&mut self, estimate: &Estimate) {
        let (f, w) = (&mut self.parts.filter, &mut self.work);
        let n = f.particles.len();
        w.ancestors.resize(n, 0);
        if f.resampling.is_due(estimate.ess, n) {
            let rng = &mut self.streams.at(self.frame, Select).rng(0);
            f.resampling.select(&w.weights, &mut w.ancestors, rng);
            f.log_weights.fill(-(n as f64).ln());
        } else {
            w.ancestors.iter_mut().enumerate().for_each(|(i, a)| *a = i);
            f.log_weights.iter_mut().zip(&w.weights).for_each(|(carried, weight)| *carried = weight.ln());
        }
        f.particles.iter_mut().zip(&w.ancestors).for_each(|(particle, a)| *particle = w.predicted[*a]);
    }
}
