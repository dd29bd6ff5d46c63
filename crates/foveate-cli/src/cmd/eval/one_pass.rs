//! One pass over a sequence, from the true box of its first frame.

use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::confidence::{Judged, Recorder};
use foveate::lab::eval::{Sequence, TrackRun};
use foveate::report::run::{SingleRun, Span, follow};
use foveate::video::open;

/// The boxes of all frames, and what was said in each frame from the second on.
pub fn one_pass(blueprint: &Blueprint, sequence: &Sequence, seed: u64) -> Result<(TrackRun, Vec<Judged>)> {
    let mut tracker = blueprint.tracker(seed)?;
    let span = Span { until: sequence.truth.len() - 1, ..Span::default() };
    let run = SingleRun { init: Some(sequence.init()?), span, again: &[] };
    let mut witness = Recorder::of(&sequence.truth);
    let (outcome, result) = follow(&mut *open(&sequence.images)?, &mut tracker, &mut witness, run);
    result?;
    Ok((TrackRun { boxes: outcome.boxes, seconds: outcome.frames.seconds, read: witness.read() }, witness.frames))
}
