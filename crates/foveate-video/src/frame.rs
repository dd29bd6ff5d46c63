//! Frames and their sources.

use crate::Remarks;
use crate::child::Interrupt;
use foveate_base::Result;
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

/// One picture of a video.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the source, counted from 0.
    pub index: usize,
    /// Presentation time in seconds from the first frame, by the time stamps of the file; a folder of images has 1/30 s a frame.
    pub time: f64,
    /// The pixels: square ones, as players show them, whatever the file stores.
    pub image: Image,
}

/// A source of frames: an iterator that returns an error if the source breaks, and then ends.
///
/// What came before an error is good. `info` is known before the first frame is decoded.
pub trait FrameSource: Iterator<Item = Result<Frame>> + Send {
    /// The facts of the source before it is read.
    fn info(&self) -> &SourceInfo;
    /// Passes over the next frames; at the end of the source over fewer.
    ///
    /// # Errors
    /// Fails if the source breaks.
    fn pass_over(&mut self, count: usize) -> Result<()> {
        for _ in 0..count {
            match self.next() {
                Some(frame) => drop(frame?),
                None => break,
            }
        }
        Ok(())
    }
    /// A handle that ends a blocking read from another thread; `None` if reads do not block for long.
    fn interrupt(&self) -> Option<Interrupt> {
        None
    }
    /// Remarks on the video for people, filled while frames are read.
    fn remarks(&self) -> Remarks {
        Remarks::default()
    }
}

/// The facts of a source before it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Width of a frame in pixels.
    pub width: usize,
    /// Height of a frame in pixels.
    pub height: usize,
    /// Number of frames, if known; that of a container is an estimate.
    pub frames: Option<usize>,
    /// Frames a second; 0 if it is unknown: a stream or a camera has only the times of its frames.
    pub rate: f64,
    /// How it is read, for people: "image folder", "H.264 (built-in decoder)", "ffmpeg".
    pub reader: String,
}

impl SourceInfo {
    /// Width and height of a frame in pixels.
    pub fn size(&self) -> Size {
        Size { width: self.width, height: self.height }
    }
    /// The exact number of frames, if known. For files that ffmpeg reads only an estimate from length and rate
    /// exists.
    pub fn exact_frames(&self) -> Option<usize> {
        self.frames.filter(|_| self.reader != FFMPEG)
    }
}

/// The reader that only estimates the number of frames.
pub(crate) const FFMPEG: &str = "ffmpeg";
