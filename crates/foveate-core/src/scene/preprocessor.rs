//! The inputs of a tracker beside pixels: detections and the motion of the picture.

use super::{Detection, Detector, Flow, Image};

/// What a tracker sees of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The picture.
    pub image: &'a Image,
    /// What a detector found in it; empty without one.
    pub detections: &'a [Detection],
}

/// Runs a detector and the flow, once a frame for however many targets. Without either it costs nothing.
#[derive(Default)]
pub struct Preprocessor {
    detector: Option<Box<dyn Detector>>,
    flow: Option<Flow>,
    found: Vec<Detection>,
}

impl Preprocessor {
    /// Looks for candidates with `detector`, and for motion with a flow that ends at the level `flow`: 0 the picture
    /// itself, 1 half of it.
    pub fn new(detector: Option<Box<dyn Detector>>, flow: Option<usize>) -> Self {
        Self { detector, flow: flow.map(Flow::down_to), found: vec![] }
    }
    /// Looks at the next picture. Detectors and flow compare pictures, so that it has to see each.
    pub fn look(&mut self, image: &Image) {
        self.look_or_watch(image, true);
    }
    /// The same, but the detector runs only if `asks`. Otherwise there are no detections, and the detector's state is
    /// unchanged.
    pub fn look_or_watch(&mut self, image: &Image, asks: bool) {
        self.found.clear();
        if let Some(detector) = self.detector.as_mut().filter(|_| asks) {
            detector.detect(image, &mut self.found);
        }
        if let Some(flow) = &mut self.flow {
            flow.look(image);
        }
    }
    /// Whether it reads whole pictures: there is a detector or a flow.
    pub fn looks_everywhere(&self) -> bool {
        self.detector.is_some() || self.flow.is_some()
    }
    /// What was found in the picture that was looked at last.
    pub fn detections(&self) -> &[Detection] {
        &self.found
    }
    /// What a tracker sees of the picture that was looked at last.
    pub fn scene<'a>(&'a self, image: &'a Image) -> Scene<'a> {
        Scene { image, detections: &self.found }
    }
    /// The flow to the last picture, if it was computed.
    pub fn flow(&self) -> Option<&Flow> {
        self.flow.as_ref()
    }
}
