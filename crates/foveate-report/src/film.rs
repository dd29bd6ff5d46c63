//! annotated.mp4: the annotated frames as a video, of one target or of many.

use std::path::{Path, PathBuf};

use crate::draw::{Drawing, text_width};
use crate::run::touching;
use crate::{Annotator, Baseline, MultiAnnotator, MultiObserver, Observer, RunInfo};
use foveate_base::files::folder_of;
use foveate_base::sink::{Memory, Sink};
use foveate_base::{Error, Result};
use foveate_core::Tracker;
use foveate_core::geometry::{BBox, State};
use foveate_core::multi::TrackedTarget;
use foveate_core::scene::Image;
use foveate_core::step::Step;
use foveate_video::{Frame, Mp4Writer};

/// Frames a second where the source does not say.
const USUAL_RATE: f64 = 30.0;

/// A video in the making; its size follows from the first picture.
struct Video {
    path: PathBuf,
    /// In the place of a file.
    memory: Option<Memory>,
    rate: f64,
    bit_rate: Option<f64>,
    writer: Option<Mp4Writer>,
}

impl Video {
    fn create(path: PathBuf, info: &RunInfo) -> Result<Self> {
        writable(&path)?;
        Ok(Self::of(path, None, info))
    }
    fn of(path: PathBuf, memory: Option<Memory>, info: &RunInfo) -> Self {
        let rate = if info.rate.is_finite() && info.rate > 0.0 { info.rate } else { USUAL_RATE };
        Self { path, memory, rate, bit_rate: info.bit_rate, writer: None }
    }
    /// A picture, and when its frame is shown in the source, in seconds.
    fn push(&mut self, picture: &Image, time: f64) -> Result<()> {
        if self.writer.is_none() {
            let (width, height, rate) = (picture.width(), picture.height(), self.rate);
            let writer = match &self.memory {
                Some(memory) => {
                    let sink = Sink::memory(&self.path, memory.clone());
                    Mp4Writer::to(sink, &self.path, width, height, rate)?
                }
                None => Mp4Writer::create(&self.path, width, height, rate)?,
            };
            self.writer = Some(writer.aiming_at(self.bit_rate));
        }
        self.writer.as_mut().expect("made above").push(picture, time)
    }
    fn finish(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), Mp4Writer::finish)
    }
}

/// Fails where the folder of a file is not there.
pub(super) fn writable(path: &Path) -> Result<()> {
    std::fs::metadata(folder_of(path)).map(drop).map_err(Error::io(path, "cannot write"))
}

/// annotated.mp4 of one target: every frame as [`Annotator`] draws it.
pub struct Film {
    video: Video,
    annotator: Annotator,
}

impl Film {
    /// Will write `path`, an MP4 file with H.264 at the source's times and about its bit rate.
    ///
    /// # Errors
    /// Its folder is not there.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        Ok(Self { video: Video::create(path.into(), info)?, annotator: Annotator::new(info) })
    }

    /// The same into memory; `name` stands for the file in errors.
    pub fn to(memory: Memory, name: impl Into<PathBuf>, info: &RunInfo) -> Self {
        Self { video: Video::of(name.into(), Some(memory), info), annotator: Annotator::new(info) }
    }
}

impl Observer for Film {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.video.push(&self.annotator.start(frame, bbox), frame.time)
    }
    fn observe(&mut self, frame: &Frame, step: &Step<'_>) -> Result<()> {
        self.video.push(&self.annotator.annotate(frame, step), frame.time)
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}

/// annotated.mp4 of two trackers on the same frames: the run's own on the left, another, which it drives, on the right.
pub struct SideBySide {
    video: Video,
    annotators: [Annotator; 2],
    name: String,
    other: Tracker,
    baseline: Baseline,
    truth: Vec<Option<BBox>>,
}

impl SideBySide {
    /// Will write `path`, as [`Film::create`] does. The other's track goes to `baseline`, whose name is written above the right half, as
    /// `name` is above the left one.
    ///
    /// # Errors
    /// Its folder is not there.
    pub fn create(
        path: impl Into<PathBuf>,
        info: &RunInfo,
        name: String,
        other: Tracker,
        baseline: Baseline,
    ) -> Result<Self> {
        let (video, annotators) = (Video::create(path.into(), info)?, [Annotator::new(info), Annotator::new(info)]);
        Ok(Self { video, annotators, name, other, baseline, truth: info.truth.clone() })
    }

    /// Both halves under their names; `said` is written at the right end of each name's line.
    fn push(&mut self, [left, right]: [Image; 2], said: [String; 2], time: f64) -> Result<()> {
        // Even, as H.264 has pixels in pairs.
        let (strip, gap) = (left.height() / 26 * 2, left.height() / 104 * 2);
        let mut page = Drawing::new(left.width() + gap + right.width(), strip + left.height(), [18, 21, 26]);
        let (pad, size) = (0.32 * strip as f64, 0.36 * strip as f64);
        let mut at = 0;
        for ((half, name), said) in [left, right].iter().zip([&*self.name, self.baseline.name()]).zip(said) {
            page.paste(half, at, strip, half.width(), half.height());
            page.text((at as f64 + pad, pad), name, size, [236, 238, 240]);
            let end = (at + half.width()) as f64 - pad;
            page.text((end - text_width(&said, size), pad), &said, size, [236, 238, 240]);
            at += half.width() + gap;
        }
        self.video.push(&page.into_image(), time)
    }

    /// How far the centre is from the true one.
    fn error(&self, frame: &Frame, estimate: &State) -> String {
        let off = |b: &BBox| (b.centre().0 - estimate.x).hypot(b.centre().1 - estimate.y);
        let truth = self.truth.get(frame.index).and_then(Option::as_ref);
        truth.map(|b| format!("error {:.1} px", off(b))).unwrap_or_default()
    }
}

impl Observer for SideBySide {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.other.init(&frame.image, *bbox)?;
        self.baseline.add(*bbox, 0);
        let halves = self.annotators.each_mut().map(|annotator| annotator.start(frame, bbox));
        self.push(halves, Default::default(), frame.time)
    }
    fn observe(&mut self, frame: &Frame, step: &Step<'_>) -> Result<()> {
        let ours = (self.annotators[0].annotate(frame, step), self.error(frame, &step.estimate));
        let seen = self.other.update(&frame.image)?;
        self.baseline.add(touching(&seen.bbox, &frame.image), seen.step.values);
        let (picture, estimate) = (self.annotators[1].annotate(frame, &seen.step), seen.step.estimate);
        let error = self.error(frame, &estimate);
        self.push([ours.0, picture], [ours.1, error], frame.time)
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
    /// Will write `path`, an MP4 file with H.264 at the source's times and about its bit rate.
    ///
    /// # Errors
    /// Its folder is not there.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        Ok(Self { video: Video::create(path.into(), info)?, annotator: MultiAnnotator::default() })
    }
}

impl MultiObserver for MultiFilm {
    fn observe(&mut self, frame: &Frame, targets: &[TrackedTarget]) -> Result<()> {
        self.video.push(&self.annotator.annotate(frame, targets), frame.time)
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}
