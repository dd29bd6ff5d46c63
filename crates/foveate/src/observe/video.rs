//! annotated.mp4: the run as a video, drawn over.

use std::path::PathBuf;

use super::{Annotator, Mp4Writer, Observer, RunInfo};
use crate::Result;
use crate::geometry::BBox;
use crate::scene::{Frame, Image};
use crate::step::Step;

/// Writes every frame with box, particles and gaze drawn over it.
pub struct AnnotatedVideo {
    path: PathBuf,
    rate: f64,
    annotator: Annotator,
    writer: Option<Mp4Writer>,
}

impl AnnotatedVideo {
    /// A video at `path`; the file begins with the first frame, whose size it takes.
    pub fn new(path: impl Into<PathBuf>, info: &RunInfo) -> Self {
        Self { path: path.into(), rate: info.rate, annotator: Annotator::new(info), writer: None }
    }

    fn push(&mut self, image: &Image) -> Result<()> {
        if self.writer.is_none() {
            self.writer = Some(Mp4Writer::create(&self.path, image.width(), image.height(), self.rate)?);
        }
        self.writer.as_mut().expect("made above").push(image)
    }
}

impl Observer for AnnotatedVideo {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        let image = self.annotator.start(frame, bbox);
        self.push(&image)
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        let image = self.annotator.annotate(step);
        self.push(&image)
    }
    fn finish(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), Mp4Writer::finish)
    }
}
