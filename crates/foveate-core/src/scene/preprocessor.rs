//! The inputs of a tracker beside pixels: detections and the motion of the picture.

use super::{Detection, Detector, Flow, Image, Regions, Sensor};
use crate::geometry::{Extent, Gaze, State};
use foveate_base::Result;

/// The input of a tracker in one frame.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The picture.
    pub image: &'a Image,
    /// The detections in it; empty without a detector.
    pub detections: &'a [Detection],
}

/// Where the picture of a step comes from: it is whole from the start, or a sensor reads parts of it once it is known where to look.
pub(crate) enum World<'a, 's> {
    /// A picture in memory.
    Picture(Scene<'a>),
    /// A sensor, which has read its overview of the picture.
    Sensor {
        /// Reads the parts.
        sensor: &'a mut Sensor,
        /// Serves them.
        source: &'s dyn Regions,
        /// The detections in the overview.
        detections: &'a [Detection],
    },
}

impl<'a> World<'a, '_> {
    /// The frame before the look: of a sensor's picture only the overview.
    pub(crate) fn scene(&self) -> Scene<'_> {
        match self {
            Self::Picture(scene) => *scene,
            Self::Sensor { sensor, detections, .. } => Scene { image: sensor.seen(), detections },
        }
    }

    /// The frame for looks at a target under these gazes, and how many values a sensor read of it.
    ///
    /// # Errors
    /// If the source of a sensor cannot be read.
    pub(crate) fn read(self, expected: &State, extent: Extent, gazes: &[Gaze]) -> Result<(Scene<'a>, Option<usize>)> {
        match self {
            Self::Picture(scene) => Ok((scene, None)),
            Self::Sensor { sensor, source, detections } => {
                sensor.look(source, expected, extent, gazes)?;
                let sensor = &*sensor;
                Ok((Scene { image: sensor.seen(), detections }, Some(sensor.values())))
            }
        }
    }
}

/// Runs a detector and the flow, once a frame for however many targets. Without either it costs nothing.
#[derive(Default)]
pub struct Preprocessor {
    detector: Option<Box<dyn Detector>>,
    flow: Option<Flow>,
    found: Vec<Detection>,
}

foveate_base::opaque_debug!(Preprocessor);

impl Preprocessor {
    /// Looks for candidates with `detector`, and for motion with a flow that ends at the level `flow`: 0 the picture
    /// itself, 1 half of it.
    pub fn new(detector: Option<Box<dyn Detector>>, flow: Option<usize>) -> Self {
        Self { detector, flow: flow.map(Flow::down_to), found: vec![] }
    }
    /// Looks at the next picture. Detectors and flow compare pictures, so each picture must be given.
    pub fn look(&mut self, image: &Image) {
        self.look_or_watch(image, true);
    }
    /// The same, but the detector runs only if `detects`. Otherwise there are no detections, and the detector's state is
    /// unchanged.
    pub fn look_or_watch(&mut self, image: &Image, detects: bool) {
        self.found.clear();
        if let Some(detector) = self.detector.as_mut().filter(|_| detects) {
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
    /// The detections of the last picture.
    pub fn detections(&self) -> &[Detection] {
        &self.found
    }
    /// Returns the input of a tracker: the last picture with its detections.
    pub fn scene<'a>(&'a self, image: &'a Image) -> Scene<'a> {
        Scene { image, detections: &self.found }
    }
    /// The flow to the last picture, if it was computed.
    pub fn flow(&self) -> Option<&Flow> {
        self.flow.as_ref()
    }
}
