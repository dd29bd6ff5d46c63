//! Many targets as pictures: annotated.mp4, and a film strip of chosen frames.

use std::path::PathBuf;

use super::crowd::CrowdAnnotator;
use super::draw::{Drawing, text_width};
use super::film::{USUAL_RATE, writable};
use super::many::{ManyObserver, Seen};
use super::{Mp4Writer, RunInfo};
use crate::scene::{Frame, Image, encode_png};
use crate::{Error, Result, files};

/// annotated.mp4: every frame with all targets.
pub struct CrowdFilm {
    path: PathBuf,
    rate: f64,
    annotator: CrowdAnnotator,
    writer: Option<Mp4Writer>,
}

impl CrowdFilm {
    /// Will write `path`. Fails where its folder is not there; its size follows from the first frame.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        let path = path.into();
        writable(&path)?;
        let rate = if info.rate.is_finite() && info.rate > 0.0 { info.rate } else { USUAL_RATE };
        Ok(Self { path, rate, annotator: CrowdAnnotator::default(), writer: None })
    }
}

impl ManyObserver for CrowdFilm {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        let picture = self.annotator.annotate(frame, targets);
        if self.writer.is_none() {
            self.writer = Some(Mp4Writer::create(&self.path, picture.width(), picture.height(), self.rate)?);
        }
        self.writer.as_mut().expect("made above").push(&picture)
    }
    fn finish(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), Mp4Writer::finish)
    }
}

/// A figure of several frames with all targets: the paper's figure of many targets.
pub struct CrowdStrip {
    path: PathBuf,
    title: String,
    frames: Vec<usize>,
    columns: usize,
    annotator: CrowdAnnotator,
    pictures: Vec<Image>,
    finished: bool,
}

/// Width of a picture of the strip, pixels.
const WIDTH: usize = 480;
/// Space between pictures, pixels.
const GAP: usize = 8;

impl CrowdStrip {
    /// Will write the `frames` (from 0) to `path`, a PNG, in rows of `columns` below a title. Fails where its folder is not
    /// there.
    pub fn create(path: impl Into<PathBuf>, title: &str, frames: Vec<usize>, columns: usize) -> Result<Self> {
        let path = path.into();
        writable(&path)?;
        let (annotator, columns) = (CrowdAnnotator::default(), columns.max(1));
        Ok(Self { path, title: title.into(), frames, columns, annotator, pictures: vec![], finished: false })
    }

    fn picture(&self) -> Option<Image> {
        let first = self.pictures.first()?;
        let height = (WIDTH * first.height()).div_ceil(first.width());
        let columns = self.columns.min(self.pictures.len());
        let rows = self.pictures.len().div_ceil(columns);
        let (size, head) = (13.0, 40);
        let wide = (columns * (WIDTH + GAP) + GAP).max(text_width(&self.title, size) as usize + 2 * GAP);
        let mut page = Drawing::new(wide, head + rows * (height + GAP), [255; 3]);
        page.text((GAP as f64, 13.0), &self.title, size, [26, 30, 34]);
        for (i, picture) in self.pictures.iter().enumerate() {
            let (left, top) = (GAP + i % columns * (WIDTH + GAP), head + i / columns * (height + GAP));
            page.paste(&smaller(picture, WIDTH, height), left, top, WIDTH, height);
        }
        Some(page.into_image())
    }
}

impl ManyObserver for CrowdStrip {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        if self.frames.contains(&frame.index) {
            self.pictures.push(self.annotator.annotate(frame, targets));
        } else {
            self.annotator.walk(targets);
        }
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        if std::mem::replace(&mut self.finished, true) {
            return Ok(());
        }
        let picture = self.picture().ok_or_else(|| {
            Error::Invalid(format!("{}: none of the frames to be shown was there", self.path.display()))
        })?;
        files::write(&self.path, &encode_png(&picture))
    }
}

/// A picture at another size: means where it shrinks, the nearest pixel where it grows.
pub(super) fn smaller(image: &Image, width: usize, height: usize) -> Image {
    if width <= image.width() && height <= image.height() {
        return super::report::shrunk(image, width, height);
    }
    let mut page = Drawing::new(width, height, [0; 3]);
    page.paste(image, 0, 0, width, height);
    page.into_image()
}

#[cfg(test)]
mod tests {
    use super::super::crowd::tests::{frame, seen};
    use super::super::many::Phase;
    use super::*;

    #[test]
    fn film_and_strip_are_whole_or_not_there() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (mp4, png) = (dir.path().join("a.mp4"), dir.path().join("a.png"));
        let mut all: Vec<Box<dyn ManyObserver>> = vec![
            Box::new(CrowdFilm::create(&mp4, &RunInfo::default()).expect("a writable folder")),
            Box::new(CrowdStrip::create(&png, "two of four", vec![0, 3], 4).expect("a writable folder")),
        ];
        for t in 0..4 {
            let targets = [seen(1, 20.0 + t as f64, Phase::Followed), seen(2, 90.0, Phase::Hidden)];
            all.observe(&frame(t), &targets[..1 + t % 2]).expect("drawn");
        }
        assert!(!mp4.exists() && !png.exists());
        all.finish().expect("written");
        let strip = crate::scene::read_image(&png).expect("a PNG");
        assert_eq!((strip.width(), strip.height()), (2 * 488 + 8, 40 + 240 + 8));
        assert_eq!(crate::scene::open(&mp4).expect("a video").count(), 4);
        assert!(CrowdStrip::create(dir.path().join("none/a.png"), "", vec![0], 1).is_err());
        let empty = CrowdStrip::create(dir.path().join("b.png"), "", vec![9], 1).expect("a writable folder").finish();
        assert!(empty.expect_err("no frame 9").to_string().contains("none of the frames"));
    }
}
