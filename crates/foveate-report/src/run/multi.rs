//! Many targets: from a source, through detectors and a [`MultiTracker`], to observers.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use super::{Follower, Frames, Span, each_frame};
use crate::MultiObserver;
use foveate_base::Result;
use foveate_core::geometry::BBox;
use foveate_core::multi::{MultiTracker, Phase};
use foveate_core::scene::{Cuts, Detection};
use foveate_video::{Frame, FrameSource};

/// Where detections come from: frame by frame, best first. Told whether a cut came before the frame.
pub type Detect<'a> = &'a mut dyn FnMut(&Frame, bool, &mut Vec<Detection>) -> Result<()>;

/// What to follow.
pub struct MultiRun<'a> {
    /// Boxes given by hand: frame from 0, id or none, box.
    pub given: &'a [(usize, Option<u64>, BBox)],
    /// Detections beside those of the configuration's own detector.
    pub detect: Detect<'a>,
    /// Watches for cuts, where targets are terminated; `None` does not.
    pub cuts: Option<Cuts>,
    /// Which frames.
    pub span: Span<'a>,
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MultiOutcome {
    /// Its frames.
    pub frames: Frames,
    /// Targets that were started, by a detection or by hand; one that was given several boxes is one.
    pub initiated: usize,
    /// Times that a terminated target was re-identified.
    pub reidentified: usize,
    /// Cuts.
    pub cuts: usize,
    /// Most active targets at a time.
    pub most: usize,
    /// Time spent in detecting; the rest of `frames.spent` was spent in tracking.
    pub detecting: Duration,
}

struct Multi<'a> {
    tracker: &'a mut MultiTracker,
    observer: &'a mut dyn MultiObserver,
    given: &'a [(usize, Option<u64>, BBox)],
    detect: Detect<'a>,
    cuts: Option<Cuts>,
    detections: Vec<Detection>,
    /// Ids of the targets that were started.
    started: HashSet<u64>,
    outcome: MultiOutcome,
}

/// Follows many targets through a source.
///
/// Where the source breaks half-way, what was tracked until then is finished and kept, and the error is returned beside it.
pub fn follow_many(
    source: &mut dyn FrameSource,
    tracker: &mut MultiTracker,
    observer: &mut dyn MultiObserver,
    MultiRun { given, detect, cuts, span }: MultiRun<'_>,
) -> (MultiOutcome, Result<()>) {
    let mut frames = Frames::default();
    let (detections, started, outcome) = (vec![], HashSet::new(), MultiOutcome::default());
    let mut multi = Multi { tracker, observer, given, detect, cuts, detections, started, outcome };
    let result = each_frame(source, &mut multi, span, &mut frames);
    let finished = multi.observer.finish();
    (MultiOutcome { frames, ..multi.outcome }, result.and(finished))
}

impl Follower for Multi<'_> {
    fn skip(&mut self, frame: &Frame) -> Result<()> {
        self.tracker.skip(&frame.image);
        Ok(())
    }
    fn track(&mut self, frame: &Frame, spent: &mut dyn FnMut(Duration)) -> Result<()> {
        let (began, o) = (Instant::now(), &mut self.outcome);
        let cut = self.cuts.as_mut().is_some_and(|cuts| cuts.cut(&frame.image));
        self.detections.clear();
        (self.detect)(frame, cut, &mut self.detections)?;
        o.detecting += began.elapsed();
        if cut {
            o.cuts += 1;
            self.tracker.cut();
        }
        self.tracker.update(&frame.image, &self.detections)?;
        for (_, id, bbox) in self.given.iter().filter(|(at, ..)| *at == frame.index) {
            self.tracker.add(&frame.image, *id, *bbox)?;
        }
        spent(Duration::ZERO);
        let targets = self.tracker.targets();
        let of = |phase| targets.iter().filter(move |target| target.phase == phase);
        self.started.extend(of(Phase::Initiated).map(|target| target.id));
        o.initiated = self.started.len();
        o.reidentified += of(Phase::ReIdentified).count();
        o.most = o.most.max(targets.len());
        self.observer.observe(frame, targets)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::files::Nowhere;
    use foveate_core::Seen;
    use foveate_core::config::Config;
    use foveate_core::scene::Image;
    use foveate_video::{ImageFolder, save_png};

    struct Unseen;

    impl MultiObserver for Unseen {
        fn observe(&mut self, _: &Frame, _: &[Seen<'_>]) -> Result<()> {
            Ok(())
        }
        fn finish(&mut self) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_target_that_is_given_again_is_counted_once() {
        let dir = tempfile::tempdir().expect("a folder");
        let image = Image::from_grey8(96, 64, &(0..96 * 64).map(|i| (i * 31 % 251) as u8).collect::<Vec<_>>());
        let image = image.expect("96 x 64");
        (0..6).for_each(|t| save_png(dir.path().join(format!("{t}.png")), &image).expect("writable"));
        let config = Config::builtin("multi").expect("it ships").expect("it is right");
        let blueprint = Config { particles: 50, ..config }.check(&Nowhere).expect("it fits");
        let mut tracker = blueprint.multi_tracker(1).expect("trackers");
        let (a, b) = (BBox::new(10.0, 10.0, 20.0, 20.0), BBox::new(60.0, 30.0, 20.0, 20.0));
        let given = [(0, Some(7), a), (0, Some(8), b), (4, Some(7), a)];
        let detect: Detect<'_> = &mut |_, _, _| Ok(());
        let run = MultiRun { given: &given, detect, cuts: None, span: Span::default() };
        let mut source = ImageFolder::open(dir.path()).expect("images");
        let (outcome, result) = follow_many(&mut source, &mut tracker, &mut Unseen, run);
        result.expect("tracked");
        assert_eq!((outcome.frames.count, outcome.initiated), (6, 2));
    }
}
