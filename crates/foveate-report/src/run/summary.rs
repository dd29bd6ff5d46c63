//! The summary of a run.

use std::collections::HashSet;
use std::time::Duration;

use super::place::{touches, touching};
use foveate_core::geometry::BBox;
use foveate_core::multi::Phase;
use foveate_core::scene::Image;
use foveate_core::{Seen, Status};

/// The summary of a run. The lists are empty in an endless run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunSummary {
    /// Frames in the results, the first one included.
    pub frames: usize,
    /// Time spent in tracker and detectors in each frame, seconds.
    pub seconds: Vec<f64>,
    /// Time spent in all frames.
    pub spent: Duration,
    /// Whether the run was stopped before the source ended.
    pub stopped: bool,
    /// Frames of the source in which the decoder reported damage.
    pub damaged: u64,
    /// One target: frames that were tracked, not given.
    pub tracked: usize,
    /// One target: values read from the tracked frames, the sum of [`Seen::values`].
    pub values: usize,
    /// Number of frames with an occluded target, and none lost.
    pub occluded: usize,
    /// Number of frames with a lost target.
    pub lost: usize,
    /// One target: number of frames with the box outside the picture.
    pub outside: usize,
    /// One target: its box in every frame as in boxes.txt, [`touching`] the picture.
    pub boxes: Vec<BBox>,
    /// One target: the box of the last frame; `None` if it lies outside the picture.
    pub last: Option<BBox>,
    /// One target: the most likely class after the last frame and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
    /// One target: the name of that class, if it has one.
    pub class_name: Option<String>,
    /// Many targets: number of targets started by a detection or by hand; a target with several given boxes counts once.
    pub initiated: usize,
    /// Many targets: number of re-identifications of terminated targets.
    pub reidentified: usize,
    /// Many targets: number of cuts.
    pub cuts: usize,
    /// Many targets: maximum number of simultaneously active targets.
    pub most: usize,
    /// Many targets: time spent in detecting; the rest of `spent` was spent in tracking.
    pub detecting: Duration,
}

impl RunSummary {
    /// Returns the frames per second if all frames took `seconds`; 0 if nothing was measured.
    pub fn fps(&self, seconds: f64) -> f64 {
        if seconds > 0.0 { self.frames as f64 / seconds } else { 0.0 }
    }

    /// Adds a frame of a run with one target.
    pub(super) fn add(&mut self, seen: &Seen<'_>, image: &Image, endless: bool) {
        if !endless {
            self.boxes.push(if seen.is_given() { seen.bbox } else { touching(&seen.bbox, image) });
        }
        let inside = seen.is_given() || touches(&seen.bbox, image);
        self.last = inside.then_some(seen.bbox);
        if seen.is_given() {
            return;
        }
        self.tracked += 1;
        self.values += seen.values;
        self.outside += usize::from(!inside);
        self.occluded += usize::from(seen.status == Status::Occluded);
        self.lost += usize::from(seen.is_lost());
        self.class = seen.class;
        self.class_name = seen.class.and_then(|(class, _)| seen.class_names.get(class).cloned());
    }

    /// Adds a frame of a run with many targets; `started` holds the ids of the started targets.
    pub(super) fn add_all(&mut self, targets: &[Seen<'_>], started: &mut HashSet<u64>) {
        let of = |phase| targets.iter().filter(move |target| target.phase == phase);
        started.extend(of(Phase::Initiated).map(|target| target.id));
        self.initiated = started.len();
        self.reidentified += of(Phase::ReIdentified).count();
        self.most = self.most.max(targets.len());
        let lost = of(Phase::Lost).count() > 0;
        self.lost += usize::from(lost);
        self.occluded += usize::from(!lost && of(Phase::Occluded).count() > 0);
    }
}
