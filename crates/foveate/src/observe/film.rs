//! annotated.mp4: the annotated frames as a video.

use std::path::{Path, PathBuf};

use super::{Annotator, Mp4Writer, Observer, RunInfo};
use crate::geometry::BBox;
use crate::scene::{Frame, Image};
use crate::step::Step;
use crate::{Error, Result};

/// Frames a second where the source does not say.
pub(super) const USUAL_RATE: f64 = 30.0;

/// Draws each frame and appends it to a video.
pub struct Film {
    path: PathBuf,
    rate: f64,
    annotator: Annotator,
    writer: Option<Mp4Writer>,
}

impl Film {
    /// Will write `path`. Fails where its folder is not there; its size follows from the first frame.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        let path = path.into();
        writable(&path)?;
        let rate = if info.rate.is_finite() && info.rate > 0.0 { info.rate } else { USUAL_RATE };
        Ok(Self { path, rate, annotator: Annotator::new(info), writer: None })
    }

    fn push(&mut self, picture: &Image) -> Result<()> {
        if self.writer.is_none() {
            self.writer = Some(Mp4Writer::create(&self.path, picture.width(), picture.height(), self.rate)?);
        }
        self.writer.as_mut().expect("made above").push(picture)
    }
}

/// Fails where the folder of a file is not there.
pub(super) fn writable(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref());
    std::fs::metadata(folder).map(drop).map_err(Error::io(path, "cannot write"))
}

impl Observer for Film {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        let picture = self.annotator.start(frame, bbox);
        self.push(&picture)
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        let picture = self.annotator.annotate(step);
        self.push(&picture)
    }
    fn finish(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), Mp4Writer::finish)
    }
}
