//! One target among several: its filter, its detection, the shape of its box.

use super::edge;
use super::settings::Settings;
use super::tracked_target::{Phase, TrackedTarget};
use crate::engine::Engine;
use crate::geometry::{BBox, State};
use crate::scene::{Detection, Image, Scene};

/// One target.
pub(super) struct Target {
    pub engine: Engine,
    pub track: TrackedTarget,
    /// Frames in a row it was lost, and without a detection.
    pub lost: usize,
    pub unseen: usize,
    pub terminated: usize,
    /// Logarithm of its box's width over height, less that of its template's.
    pub shape: f64,
}

impl Target {
    /// Where it is expected in the next frame.
    pub fn next(&self) -> State {
        let s = self.track.state;
        State { x: s.x + s.vx, y: s.y + s.vy, ..s }
    }

    /// The same box in the target's present shape.
    pub fn shaped(&self, b: BBox) -> BBox {
        let ((x, y), wider) = (b.centre(), (self.shape / 2.0).exp());
        BBox::around(x, y, b.w * wider, b.h / wider)
    }

    /// A box that was given, or found.
    pub fn begin(&mut self, born: usize, bbox: BBox, phase: Phase) {
        let extent = self.engine.extent().expect("it was started");
        let state = self.engine.state_at(&bbox);
        let TrackedTarget { id, gaze, class, .. } = self.track;
        self.track = TrackedTarget { born, phase, bbox, state, extent, gaze, class, ..TrackedTarget::unknown(id) };
        (self.lost, self.unseen, self.shape) = (0, 0, (bbox.w / bbox.h / extent.half_w * extent.half_h).ln());
    }

    pub fn step(&mut self, image: &Image, s: &Settings, detecting: bool) {
        let detections = self.track.detection.as_slice();
        let step = self.engine.step(Scene { image, detections });
        let (estimate, covariance, deficit, class) =
            (step.estimate, step.covariance, step.consistency.deficit, step.class());
        let (gaze, bbox, lost) = (step.plan.chosen(), step.bbox(), step.is_lost() && detections.is_empty());
        self.unseen = if detections.is_empty() { self.unseen + 1 } else { 0 };
        self.lost = if lost { self.lost + 1 } else { 0 };
        let guessed = if detecting { self.unseen > s.termination.guess } else { lost };
        let phase = match guessed {
            true => Phase::Lost,
            false if self.track.visible < s.occlusion.hidden => Phase::Occluded,
            false => Phase::Tracked,
        };
        let extent = self.engine.extent().expect("it was started");
        self.track = TrackedTarget { phase, state: estimate, covariance, extent, gaze, deficit, class, ..self.track };
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            self.shape += s.shape * ((b.w / b.h / extent.half_w * extent.half_h).ln() - self.shape);
        }
        self.track.bbox = self.shaped(bbox);
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            let comes_in = edge::comes_in(&self.track.bbox, &b, image, s.initiation.most);
            if comes_in {
                self.track.bbox = b;
            }
            if comes_in || (deficit > s.renew && self.track.visible >= 1.0) {
                self.update_template(image);
            }
        }
    }

    /// Takes a new template where it is, in its present shape; the old one stays where the box is no good.
    fn update_template(&mut self, image: &Image) {
        let State { vx, vy, .. } = self.track.state;
        if self.engine.update_template(image, &self.track.bbox, (vx, vy)).is_ok() {
            self.track.extent = self.engine.extent().expect("it was started");
            (self.track.state.log_scale, self.shape, self.track.deficit) = (0.0, 0.0, 0.0);
        }
    }
}
