//! From a source, through a detector and [`Many`], to observers.

use std::time::{Duration, Instant};

use super::Many;
use crate::geometry::BBox;
use crate::observe::{Clock, ManyObserver, Phase};
use crate::scene::{Cuts, Detection, Frame, FrameSource};
use crate::{Error, Result};

/// Where detections come from: frame by frame, best first. Told whether a cut came before the frame.
pub type Detect<'a> = &'a mut dyn FnMut(&Frame, bool, &mut Vec<Detection>) -> Result<()>;

/// What to follow, and until when.
pub struct Plan<'a> {
    /// Boxes given by hand: frame from 0, id or none, box.
    pub given: &'a [(usize, Option<u64>, BBox)],
    /// Frames before this one (counted from 0) are skipped.
    pub from: usize,
    /// The last frame (counted from 0).
    pub until: usize,
    /// Watches for cuts, where targets die; `None` does not.
    pub cuts: Option<Cuts>,
    /// Asked before every frame: whether to stop.
    pub stop: &'a dyn Fn() -> bool,
    /// Where the time spent in detector and trackers is added up.
    pub clock: Clock,
    /// Told after every frame.
    pub progress: &'a mut dyn FnMut(&Frame),
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Followed {
    /// Frames seen.
    pub frames: usize,
    /// Targets born, or given.
    pub born: usize,
    /// Times that a target was found again after its death.
    pub found: usize,
    /// Cuts.
    pub cuts: usize,
    /// Most targets that lived at a time.
    pub most: usize,
    /// Time spent in detecting, and in tracking.
    pub detecting: Duration,
    /// Time spent in tracking alone.
    pub tracking: Duration,
    /// Whether it was asked to stop before the source ended.
    pub stopped: bool,
}

/// Follows many targets through a source.
///
/// Where the source breaks half-way, what was tracked until then is finished and kept, and the error is returned beside it.
pub fn follow(
    source: &mut dyn FrameSource,
    many: &mut Many,
    detect: Detect<'_>,
    observer: &mut dyn ManyObserver,
    plan: Plan<'_>,
) -> (Followed, Result<()>) {
    let mut outcome = Followed::default();
    let result = each_frame(source, many, detect, observer, plan, &mut outcome);
    let finished = observer.finish();
    (outcome, result.and(finished))
}

fn each_frame(
    source: &mut dyn FrameSource,
    many: &mut Many,
    detect: Detect<'_>,
    observer: &mut dyn ManyObserver,
    mut plan: Plan<'_>,
    outcome: &mut Followed,
) -> Result<()> {
    let mut detections = vec![];
    for frame in source {
        let frame = frame?;
        if frame.index < plan.from {
            continue;
        }
        if frame.index > plan.until {
            break;
        }
        if (plan.stop)() {
            outcome.stopped = true;
            break;
        }
        let began = Instant::now();
        let cut = plan.cuts.as_mut().is_some_and(|cuts| cuts.cut(&frame.image));
        detections.clear();
        detect(&frame, cut, &mut detections)?;
        let detected = began.elapsed();
        if cut {
            outcome.cuts += 1;
            many.cut(frame.index);
        }
        many.step(&frame, &detections);
        for (_, id, bbox) in plan.given.iter().filter(|(at, ..)| *at == frame.index) {
            many.give(&frame, *id, *bbox)?;
        }
        let time = began.elapsed();
        plan.clock.add(time);
        outcome.detecting += detected;
        outcome.tracking += time - detected;
        let count = |phase| many.seen().iter().filter(|seen| seen.phase == phase).count();
        outcome.born += count(Phase::Born);
        outcome.found += count(Phase::Found);
        outcome.most = outcome.most.max(many.seen().len());
        outcome.frames += 1;
        observer.observe(&frame, many.seen())?;
        (plan.progress)(&frame);
    }
    if outcome.frames == 0 && !outcome.stopped {
        return Err(Error::Invalid("the source has no frame to track in; check --until and the saved state".into()));
    }
    Ok(())
}
