//! THE WORLD COMING IN: frames, where they come from, and what is found in them.

pub mod ahead;
pub mod annotation;
pub mod camera;
pub mod crossings;
pub mod cut;
pub mod decode;
pub mod detect;
pub mod encode;
mod ffmpeg;
pub mod flow;
pub mod folder;
mod ghosts;
mod h264;
pub mod hide;
pub mod idx;
pub mod image;
pub mod map;
mod morphology;
pub mod mot;
pub mod motion;
mod mp4;
pub mod open;
pub mod otb;
pub mod saliency;
pub mod scout;
pub mod spline;
mod sps;
mod stream;
pub mod strokes;
pub mod synthetic;
pub mod video;
pub mod walkers;
pub(crate) mod yuv;

pub use self::ahead::ahead;
pub use self::cut::Cuts;
pub use self::decode::{decode_image, read_image};
pub use self::detect::Detector;
pub use self::encode::{encode_jpeg, encode_png, save_png};
pub use self::flow::Flow;
pub use self::folder::{ImageFolder, image_files};
pub use self::idx::{Digits, Split};
pub use self::image::Image;
pub use self::map::Map;
pub use self::motion::Motion;
pub use self::open::open;
pub use self::saliency::Saliency;
pub use self::scout::Scout;
pub use self::video::VideoFile;
pub use self::walkers::Walkers;

/// One picture of a video.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the source, counted from 0.
    pub index: usize,
    /// Presentation time in seconds from the first frame; a folder of images has 1/30 s a frame.
    pub time: f64,
    /// The pixels.
    pub image: Image,
}

/// A place where something was found, by a detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Where, in pixels.
    pub bbox: crate::geometry::BBox,
    /// How sure the detector is; larger is surer.
    pub score: f64,
}

/// What a tracker sees of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The picture.
    pub frame: &'a Frame,
    /// What a detector found in it; empty without one.
    pub detections: &'a [Detection],
}

/// A source of frames: an iterator that gives an error where the source breaks, and then ends.
///
/// What came before an error is good. `info` is known before the first frame is decoded.
pub trait FrameSource: Iterator<Item = crate::Result<Frame>> + Send {
    /// What is known of the source before it is read.
    fn info(&self) -> &SourceInfo;
}

/// What is known of a source before it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Width of a frame in pixels.
    pub width: usize,
    /// Height of a frame in pixels.
    pub height: usize,
    /// Number of frames, if the source knows it (a container's figure is an estimate).
    pub frames: Option<usize>,
    /// Frames a second.
    pub rate: f64,
    /// How it is read, for people: "image folder", "H.264 (rusty_h264)", "ffmpeg".
    pub reader: String,
}
