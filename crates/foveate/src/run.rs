//! From a source, through a tracker, to observers: the whole program around the loop.

use std::time::{Duration, Instant};

use crate::geometry::BBox;
use crate::observe::{Clock, Observer};
use crate::scene::{Frame, FrameSource, Scout};
use crate::tracker::Tracker;
use crate::{Error, Result};

/// What to follow, and until when.
pub struct Follow<'a> {
    /// The target's box in the first frame; `None` goes on from a loaded state.
    pub init: Option<BBox>,
    /// Boxes given again at later frames (counted from 0).
    pub again: &'a [(usize, BBox)],
    /// Frames before this one (counted from 0) are skipped.
    pub from: usize,
    /// The last frame (counted from 0).
    pub until: usize,
    /// Asked before every frame: whether to stop.
    pub stop: &'a dyn Fn() -> bool,
    /// Where the time spent in the tracker is added up.
    pub clock: Clock,
    /// Told after every frame.
    pub progress: &'a mut dyn FnMut(&Frame),
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Frames in the results, the first one included.
    pub frames: usize,
    /// Frames on which the target was believed lost.
    pub lost: usize,
    /// Time spent in the tracker alone.
    pub tracking: Duration,
    /// The same for each frame, seconds.
    pub seconds: Vec<f64>,
    /// The target's box in every frame.
    pub boxes: Vec<BBox>,
    /// The likeliest class after the last frame, and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
    /// What it is called, where the recogniser's classes have names.
    pub class_name: Option<String>,
    /// Whether it was asked to stop before the source ended.
    pub stopped: bool,
}

impl Outcome {
    fn spend(&mut self, time: Duration, clock: &Clock) {
        self.tracking += time;
        self.seconds.push(time.as_secs_f64());
        clock.add(time);
    }
}

/// Follows one target through a source.
///
/// Where the source breaks half-way, what was tracked until then is finished and kept, and the error is returned beside it.
pub fn follow(
    source: &mut dyn FrameSource,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    follow: Follow<'_>,
) -> (Outcome, Result<()>) {
    follow_with(&mut Scout::default(), source, tracker, observer, follow)
}

/// The same, with a scout that looks at every frame first, those before `from` too.
pub fn follow_with(
    scout: &mut Scout,
    source: &mut dyn FrameSource,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    follow: Follow<'_>,
) -> (Outcome, Result<()>) {
    let mut outcome = Outcome::default();
    let result = each_frame(scout, source, tracker, observer, follow, &mut outcome);
    let finished = observer.finish();
    (outcome, result.and(finished))
}

fn each_frame(
    scout: &mut Scout,
    source: &mut dyn FrameSource,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    mut follow: Follow<'_>,
    outcome: &mut Outcome,
) -> Result<()> {
    for frame in source {
        let frame = frame?;
        if frame.index < follow.from {
            scout.look(&frame);
            continue;
        }
        if frame.index > follow.until {
            break;
        }
        if (follow.stop)() {
            outcome.stopped = true;
            break;
        }
        let given = follow.again.iter().find(|(at, _)| *at == frame.index).map(|(_, bbox)| *bbox);
        let began = Instant::now();
        scout.look(&frame);
        if let Some(bbox) = given.or(follow.init.take()) {
            tracker.start(&frame, bbox)?;
            outcome.spend(began.elapsed(), &follow.clock);
            outcome.boxes.push(bbox);
            observer.start(&frame, &bbox)?;
        } else if !tracker.is_started() {
            return Err(Error::Invalid(
                "the tracker has no target: give --init, or a state saved after a start".into(),
            ));
        } else {
            if let Some(flow) = scout.flow() {
                tracker.guide(flow);
            }
            let step = tracker.step(scout.scene(&frame));
            outcome.spend(began.elapsed(), &follow.clock);
            outcome.boxes.push(step.bbox());
            outcome.lost += usize::from(step.lost());
            outcome.class = step.class();
            outcome.class_name = step.class().and_then(|(class, _)| step.class_names.get(class).cloned());
            observer.observe(&step)?;
        }
        outcome.frames += 1;
        (follow.progress)(&frame);
    }
    if outcome.frames == 0 && !outcome.stopped {
        return Err(Error::Invalid(
            "the source has no frame to track in; check --init, --until and the saved state".into(),
        ));
    }
    Ok(())
}
