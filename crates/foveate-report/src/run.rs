//! From a source, through a tracker, to observers: one runner for one target and for many.

pub mod multi;
mod single;

use std::time::{Duration, Instant};

use crate::{Clock, Warnings};
use foveate_base::{Error, Result};
use foveate_video::{Frame, FrameSource};

pub use multi::{MultiOutcome, MultiRun, follow_many};
pub use single::{Outcome, SingleRun, check_box, follow, follow_tiles, touches, touching};

/// Which frames of a source, and who is told of the time.
pub struct Span<'a> {
    /// Frames before this one (counted from 0) are looked at, but not tracked in.
    pub from: usize,
    /// The last frame (counted from 0).
    pub until: usize,
    /// Asked before every frame: whether to stop.
    pub stop: &'a dyn Fn() -> bool,
    /// Where the time spent in the tracker is added up.
    pub clock: Clock,
    /// Where it is said at the end what the source found in its video, as damage.
    pub warnings: Warnings,
    /// A run without an end: what grows with every frame, boxes and times, is left out of the outcome.
    pub endless: bool,
    /// Told after every frame, if anybody is.
    pub progress: Option<&'a mut dyn FnMut(&Frame)>,
}

impl Default for Span<'_> {
    /// All frames.
    fn default() -> Self {
        let (clock, warnings) = (Clock::default(), Warnings::default());
        Self { from: 0, until: usize::MAX, stop: &|| false, clock, warnings, endless: false, progress: None }
    }
}

/// What became of a run, whatever was tracked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frames {
    /// Frames in the results, the first one included.
    pub count: usize,
    /// Time spent in tracker and detectors in each of them, seconds; empty in a run without an end.
    pub seconds: Vec<f64>,
    /// Time spent in all frames.
    pub spent: Duration,
    /// Whether it was asked to stop before the source ended.
    pub stopped: bool,
    /// Frames of the source in which the decoder reported damage.
    pub damaged: u64,
}

/// What a runner does with frames.
trait Follower {
    /// A frame before the span.
    fn skip(&mut self, frame: &Frame) -> Result<()>;
    /// A frame of the span: tracks, calls `spent` with the part of the time that went into decoding the frame, and tells observers;
    /// neither counts.
    fn track(&mut self, frame: &Frame, spent: &mut dyn FnMut(Duration)) -> Result<()>;
}

/// Takes the frames of a span through a follower.
fn each_frame(
    source: &mut dyn FrameSource,
    follower: &mut dyn Follower,
    span: Span<'_>,
    frames: &mut Frames,
) -> Result<()> {
    let (remarks, warnings) = (source.remarks(), span.warnings.clone());
    let result = span_of(source, follower, span, frames);
    frames.damaged = remarks.damaged();
    remarks.sentences().into_iter().for_each(|sentence| warnings.add(sentence));
    result
}

fn span_of(
    source: &mut dyn FrameSource,
    follower: &mut dyn Follower,
    mut span: Span<'_>,
    frames: &mut Frames,
) -> Result<()> {
    for frame in source {
        let frame = frame?;
        if frame.index < span.from {
            follower.skip(&frame)?;
            continue;
        }
        if frame.index > span.until {
            break;
        }
        if (span.stop)() {
            frames.stopped = true;
            break;
        }
        let began = Instant::now();
        let tracked = follower.track(&frame, &mut |decoding| {
            let time = began.elapsed().saturating_sub(decoding);
            span.clock.add(time);
            frames.spent += time;
            if !span.endless {
                frames.seconds.push(time.as_secs_f64());
            }
        });
        // Within a frame: it is left out.
        if matches!(tracked, Err(Error::Stopped)) {
            frames.stopped = true;
            break;
        }
        tracked?;
        frames.count += 1;
        if let Some(progress) = &mut span.progress {
            progress(&frame);
        }
        // The next one may be long in coming.
        if frame.index == span.until {
            break;
        }
    }
    // A source that was told to stop ends without another frame.
    frames.stopped |= (span.stop)();
    if frames.count == 0 && !frames.stopped {
        return Err(Error::Invalid(
            "the source has no frame to track in; check --init, --until and the saved state".into(),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::scene::Image;
    use foveate_video::SourceInfo;

    /// A pipe of which nobody may ask for a frame that has not come yet.
    struct Pipe {
        info: SourceInfo,
        come: std::ops::Range<usize>,
    }

    impl Iterator for Pipe {
        type Item = Result<Frame>;
        fn next(&mut self) -> Option<Self::Item> {
            let index = self.come.next().expect("it would wait for a frame");
            Some(Ok(Frame { index, time: 0.0, image: Image::grey(4, 4, 0) }))
        }
    }

    impl FrameSource for Pipe {
        fn info(&self) -> &SourceInfo {
            &self.info
        }
    }

    struct Counting(Vec<usize>);

    impl Follower for Counting {
        fn skip(&mut self, _: &Frame) -> Result<()> {
            Ok(())
        }
        fn track(&mut self, frame: &Frame, spent: &mut dyn FnMut(Duration)) -> Result<()> {
            self.0.push(frame.index);
            spent(Duration::ZERO);
            Ok(())
        }
    }

    #[test]
    fn nothing_is_read_after_the_last_frame_that_is_wanted() {
        let info = SourceInfo { width: 4, height: 4, frames: None, rate: 30.0, reader: String::new() };
        let (mut pipe, mut counting, mut frames) = (Pipe { info, come: 0..5 }, Counting(vec![]), Frames::default());
        let span = Span { from: 2, until: 4, ..Span::default() };
        each_frame(&mut pipe, &mut counting, span, &mut frames).expect("three frames");
        assert_eq!((counting.0, frames.count, frames.stopped), (vec![2, 3, 4], 3, false));
    }
}
