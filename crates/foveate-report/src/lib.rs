#![doc = include_str!("../README.md")]
//! Observers read every [`Seen`] of a run and write files. The tracking loop does not depend on them. Every file gets its
//! final name when it is complete: at [`Observer::finish`].
//!
//! | one target | many targets | file |
//! | --- | --- | --- |
//! | [`Boxes`] | [`MotFile`] | boxes.txt, tracks.txt: boxes in OTB's and MOTChallenge's formats |
//! | [`Table`] | [`TracksTable`], [`TargetsTable`] | track.csv, tracks.csv, targets.csv |
//! | [`Trace`] | | trace.jsonl: every intermediate quantity |
//! | [`Film`] | [`Film`] | annotated.mp4 |
//! | [`Report`] | [`Report`] | report.html: a page that replays the run offline |
//! | [`SurfacePicture`] | | surface.png: the gaze policy's learned rewards |
//! | [`Strip`] | [`MultiStrip`] | a film strip |
//! | [`Stream`] | [`Stream`] | one line per frame as it is tracked, to a pipe or an address |
//!
//! [`columns`] describes every column of the text files.
#![forbid(unsafe_code)]

mod annotate;
#[doc(hidden)]
pub mod chart;
pub mod columns;
mod csv;
pub mod draw;
mod eye;
mod film;
mod font;
pub mod heat;
pub mod multi;
mod pictures;
pub mod regret;
mod report;
pub mod run;
mod snapshot;
pub mod stream;
mod strip;
pub mod surface;
mod table;
pub mod template;
mod trace;
mod tracks;

pub use self::annotate::Annotator;
pub use self::csv::quoted;
pub use self::film::{Film, SideBySide};
pub use self::multi::MultiAnnotator;
pub use self::pictures::shrunk;
pub use self::report::{BRAND, Report, SCRIPT, STYLE, card, document, drawing, escape, fill, levels, particles};
pub use self::snapshot::SurfacePicture;
pub use self::stream::Stream;
pub use self::strip::{MultiStrip, Strip};
pub use self::table::{Boxes, Table};
pub use self::trace::Trace;
pub use self::tracks::{MotFile, TargetsTable, TracksTable};

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use foveate_base::Result;
use foveate_core::Seen;
use foveate_core::config::Blueprint;
use foveate_core::geometry::{BBox, Gaze};
use foveate_core::identity::Retina;
use foveate_video::{Frame, SourceInfo};

/// Observes a run.
///
/// `observe` is called once per frame, in order, with all active targets in the order of their ids, even if there are none. In a run with
/// one target it is that target; [`Seen::is_given`] is true in frames with a given box. A missing target was terminated; it may be
/// re-identified later ([`foveate_core::multi::Phase::ReIdentified`]). `finish` is called once, at the end, even if the source broke off.
/// An observer must not change its arguments; one that is dropped without `finish` leaves no file.
pub trait Observer {
    /// Observes a frame and its active targets.
    ///
    /// # Errors
    /// A file cannot be written.
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()>;
    /// Ends the observation: files get their final names.
    ///
    /// # Errors
    /// A file cannot be written.
    fn finish(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Observer for Box<dyn Observer> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        (**self).observe(frame, targets)
    }
    fn finish(&mut self) -> Result<()> {
        (**self).finish()
    }
}

/// Calls each observer in turn. If one fails, `finish` is still called for all; the first error is returned.
impl Observer for Vec<Box<dyn Observer>> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and)
    }
}

/// Total time spent in the tracker: accumulated by the runner, read by reports. Clones share one sum.
#[derive(Clone, Debug, Default)]
pub struct Clock(Arc<AtomicU64>);

impl Clock {
    /// Adds to the sum.
    pub fn add(&self, time: Duration) {
        self.0.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
    /// Returns the sum; zero if time is not measured.
    pub fn total(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// Warnings for the readers of a run's results: filled during the run, read by reports. Clones share one list.
#[derive(Clone, Debug, Default)]
pub struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    /// Adds a warning of whole sentences.
    pub fn add(&self, warning: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(warning);
    }
    /// Returns all warnings so far.
    pub fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Another track of the frames of a run: filled during the run, read by reports. Clones share one track.
#[derive(Clone, Debug, Default)]
pub struct Baseline {
    name: String,
    /// A box per frame from frame 0 on, and the number of values read for it.
    track: Arc<Mutex<Vec<(BBox, usize)>>>,
}

impl Baseline {
    /// Creates an empty track with a name such as "fixed centre".
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), track: Arc::default() }
    }
    /// Returns the name.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Adds the next frame: its box, and the number of values read.
    pub fn add(&self, bbox: BBox, values: usize) {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).push((bbox, values));
    }
    /// Returns the boxes so far, from frame 0 on.
    pub fn boxes(&self) -> Vec<BBox> {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(bbox, _)| *bbox).collect()
    }
    /// Returns the number of values read so far.
    pub fn values(&self) -> usize {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(_, values)| values).sum()
    }
}

/// The description of a run for the readers of its results. Texts may contain any characters: they are escaped when written.
#[derive(Clone, Default)]
pub struct RunInfo {
    /// The video file or folder.
    pub source: String,
    /// Description of the decoder: [`foveate_video::SourceInfo::reader`].
    pub reader: String,
    /// Frame rate of the source, frames per second; 0 if unknown.
    pub rate: f64,
    /// Bit rate of the source if it is a video file, bits per second: the target of annotated.mp4. `None` sets no limit.
    pub bit_rate: Option<f64>,
    /// File or name of the configuration.
    pub config_name: String,
    /// The whole configuration, as TOML.
    pub config_text: String,
    /// The random seed.
    pub seed: u64,
    /// The command line.
    pub command: String,
    /// The retina, to draw its windows and glimpses; `None` leaves them out.
    pub retina: Option<Arc<dyn Retina>>,
    /// The true boxes from frame 0 on, if known, drawn beside the estimate; may be shorter than the run.
    pub truth: Vec<Option<BBox>>,
    /// Other tracks of the same frames, drawn beside the estimate.
    pub baselines: Vec<Baseline>,
    /// The time spent in the tracker.
    pub clock: Clock,
    /// Warnings for the readers.
    pub warnings: Warnings,
    /// Fixed gazes that are scored in every frame to compute the regret; empty for none.
    pub shadow: Vec<Gaze>,
}

foveate_base::opaque_debug!(RunInfo);

impl RunInfo {
    /// Creates the description of a run on this source with this named configuration; optional data are left out.
    pub fn of(source: String, about: &SourceInfo, config_name: String, blueprint: &Blueprint, seed: u64) -> Self {
        Self {
            source,
            reader: about.reader.clone(),
            rate: about.rate,
            config_name,
            config_text: blueprint.config().to_toml(),
            seed,
            retina: Some(blueprint.retina()),
            ..Self::default()
        }
    }
}
