//! The frame loop: from a source, through a tracker of one target or of many, to an observer.

pub mod place;
mod summary;

use std::collections::HashSet;
use std::slice;
use std::time::{Duration, Instant};

use crate::{Clock, Observer, Warnings};
use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::scene::{Cuts, Detection, Image, Regions};
use foveate_core::{MultiTracker, Seen, Tracker};
use foveate_video::{Frame, FrameSource, TileFolder, Tiles};

pub use place::{check_box, touches, touching};
pub use summary::RunSummary;

/// Writes the detections of a frame to the list, best first. The flag is true if a cut precedes the frame.
pub type Detect<'a> = &'a mut dyn FnMut(&Frame, bool, &mut Vec<Detection>) -> Result<()>;

/// A given box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Given {
    /// The frame, from 0.
    pub frame: usize,
    /// The target: `None` starts a new one. Ignored with one target.
    pub id: Option<u64>,
    /// The box, pixels from 0.
    pub bbox: BBox,
}

/// The input of a run: targets, frames and options.
pub struct RunPlan<'a> {
    /// The box of the only target in the first frame of the run; `None` continues from a loaded state.
    pub init: Option<BBox>,
    /// Given boxes: those of many targets, and those that restart the only target.
    pub given: &'a [Given],
    /// Detections for many targets, in addition to those of the configuration's detector.
    pub detect: Option<Detect<'a>>,
    /// Finds the cuts at which many targets are terminated.
    pub cuts: Option<Cuts>,
    /// Tiled frames, of which only the tiles read by the tracker are decoded; requires a configuration with `[sensor]`. The source then
    /// yields only the frame numbers ([`TileFolder::frames`]). Observers receive the picture that was read.
    pub tiles: Option<&'a TileFolder>,
    /// The first tracked frame (from 0); earlier frames are shown to the tracker but not tracked.
    pub from: usize,
    /// The last frame (from 0).
    pub until: usize,
    /// Called before every frame; returns whether to stop.
    pub stop: &'a dyn Fn() -> bool,
    /// Accumulates the time spent in the tracker.
    pub clock: Clock,
    /// Receives the warnings: damage in the video, and what was not used.
    pub warnings: Warnings,
    /// Whether the run is endless: the summary then has no list that grows with every frame.
    pub endless: bool,
    /// Called after every tracked frame, before the observer: if the observer fails, the tracker has seen the frame all the same.
    pub progress: Option<&'a mut dyn FnMut(&Frame)>,
}

foveate_base::opaque_debug!(RunPlan<'a>);

impl Default for RunPlan<'_> {
    /// All frames, without a box.
    fn default() -> Self {
        Self {
            init: None,
            given: &[],
            detect: None,
            cuts: None,
            tiles: None,
            from: 0,
            until: usize::MAX,
            stop: &|| false,
            clock: Clock::default(),
            warnings: Warnings::default(),
            endless: false,
            progress: None,
        }
    }
}

/// The tracker of a run.
#[derive(Debug)]
pub enum AnyTracker<'a> {
    /// A tracker of one target.
    One(&'a mut Tracker),
    /// A tracker of many targets.
    Many(&'a mut MultiTracker),
}

impl<'a> From<&'a mut Tracker> for AnyTracker<'a> {
    fn from(tracker: &'a mut Tracker) -> Self {
        Self::One(tracker)
    }
}

impl<'a> From<&'a mut MultiTracker> for AnyTracker<'a> {
    fn from(tracker: &'a mut MultiTracker) -> Self {
        Self::Many(tracker)
    }
}

/// Runs a tracker through the frames of a source. If the source breaks off, finishes the files of the frames until then and returns the
/// error beside the summary.
pub fn run<'a>(
    source: &mut dyn FrameSource,
    tracker: impl Into<AnyTracker<'a>>,
    observer: &mut dyn Observer,
    plan: RunPlan<'_>,
) -> (RunSummary, Result<()>) {
    let (remarks, warnings) = (source.remarks(), plan.warnings.clone());
    let (summary, detections, started) = (RunSummary::default(), vec![], HashSet::new());
    let next = plan.from;
    let mut run = Run { tracker: tracker.into(), observer, plan, detections, started, next, summary };
    let result = run.frames(source);
    run.summary.damaged = remarks.damaged();
    remarks.sentences().into_iter().for_each(|sentence| warnings.add(sentence));
    run.warn(result.is_ok() && !run.summary.stopped);
    let finished = run.observer.finish();
    (run.summary, result.and(finished))
}

struct Run<'t, 'o, 'p> {
    tracker: AnyTracker<'t>,
    observer: &'o mut dyn Observer,
    plan: RunPlan<'p>,
    detections: Vec<Detection>,
    /// Ids of the started targets.
    started: HashSet<u64>,
    /// The number after the last tracked frame's.
    next: usize,
    summary: RunSummary,
}

/// The warning of a run in which memory kept tracks from being started.
const FULL: &str =
    "There were more targets than memory allows: some detections started no track. Allow more with --max-memory.";

impl Run<'_, '_, '_> {
    fn frames(&mut self, source: &mut dyn FrameSource) -> Result<()> {
        for frame in source {
            let frame = frame?;
            if frame.index < self.plan.from {
                self.skip(&frame)?;
                continue;
            }
            if frame.index > self.plan.until {
                break;
            }
            if (self.plan.stop)() {
                self.summary.stopped = true;
                break;
            }
            match self.track(&frame) {
                // Stopped within a frame: the frame is left out.
                Err(Error::Stopped) => {
                    self.summary.stopped = true;
                    break;
                }
                tracked => tracked?,
            }
            self.summary.frames += 1;
            // Do not wait for the next frame, which may come late.
            if frame.index == self.plan.until {
                break;
            }
        }
        // A stopped source ends without another frame.
        self.summary.stopped |= (self.plan.stop)();
        if self.summary.frames == 0 && !self.summary.stopped {
            return Err(Error::Invalid(
                "the source has no frame to track in; check --init, --until and the saved state".into(),
            ));
        }
        Ok(())
    }

    /// Warns of targets that there was no memory for, and of given boxes after the end of the video, if it `ended`.
    fn warn(&self, ended: bool) {
        let AnyTracker::Many(tracker) = &self.tracker else { return };
        if tracker.is_full() {
            self.plan.warnings.add(FULL.into());
        }
        let late = self.plan.given.iter().filter(|given| given.frame >= self.next).count();
        if ended && late > 0 {
            self.plan.warnings.add(format!(
                "{late} of the first boxes are of frames after frame {}, the last one: they were not used.",
                self.next
            ));
        }
    }

    /// Processes a frame before the run.
    fn skip(&mut self, frame: &Frame) -> Result<()> {
        let tiles = self.plan.tiles.and_then(|tiles| tiles.frame(frame.index));
        match &mut self.tracker {
            AnyTracker::One(tracker) => tracker.skip(picture_of(frame, tiles.as_ref())),
            AnyTracker::Many(tracker) => {
                tracker.skip(&frame.image);
                Ok(())
            }
        }
    }

    /// Tracks in a frame, then calls the observer; decoding tiles and observing do not count as time in the tracker.
    fn track(&mut self, frame: &Frame) -> Result<()> {
        let Run { tracker, observer, plan, detections, started, next, summary } = self;
        let began = Instant::now();
        let spent = |summary: &mut RunSummary, decoding: Duration| {
            let time = began.elapsed().saturating_sub(decoding);
            plan.clock.add(time);
            summary.spent += time;
            if !plan.endless {
                summary.seconds.push(time.as_secs_f64());
            }
        };
        // Boxes of dropped frames are used in the next one.
        let due = std::mem::replace(next, frame.index + 1)..=frame.index;
        let given = plan.given.iter().filter(|given| due.contains(&given.frame));
        match tracker {
            AnyTracker::One(tracker) => {
                let tiles = plan.tiles.and_then(|tiles| tiles.frame(frame.index));
                let picture = picture_of(frame, tiles.as_ref());
                let first = plan.init.take();
                tracker.set_time(frame.time);
                let seen = match given.max_by_key(|given| given.frame).map(|given| given.bbox).or(first) {
                    Some(bbox) => {
                        tracker.init(picture, bbox)?;
                        let mut seen: Seen<'_> = Seen::given(picture.shape(), &bbox);
                        seen.picture = tracker.sensed();
                        seen
                    }
                    None if !tracker.has_target() => {
                        return Err(Error::Invalid(
                            "the tracker has no target: give --init, or a state saved after a start".into(),
                        ));
                    }
                    None => tracker.update(picture)?,
                };
                spent(summary, tiles.as_ref().map_or(Duration::ZERO, |tiles| tiles.decoding()));
                let shown = tiles.as_ref().and(seen.picture).map(|picture| of(frame, picture));
                let frame = shown.as_ref().unwrap_or(frame);
                summary.add(&seen, &frame.image, plan.endless);
                if let Some(progress) = &mut plan.progress {
                    progress(frame);
                }
                observer.observe(frame, slice::from_ref(&seen))
            }
            AnyTracker::Many(tracker) => {
                let cut = plan.cuts.as_mut().is_some_and(|cuts| cuts.cut(&frame.image));
                detections.clear();
                if let Some(detect) = &mut plan.detect {
                    detect(frame, cut, detections)?;
                }
                summary.detecting += began.elapsed();
                if cut {
                    summary.cuts += 1;
                    tracker.cut();
                }
                tracker.update(&frame.image, detections)?;
                for Given { id, bbox, .. } in given {
                    tracker.add(&frame.image, *id, *bbox)?;
                }
                spent(summary, Duration::ZERO);
                summary.add_all(tracker.targets(), started);
                if let Some(progress) = &mut plan.progress {
                    progress(frame);
                }
                observer.observe(frame, tracker.targets())
            }
        }
    }
}

/// Returns the picture of a frame: its tiles, if it has any.
fn picture_of<'a>(frame: &'a Frame, tiles: Option<&'a Tiles<'_>>) -> &'a dyn Regions {
    match tiles {
        Some(tiles) => tiles,
        None => &frame.image,
    }
}

/// Returns a frame with another picture.
fn of(frame: &Frame, image: &Image) -> Frame {
    Frame { index: frame.index, time: frame.time, image: image.clone() }
}

#[cfg(test)]
mod tests;
