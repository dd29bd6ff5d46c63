#![doc = include_str!("../README.md")]
//! Observers read each seen of a run and write files. The tracking loop does not know them. Every file appears under its
//! name when it is whole: at [`Observer::finish`].
//!
//! | one target | many targets | file |
//! | --- | --- | --- |
//! | [`Boxes`] | [`MotFile`] | boxes.txt, tracks.txt: boxes in OTB's and MOTChallenge's formats |
//! | [`Table`] | [`TracksTable`], [`TargetsTable`] | track.csv, tracks.csv, targets.csv |
//! | [`Trace`] | | trace.jsonl: every intermediate quantity |
//! | [`Film`] | [`Film`] | annotated.mp4 |
//! | [`Report`] | [`MultiReport`] | report.html: a page that replays the run offline |
//! | [`SurfacePicture`] | | surface.png: what the gaze policy learned |
//! | [`Strip`] | [`MultiStrip`] | a film strip |
//! | [`Stream`] | [`Stream`] | a line a frame as it happens, to a pipe or an address |
//!
//! [`columns`] says what every column of the text files means.
#![forbid(unsafe_code)]

mod annotate;
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
pub use self::report::{
    BRAND, MultiReport, Report, SCRIPT, STYLE, card, document, drawing, escape, fill, levels, particles,
};
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
/// `observe` is called once per frame, in order, with all active targets in the order of their ids, also if there are none. In a run with
/// one target it is that one; [`Seen::is_given`] tells the frames in which its box was given. A target that is missing was terminated; it
/// may be re-identified later ([`foveate_core::multi::Phase::ReIdentified`]). `finish` is called once, at the end, also if the source broke
/// half-way. An observer must not change what it observes; one that is dropped without `finish` leaves no file.
pub trait Observer {
    /// A frame and its active targets.
    ///
    /// # Errors
    /// A file cannot be written.
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()>;
    /// The end: files get their names.
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

/// Each of them in turn. Where one fails, `finish` still comes to all; the first error is returned.
impl Observer for Vec<Box<dyn Observer>> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and)
    }
}

/// Total time spent in the tracker: added up by the runner, read by reports. Clones share one sum.
#[derive(Clone, Debug, Default)]
pub struct Clock(Arc<AtomicU64>);

impl Clock {
    /// Adds to the sum.
    pub fn add(&self, time: Duration) {
        self.0.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
    /// The sum; zero where it is not measured.
    pub fn total(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// What the readers of a run's results should be warned of: filled during the run, read by reports. Clones share one list.
#[derive(Clone, Debug, Default)]
pub struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    /// Adds a warning: whole sentences.
    pub fn add(&self, warning: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(warning);
    }
    /// All warnings so far.
    pub fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Another track of the frames of a run: filled during the run, read by reports. Clones share one track.
#[derive(Clone, Debug, Default)]
pub struct Baseline {
    name: String,
    /// A box a frame from frame 0 on, and the values read for it.
    track: Arc<Mutex<Vec<(BBox, usize)>>>,
}

impl Baseline {
    /// Whose it is, such as "fixed centre"; without a frame yet.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), track: Arc::default() }
    }
    /// Whose it is.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Adds the next frame: its box, and how many values were read.
    pub fn add(&self, bbox: BBox, values: usize) {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).push((bbox, values));
    }
    /// The boxes so far, from frame 0 on.
    pub fn boxes(&self) -> Vec<BBox> {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(bbox, _)| *bbox).collect()
    }
    /// The values read so far.
    pub fn values(&self) -> usize {
        self.track.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(_, values)| values).sum()
    }
}

/// What a run is, for the readers of its results. Texts may hold anything: they are escaped where they are written.
#[derive(Clone, Default)]
pub struct RunInfo {
    /// The video file or folder.
    pub source: String,
    /// How it is decoded: [`foveate_video::SourceInfo::reader`].
    pub reader: String,
    /// Frames a second of the source; 0 where it does not say.
    pub rate: f64,
    /// Bits a second of the source, where it is a video file: what annotated.mp4 aims at. `None` spares no bits.
    pub bit_rate: Option<f64>,
    /// File or name of the configuration.
    pub config_name: String,
    /// The whole configuration, as TOML.
    pub config_text: String,
    /// The seed in force.
    pub seed: u64,
    /// The command line.
    pub command: String,
    /// The retina, to draw its windows and glimpses; `None` leaves them out.
    pub retina: Option<Arc<dyn Retina>>,
    /// The true boxes from frame 0 on, where they are known, to be drawn beside the estimate; may be shorter than the run.
    pub truth: Vec<Option<BBox>>,
    /// Other tracks of the same frames, to be drawn beside the estimate.
    pub baselines: Vec<Baseline>,
    /// The time spent in the tracker.
    pub clock: Clock,
    /// What its readers should be warned of.
    pub warnings: Warnings,
    /// Fixed gazes that are scored in every frame to compute the regret; empty for none.
    pub shadow: Vec<Gaze>,
}

impl RunInfo {
    /// Of a run on this source with this configuration, whose name is given; what else may be known is left out.
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
