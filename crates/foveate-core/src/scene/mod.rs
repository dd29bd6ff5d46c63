//! THE WORLD COMING IN: pictures and detections.

pub mod camera;
pub mod cut;
pub mod detect;
pub mod flow;
mod ghosts;
pub mod image;
pub mod map;
pub mod meter;
mod morphology;
pub mod motion;
pub(crate) mod moving_part;
pub mod object_detector;
pub mod preprocessor;
pub mod saliency;
pub mod sensor;
pub mod still;
pub mod walkers;

pub use self::cut::Cuts;
pub use self::detect::{Detection, Detector};
pub use self::flow::Flow;
pub use self::image::{Image, Pixels};
pub use self::map::Map;
pub use self::meter::Meter;
pub use self::motion::Motion;
#[cfg(feature = "onnx")]
pub use self::object_detector::ObjectDetector;
pub(crate) use self::preprocessor::World;
pub use self::preprocessor::{Preprocessor, Scene};
pub use self::saliency::Saliency;
pub use self::sensor::{Regions, Sensor, SensorSettings};
pub use self::still::StillCamera;
pub use self::walkers::Walkers;
