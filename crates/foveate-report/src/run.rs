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

/// Writes the detections of a frame to the list, best first. The flag says whether a cut comes before the frame.
pub type Detect<'a> = &'a mut dyn FnMut(&Frame, bool, &mut Vec<Detection>) -> Result<()>;

/// A box given by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Given {
    /// The frame, from 0.
    pub frame: usize,
    /// The target: `None` starts a new one. With one target it is not read.
    pub id: Option<u64>,
    /// The box, pixels from 0.
    pub bbox: BBox,
}

/// What to follow in which frames.
pub struct RunPlan<'a> {
    /// The box of the only target in the first frame of the run; `None` goes on from a loaded state.
    pub init: Option<BBox>,
    /// Boxes of frames: those of many targets, and those that start the only target again.
    pub given: &'a [Given],
    /// Detections for many targets, beside those of the configuration's detector.
    pub detect: Option<Detect<'a>>,
    /// Finds the cuts at which many targets are terminated.
    pub cuts: Option<Cuts>,
    /// Frames in tiles, of which only those are decoded that the tracker reads; it needs a configuration with `[sensor]`. The source then
    /// has the numbers of the frames only ([`TileFolder::frames`]). Observers get the picture that was read.
    pub tiles: Option<&'a TileFolder>,
    /// Frames before this one (from 0) are shown to the tracker, but not tracked in.
    pub from: usize,
    /// The last frame (from 0).
    pub until: usize,
    /// Called before every frame: whether to stop.
    pub stop: &'a dyn Fn() -> bool,
    /// Adds up the time spent in the tracker.
    pub clock: Clock,
    /// Gets, at the end, the damage that the source found in its video.
    pub warnings: Warnings,
    /// A run without an end: the summary has no list that grows with every frame.
    pub endless: bool,
    /// Called after every frame.
    pub progress: Option<&'a mut dyn FnMut(&Frame)>,
}

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
pub enum AnyTracker<'a> {
    /// Of one target.
    One(&'a mut Tracker),
    /// Of many.
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

/// Runs a tracker through the frames of a source. If the source breaks half-way, the files of the frames until then are finished, and the
/// error is returned beside the summary.
pub fn run<'a>(
    source: &mut dyn FrameSource,
    tracker: impl Into<AnyTracker<'a>>,
    observer: &mut dyn Observer,
    plan: RunPlan<'_>,
) -> (RunSummary, Result<()>) {
    let (remarks, warnings) = (source.remarks(), plan.warnings.clone());
    let (summary, detections, started) = (RunSummary::default(), vec![], HashSet::new());
    let mut run = Run { tracker: tracker.into(), observer, plan, detections, started, summary };
    let result = run.frames(source);
    run.summary.damaged = remarks.damaged();
    remarks.sentences().into_iter().for_each(|sentence| warnings.add(sentence));
    let finished = run.observer.finish();
    (run.summary, result.and(finished))
}

struct Run<'t, 'o, 'p> {
    tracker: AnyTracker<'t>,
    observer: &'o mut dyn Observer,
    plan: RunPlan<'p>,
    detections: Vec<Detection>,
    /// Ids of the targets that were started.
    started: HashSet<u64>,
    summary: RunSummary,
}

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
                // Within a frame: it is left out.
                Err(Error::Stopped) => {
                    self.summary.stopped = true;
                    break;
                }
                tracked => tracked?,
            }
            self.summary.frames += 1;
            if let Some(progress) = &mut self.plan.progress {
                progress(&frame);
            }
            // The next one may be long in coming.
            if frame.index == self.plan.until {
                break;
            }
        }
        // A source that was told to stop ends without another frame.
        self.summary.stopped |= (self.plan.stop)();
        if self.summary.frames == 0 && !self.summary.stopped {
            return Err(Error::Invalid(
                "the source has no frame to track in; check --init, --until and the saved state".into(),
            ));
        }
        Ok(())
    }

    /// A frame before the run.
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
        let Run { tracker, observer, plan, detections, started, summary } = self;
        let began = Instant::now();
        let spent = |summary: &mut RunSummary, decoding: Duration| {
            let time = began.elapsed().saturating_sub(decoding);
            plan.clock.add(time);
            summary.spent += time;
            if !plan.endless {
                summary.seconds.push(time.as_secs_f64());
            }
        };
        let given = plan.given.iter().filter(|given| given.frame == frame.index);
        match tracker {
            AnyTracker::One(tracker) => {
                let tiles = plan.tiles.and_then(|tiles| tiles.frame(frame.index));
                let picture = picture_of(frame, tiles.as_ref());
                let first = plan.init.take();
                let seen = match given.map(|given| given.bbox).next().or(first) {
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
                observer.observe(frame, tracker.targets())
            }
        }
    }
}

/// The picture of a frame: its tiles, if it has some.
fn picture_of<'a>(frame: &'a Frame, tiles: Option<&'a Tiles<'_>>) -> &'a dyn Regions {
    match tiles {
        Some(tiles) => tiles,
        None => &frame.image,
    }
}

/// A frame with another picture.
fn of(frame: &Frame, image: &Image) -> Frame {
    Frame { index: frame.index, time: frame.time, image: image.clone() }
}

#[cfg(test)]
mod tests;
