//! An open video: its frames, its tracks, its results.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_base::{Error, Result};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;
use foveate_report::RunInfo;
use foveate_report::run::check_box;
use foveate_video::{Frame, SourceInfo};
use serde_json::{Value, json};

use crate::host::{Host, Video};
use crate::lines::{FILES, named, target_of};
use crate::measuring::{MOST_MEASURED, Options};
use crate::player::Frames;
use crate::propose::propose;
use crate::recent::Recent;
use crate::saving::{Made, Saving};
use crate::tracking::Setup;
use crate::tracks::Tracks;

/// Maximum number of pixels of a frame: a decoded frame has three bytes per pixel, and a page holds several.
const MOST_PIXELS: usize = 1 << 25;
/// Maximum number of true boxes sent to the page.
const MOST_TRUTH: usize = 20_000;
/// Time limit of one tracking message.
const LONGEST_STEP: std::time::Duration = std::time::Duration::from_millis(60);

/// Waits for the next frame of a stream and adds it to the most recent frames.
pub type Pull = Box<dyn FnMut(&Recent) -> Result<()> + Send>;

/// The source of frames.
pub enum Source<V> {
    /// A video with random access to its frames.
    Video(V),
    /// A camera or a stream, which yields each frame once; without the function the page pushes its frames.
    Live(Recent, Option<Pull>),
}

foveate_base::opaque_debug!(Source<V>);

/// An open video.
pub struct Session<H: Host> {
    /// The description of the source.
    pub info: SourceInfo,
    /// Its name on the command line.
    pub name: PathBuf,
    /// The source of its frames.
    pub source: Source<H::Video>,
    truth: Vec<Option<BBox>>,
    pub(crate) tracks: Tracks,
    /// One for each target, after the page requested results.
    saving: Option<Vec<Saving>>,
}

foveate_base::opaque_debug!(Session<H: Host>);

/// Fails if frames are too large for a page.
///
/// # Errors
/// [`Error::Malformed`] with their size.
pub fn check_size(info: &SourceInfo, video: &Path) -> Result<()> {
    let (w, h) = (info.width, info.height);
    if w.saturating_mul(h) <= MOST_PIXELS {
        return Ok(());
    }
    let problem = format!("frames of {w} x {h} are too large for the page; track it with `foveate track --scale`");
    Err(Error::malformed(video, problem))
}

impl<H: Host> Session<H> {
    /// Creates a session of a source, with the true boxes from frame 0 on if known.
    ///
    /// # Errors
    /// Its frames are too large for a page.
    pub fn new(name: PathBuf, source: Source<H::Video>, info: SourceInfo, truth: Vec<Option<BBox>>) -> Result<Self> {
        check_size(&info, &name)?;
        let (frames, meter) = match &source {
            Source::Video(video) => (video.tracked(), None),
            Source::Live(recent, _) => (Box::new(recent.clone()) as Box<dyn Frames>, Some(recent.meter.clone())),
        };
        Ok(Self { info, name, source, truth, tracks: Tracks::new(frames, meter), saving: None })
    }

    /// Creates a session of a camera of the page, which pushes frames of this size.
    ///
    /// # Errors
    /// It has no picture, or one that is too large.
    pub fn pushed(name: PathBuf, width: usize, height: usize, rate: f64) -> Result<Self> {
        if width == 0 || height == 0 {
            return Err(Error::Invalid("the camera has no picture; choose it again".into()));
        }
        let rate = if rate.is_finite() && (1.0..=1000.0).contains(&rate) { rate } else { 30.0 };
        let info = SourceInfo { width, height, frames: None, rate, reader: "the browser".into() };
        Self::new(name, Source::Live(Recent::new(Size { width, height }), None), info, vec![])
    }

    /// Returns whether it has a target.
    pub(crate) fn is_tracking(&self) -> bool {
        self.tracks.count() > 0
    }
    fn is_live(&self) -> bool {
        matches!(self.source, Source::Live(..))
    }

    /// Returns the description of the video for the page.
    pub(crate) fn about(&self) -> Value {
        let truth = self.truth.iter().take(MOST_TRUTH);
        let truth: Vec<_> = truth.map(|b| b.map(|b| [b.x, b.y, b.w, b.h])).collect();
        let SourceInfo { width, height, frames, rate, reader } = &self.info;
        let mut about = json!({
            "width": width, "height": height, "frames": frames, "exact": self.info.exact_frames().is_some(), "rate": rate,
            "reader": reader, "truth": truth,
        });
        if self.is_live() {
            about["live"] = json!(true);
        }
        about
    }

    /// Waits for a future frame of a stream: `index` (from 0), or for `None` the one that is tracked next.
    ///
    /// # Errors
    /// The stream breaks off, or no frame came in time.
    pub fn wait(&mut self, index: Option<usize>) -> Result<()> {
        let index = index.or(self.tracks.next());
        match &mut self.source {
            Source::Live(recent, Some(pull)) if index == Some(recent.count()) => pull(recent),
            _ => Ok(()),
        }
    }

    /// Adds the next frame of a camera of the page, with a time in seconds, after `missed` frames that were not received. Returns its
    /// number from 1.
    ///
    /// # Errors
    /// The page does not push this video's frames, or the size differs.
    pub fn push(&self, image: Image, time: f64, missed: u64) -> Result<usize> {
        match &self.source {
            Source::Live(recent, None) => recent.push(image, time, missed).map(|index| index + 1),
            _ => Err(Error::Invalid("this video takes no frames of the page".into())),
        }
    }

    /// Returns the frame that was last decoded for the tracks.
    pub fn decoded(&self) -> Option<Arc<Frame>> {
        self.tracks.decoded()
    }

    /// Returns a frame (from 0); `None` if the video ends before it.
    ///
    /// # Errors
    /// It cannot be read, or is no longer available.
    pub fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        match self.decoded().filter(|frame| frame.index == index) {
            Some(frame) => Ok(Some(frame)),
            None => self.frames().frame(index),
        }
    }

    fn frames(&mut self) -> &mut dyn Frames {
        match &mut self.source {
            Source::Video(video) => video.frames(),
            Source::Live(recent, _) => recent,
        }
    }

    /// Proposes a box around a place in a frame (from 1), or the most salient box without one.
    pub(crate) fn propose(&mut self, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
        let [other, frame] = self.frames().pair(frame - 1)?;
        let frame = frame.ok_or_else(|| Error::Invalid("the video has no such frame; choose an earlier one".into()))?;
        let at = at.filter(|(x, y)| x.is_finite() && y.is_finite());
        let (b, from) = propose(other.as_ref().map(|f| &f.image), &frame.image, at);
        Ok(json!({ "box": [b.x, b.y, b.w, b.h], "from": from }))
    }

    pub(crate) fn start(&mut self, target: usize, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saving = None;
        self.tracks.start(target, setup, frame - 1, bbox)
    }

    pub(crate) fn remove(&mut self, target: usize) -> Result<Value> {
        self.saving = None;
        self.tracks.remove(target)
    }

    pub(crate) fn step(&mut self, frames: usize) -> Result<Value> {
        let (began, before) = (H::now(), self.tracks.frames());
        let frames = match &self.source {
            Source::Video(_) => frames.max(1),
            // The page has pushed no new frame; one may follow.
            Source::Live(recent, None) if self.tracks.next() == Some(recent.count()) => 0,
            // A stream has one new frame; targets that are behind catch up on the stored ones.
            Source::Live(..) => 1,
        };
        let mut answer = self.tracks.step(frames, || H::now() - began > LONGEST_STEP)?;
        if self.tracks.frames() > before {
            self.saving = None;
        }
        if let Source::Live(recent, _) = &self.source {
            answer["missed"] = json!(recent.meter.dropped());
        }
        Ok(answer)
    }

    pub(crate) fn correct(&mut self, target: usize, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saving = None;
        self.tracks.correct(target, frame - 1, bbox)
    }

    /// Returns the commands that reproduce these tracks; empty for a camera or a stream, which cannot be read again.
    pub(crate) fn command(&self) -> Result<String> {
        if self.is_live() { self.tracks.get(0).map(|_| String::new()) } else { self.tracks.command(&self.name) }
    }

    /// Returns the track.csv of a target, the command that measures it (empty for a camera or a stream), and width and height of the pictures.
    pub(crate) fn measurable(&self, target: usize, options: &Options) -> Result<(String, String, [usize; 2])> {
        let tracking = self.tracks.get(target)?;
        if tracking.frames() > MOST_MEASURED {
            return Err(Error::Invalid(format!(
                "the track has {} frames, and the page measures {MOST_MEASURED}; save the results, then run foveate measure --track track.csv",
                tracking.frames()
            )));
        }
        let track = (0..).map_while(|piece| tracking.lines.piece(FILES[1], piece)).collect();
        let command = if self.is_live() {
            String::new()
        } else {
            options.command(target, &self.tracks.line(target, &self.name)?)
        };
        Ok((track, command, [self.info.width, self.info.height]))
    }

    /// Starts writing results. Text files exist already; a camera or a stream has no others.
    pub(crate) fn save(&mut self, film: bool, report: bool, host: &H) -> Result<Value> {
        self.tracks.get(0)?;
        // Remove the earlier files first.
        self.saving = None;
        let mut all = vec![];
        if let (Source::Video(video), true) = (&self.source, film || report) {
            for target in 0..self.tracks.count() {
                let (tracking, name) = (self.tracks.get(target)?, self.name.to_string_lossy().into_owned());
                let setup = &tracking.setup;
                let info = RunInfo {
                    command: self.tracks.line(target, &self.name)?,
                    truth: self.truth.clone(),
                    bit_rate: video.bit_rate(),
                    ..RunInfo::of(name, &self.info, setup.config.clone(), &setup.blueprint, setup.seed)
                };
                all.push(Saving::begin((film, report), tracking, video.reader(), info, host)?);
            }
        }
        self.saving = Some(all);
        Ok(json!({}))
    }

    /// Returns the progress, with the names of the files once they are complete.
    pub(crate) fn saved(&mut self) -> Result<Value> {
        let live = self.is_live();
        let texts = if live { &FILES } else { H::TEXTS };
        let saving = match &mut self.saving {
            None if live => &mut vec![],
            None => return Err(Error::Invalid("nothing is being saved; save the results first".into())),
            Some(saving) => saving,
        };
        let began = H::now();
        if let Some(next) = saving.iter_mut().find(|saving| saving.files.is_none()) {
            next.go_on::<H>(|| H::now() - began > LONGEST_STEP)?;
        }
        let frames: usize = saving.iter().map(|saving| saving.count).sum();
        if saving.iter().any(|saving| saving.files.is_none()) {
            return Ok(json!({ "frames": frames, "files": null }));
        }
        let names = |target: usize| {
            let made = saving.get(target).and_then(|saving| saving.files.as_ref()).into_iter().flatten();
            let names: Vec<&str> = texts.iter().copied().chain(made.map(|(name, _)| *name)).collect();
            names.into_iter().map(move |name| named(target, name))
        };
        let files: Vec<String> = (0..self.tracks.count()).flat_map(names).collect();
        Ok(json!({ "frames": frames, "files": files }))
    }

    /// Returns a piece, from 0, of a text file of a target; `None` after the last one, or if there is no such file.
    pub fn text(&self, name: &str, piece: usize) -> Option<String> {
        let (target, name) = target_of(name);
        self.tracks.get(target).ok()?.lines.piece(name, piece)
    }

    /// Returns a written file.
    pub fn made(&self, name: &str) -> Option<Made> {
        let (target, name) = target_of(name);
        let files = self.saving.as_ref()?.get(target)?.files.as_ref()?;
        files.iter().find(|(known, _)| *known == name).map(|(_, made)| made.clone())
    }
}
