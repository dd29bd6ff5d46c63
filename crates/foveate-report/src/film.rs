//! annotated.mp4: the annotated frames as a video, of one target or of many.

use std::path::{Path, PathBuf};

use crate::draw::{Drawing, text_width};
use crate::run::touching;
use crate::{Annotator, Baseline, MultiAnnotator, Observer, RunInfo};
use foveate_base::files::folder_of;
use foveate_base::sink::{Memory, Sink};
use foveate_base::{Error, Result};
use foveate_core::Seen;
use foveate_core::Tracker;
use foveate_core::geometry::{BBox, State};
use foveate_core::scene::Image;
use foveate_video::{Frame, Mp4Writer};

/// Frame rate if the source has none, frames per second.
const USUAL_RATE: f64 = 30.0;

/// A video being written; the first picture determines its size.
#[derive(Debug)]
struct Video {
    path: PathBuf,
    /// Set if the video is written to memory instead of a file.
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
    /// Adds a picture and the time of its frame in the source, in seconds.
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

/// Fails if the folder of a file does not exist.
pub(super) fn writable(path: &Path) -> Result<()> {
    std::fs::metadata(folder_of(path)).map(drop).map_err(Error::io(path, "cannot write"))
}

/// Draws a frame with its targets.
type Draw = Box<dyn FnMut(&Frame, &[Seen<'_>]) -> Image + Send>;

/// annotated.mp4: every frame as an annotator draws it, with the source's times and approximately its bit rate.
pub struct Film {
    video: Video,
    draw: Draw,
}

foveate_base::opaque_debug!(Film);

impl Film {
    /// Creates an observer that writes `path`, an MP4 file with H.264, of a run with one target.
    ///
    /// # Errors
    /// Its folder does not exist.
    pub fn create(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        Ok(Self { video: Video::create(path.into(), info)?, draw: Self::one(info) })
    }

    /// Creates an observer that writes `path`, an MP4 file with H.264, of a run with many targets.
    ///
    /// # Errors
    /// Its folder does not exist.
    pub fn of_many(path: impl Into<PathBuf>, info: &RunInfo) -> Result<Self> {
        let mut annotator = MultiAnnotator::default();
        let draw = Box::new(move |frame: &Frame, targets: &[Seen<'_>]| annotator.annotate(frame, targets));
        Ok(Self { video: Video::create(path.into(), info)?, draw })
    }

    /// Creates an observer that writes the film of one target to memory; `name` identifies it in errors.
    pub fn to(memory: Memory, name: impl Into<PathBuf>, info: &RunInfo) -> Self {
        Self { video: Video::of(name.into(), Some(memory), info), draw: Self::one(info) }
    }

    fn one(info: &RunInfo) -> Draw {
        let mut annotator = Annotator::new(info);
        Box::new(move |frame, targets| match targets {
            [seen, ..] => annotator.annotate(frame, seen),
            [] => frame.image.clone(),
        })
    }
}

impl Observer for Film {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.video.push(&(self.draw)(frame, targets), frame.time)
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}

/// annotated.mp4 of several trackers on the same frames: the run's own on the left, and the others, which it drives, to the right.
#[derive(Debug)]
pub struct SideBySide {
    video: Video,
    annotators: Vec<Annotator>,
    name: String,
    others: Vec<(Tracker, Baseline)>,
    truth: Vec<Option<BBox>>,
}

impl SideBySide {
    /// Creates an observer that writes `path`, as [`Film::create`] does. The track of each other tracker goes to its [`Baseline`], whose
    /// name is written above its pane; `name` is written above the first one.
    ///
    /// # Errors
    /// Its folder does not exist.
    pub fn create(
        path: impl Into<PathBuf>,
        info: &RunInfo,
        name: String,
        others: Vec<(Tracker, Baseline)>,
    ) -> Result<Self> {
        let alone = others.iter().map(|_| Annotator::frame_alone(info));
        let annotators = std::iter::once(Annotator::new(info)).chain(alone).collect();
        Ok(Self { video: Video::create(path.into(), info)?, annotators, name, others, truth: info.truth.clone() })
    }

    /// Adds all panes with their names; the text of a pane is written at the right end of each name's line.
    fn push(&mut self, panes: &[(Image, String)], time: f64) -> Result<()> {
        let height = panes.iter().map(|(pane, _)| pane.height()).max().unwrap_or(0);
        // Even dimensions, as H.264 requires.
        let (strip, gap) = (height / 26 * 2, height / 104 * 2);
        let width = panes.iter().map(|(pane, _)| pane.width() + gap).sum::<usize>() - gap;
        let mut page = Drawing::new(width, strip + height, [18, 21, 26]);
        let (pad, size) = (0.32 * strip as f64, 0.36 * strip as f64);
        let names = std::iter::once(&*self.name).chain(self.others.iter().map(|(_, baseline)| baseline.name()));
        let mut at = 0;
        for ((pane, status), name) in panes.iter().zip(names) {
            page.paste(pane, at, strip, pane.width(), pane.height());
            page.text((at as f64 + pad, pad), name, size, [236, 238, 240]);
            let end = (at + pane.width()) as f64 - pad;
            page.text((end - text_width(status, size), pad), status, size, [236, 238, 240]);
            at += pane.width() + gap;
        }
        self.video.push(&page.into_image(), time)
    }

    /// Formats the distance of the centre from the true one.
    fn error(truth: &[Option<BBox>], frame: &Frame, estimate: &State) -> String {
        let off = |b: &BBox| (b.centre().0 - estimate.x).hypot(b.centre().1 - estimate.y);
        let truth = truth.get(frame.index).and_then(Option::as_ref);
        truth.map(|b| format!("error {:.1} px", off(b))).unwrap_or_default()
    }
}

impl Observer for SideBySide {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let ([seen, ..], [ours, annotators @ ..]) = (targets, &mut self.annotators[..]) else { return Ok(()) };
        let error = |seen: &Seen<'_>| match seen.is_given() {
            true => String::new(),
            false => Self::error(&self.truth, frame, &seen.state),
        };
        let mut panes = vec![(ours.annotate(frame, seen), error(seen))];
        for ((tracker, baseline), annotator) in self.others.iter_mut().zip(annotators) {
            let other = if seen.is_given() {
                tracker.init(&frame.image, seen.bbox)?;
                baseline.add(seen.bbox, 0);
                *seen
            } else {
                let other = tracker.update(&frame.image)?;
                baseline.add(touching(&other.bbox, &frame.image), other.values);
                other
            };
            panes.push((annotator.annotate(frame, &other), error(&other)));
        }
        self.push(&panes, frame.time)
    }
    fn finish(&mut self) -> Result<()> {
        self.video.finish()
    }
}
