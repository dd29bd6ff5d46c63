//! THE RESULTS GOING OUT: observers of a run, which read each step and write files. The loop does not know them.
//!
//! [`Boxes`] boxes.txt, [`Table`] track.csv, [`Trace`] trace.jsonl, [`Film`] annotated.mp4, [`Report`]
//! report.html, [`SurfacePicture`] surface.png, [`RegretFiles`] regret.csv and regret.svg; of many targets [`CrowdFilm`],
//! [`CrowdReport`] and [`CrowdStrip`]. Every file appears under its name when it is whole: at [`Observer::finish`].

mod annotate;
pub mod crowd;
mod crowd_film;
pub mod draw;
mod eye;
mod film;
pub mod first;
mod font;
pub mod heat;
mod json;
pub mod many;
pub mod mp4;
mod mux;
mod portrait;
mod regret;
mod report;
mod sink;
mod strip;
pub mod surface;
mod table;
mod trace;
mod tracks;

pub use self::annotate::Annotator;
pub use self::crowd::CrowdAnnotator;
pub use self::crowd_film::{CrowdFilm, CrowdStrip};
pub use self::film::Film;
pub use self::json::Summary;
pub use self::many::{ManyObserver, Phase, Seen};
pub use self::mp4::Mp4Writer;
pub use self::portrait::SurfacePicture;
pub use self::regret::RegretFiles;
pub use self::report::{CrowdReport, Report};
pub(crate) use self::report::{escape, fill};
pub use self::strip::Strip;
pub use self::table::{Boxes, Table};
pub use self::trace::Trace;
pub use self::tracks::{MotFile, TargetsTable, TracksTable};

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::Result;
use crate::geometry::{BBox, Gaze};
use crate::identity::Retina;
use crate::scene::Frame;
use crate::step::Step;

/// Watches a run from outside.
///
/// Frames come in order: `start` for one whose box was given, `observe` for one that was tracked. `finish` comes once,
/// at the end, also where the source broke half-way. An observer must not change what it watches; dropped without
/// `finish`, it leaves no file.
pub trait Observer {
    /// A frame whose box was given: the first one of a run, or a later one where the target is given again.
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()>;
    /// A frame that was tracked.
    fn observe(&mut self, step: &Step<'_>) -> Result<()>;
    /// The end: files get their names.
    fn finish(&mut self) -> Result<()>;
}

/// Each of them in turn. Where one fails, `finish` still comes to all; the first error is answered.
impl Observer for Vec<Box<dyn Observer>> {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.start(frame, bbox))
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.observe(step))
    }
    fn finish(&mut self) -> Result<()> {
        self.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and)
    }
}

/// Time spent in the tracker, added up by whoever runs it and read by reports. Copies share one sum.
#[derive(Clone, Debug, Default)]
pub struct Clock(Arc<AtomicU64>);

impl Clock {
    /// Adds to the sum.
    pub fn add(&self, time: Duration) {
        self.0.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
    /// The sum; zero where nobody measures.
    pub fn total(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// What a run is, for people who read its results. Texts may hold anything: they are escaped where they are written.
#[derive(Clone, Default)]
pub struct RunInfo {
    /// The video file or folder.
    pub source: String,
    /// How it is read, as [`crate::scene::SourceInfo`] says.
    pub reader: String,
    /// Frames a second of the source.
    pub rate: f64,
    /// File or name of the configuration.
    pub config_name: String,
    /// The whole configuration, as TOML.
    pub config_text: String,
    /// The seed in force.
    pub seed: u64,
    /// The command line.
    pub command: String,
    /// The retina, to draw what it saw; `None` leaves that out.
    pub retina: Option<Arc<dyn Retina>>,
    /// Where the target really is, by frame index, to be shown beside the estimate; empty where nobody knows.
    pub truth: Vec<BBox>,
    /// Where the time spent in the tracker is added up.
    pub clock: Clock,
    /// Gazes that are scored to know the regret against them; empty where nobody asked.
    pub shadow: Vec<Gaze>,
}
