//! annotated.mp4: the annotated frames as a video, of one target or of many.

use std::path::{Path, PathBuf};

use crate::{Annotator, MultiAnnotator, MultiObserver, Observer, RunInfo};
use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::multi::TrackedTarget;
use foveate_core::scene::Image;
use foveate_core::step::Step;
use foveate_video::{Frame, Mp4Writer};

/// Frames a second where the source does not say.
const USUAL_RATE: f64 = 30.0;

/// A video in the making; its size follows from the first picture.
struct Video {
    path: PathBuf,
    rate: f64,
    bit_rate: Option<f64>,
    writer: Option<Mp4Writer>,
}

impl Video {
    fn create(path: PathBuf, info: &RunInfo) -> Result<Self> {
        writable(&path)?;
        let rate = if info.rate.is_finite() && info.rate > 0.0 { info.rate } else { USUAL_RATE };
        Ok(Self { path, rate, bit_rate: info.bit_rate, writer: None })
    }
    fn push(&mut self, picture: &Image) -> Result<()> {
        if self.writer.is_none() {
            let writer = Mp4Writer::create(&self.path, picture.width(), picture.height(), self.rate)?;
            self.writer = Some(writer.aiming_at(self.bit_rate));
        }
        self.writer.as_mut().expect("made above").push(picture)
    }
    fn finish(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), Mp4Writer::finish)
    }
}

/// Fails where the folder of a file is not there.
pub(super) fn writable(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref());
    std::fs::metadata(folder).map(drop).map_err(Error::io(path, "cannot write"))
}

/// annotated.mp4 of one target: every frame as [`Annotator`] draws it.
pub struct Film {
    video: Video,
    annotator: Annotator,
}

impl Film {
    /// Will write `path`, an MP4 file with H.264 at the source's frame rate and about its bit rate.
    ///
    /// # Errors
    /// Its folder is not there.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        Ok(Self { video: Video::create(path.into(), info)?, annotator: Annotator::new(info) })
    }
}

impl Observer for Film {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.video.push(&self.annotator.start(frame, bbox))
    }
    fn observe(&mut self, frame: &Frame, step: &Step<'_>) -> Result<()> {
        self.video.push(&self.annotator.annotate(frame, step))
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}

/// annotated.mp4 of many targets: every frame as [`MultiAnnotator`] draws it.
pub struct MultiFilm {
    video: Video,
    annotator: MultiAnnotator,
}

impl MultiFilm {
    /// Will write `path`, an MP4 file with H.264 at the source's frame rate and about its bit rate.
    ///
    /// # Errors
    /// Its folder is not there.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        Ok(Self { video: Video::create(path.into(), info)?, annotator: MultiAnnotator::default() })
    }
}

impl MultiObserver for MultiFilm {
    fn observe(&mut self, frame: &Frame, targets: &[TrackedTarget]) -> Result<()> {
        self.video.push(&self.annotator.annotate(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}
