//! Frames without a look, and the compensation of camera motion between looks.

use super::{Engine, Record};
use crate::control::CameraMotion;
use crate::geometry::{Covariance, State};
use crate::scene::{Flow, Scene};
use foveate_base::rng::Purpose::Select;

impl Engine {
    /// Moves the particles with the picture. Call it before [`Engine::step`] with the new picture.
    pub(crate) fn compensate(&mut self, flow: &Flow) {
        self.parts.filter.compensate(flow);
    }

    /// Moves a state of the target with the picture: unlike a particle, it always moves.
    pub(crate) fn shift(&self, flow: &Flow, state: &mut State) {
        if let Some(camera_motion) = &self.parts.filter.camera_motion {
            CameraMotion { share: 1.0, ..*camera_motion }.shift(flow, std::slice::from_mut(state));
        }
    }

    /// Returns whether a frame without a look needs none of the particles, and so no buffers.
    pub(crate) fn waits(&self) -> bool {
        self.parts.filter.leap().is_some()
    }

    /// Runs a frame without a look: predicts the belief, weighs it by detections, and resamples. Returns mean and covariance.
    pub(crate) fn coast(&mut self, scene: Scene<'_>) -> (State, Covariance) {
        self.frame += 1;
        let (t, extent, filter) = (self.frame, self.target().extent, &mut self.parts.filter);
        if let Some(leap) = filter.leap() {
            return filter.wait(&leap, scene.detections.first(), extent);
        }
        let Record { belief, ancestors, .. } = &mut self.record;
        *belief = filter.predict(scene, extent, None, (self.streams, t), std::mem::take(belief));
        belief.weigh_without_looks();
        let estimate = belief.estimate();
        *ancestors = filter.select(belief, &estimate, self.streams.at(t, Select), std::mem::take(ancestors));
        (estimate.mean, estimate.covariance)
    }
}
