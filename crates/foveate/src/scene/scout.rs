//! What a tracker is told of a frame beside its pixels: detections, and how the picture moved.

use super::{Detection, Detector, Flow, Frame, Scene};

/// Runs a detector and the flow, once a frame for however many targets. Without either it costs nothing.
#[derive(Default)]
pub struct Scout {
    detector: Option<Box<dyn Detector>>,
    flow: Option<Flow>,
    found: Vec<Detection>,
}

impl Scout {
    /// Looks for candidates with `detector`, and for motion with a flow that ends at the level `flow`: 0 the picture
    /// itself, 1 half of it.
    pub fn new(detector: Option<Box<dyn Detector>>, flow: Option<usize>) -> Self {
        Self { detector, flow: flow.map(Flow::down_to), found: vec![] }
    }
    /// Looks at the next frame of the video. Detectors and flow compare frames, so that it has to see each.
    pub fn look(&mut self, frame: &Frame) {
        if let Some(detector) = &mut self.detector {
            detector.detect(frame, &mut self.found);
        }
        if let Some(flow) = &mut self.flow {
            flow.look(&frame.image);
        }
    }
    /// What a tracker sees of the frame that was looked at last.
    pub fn scene<'a>(&'a self, frame: &'a Frame) -> Scene<'a> {
        Scene { frame, detections: &self.found }
    }
    /// The flow to the frame that was looked at last, where it was asked for.
    pub fn flow(&self) -> Option<&Flow> {
        self.flow.as_ref()
    }
}
