//! One pass over a sequence, from the true box of its first frame.

use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::confidence::{Judged, Recorder};
use foveate::lab::eval::{Sequence, TrackRun};
use foveate::report::run::{SingleRun, Span, check_box, follow};
use foveate::video::open;

use crate::cmd::of_file;

/// The boxes of all frames, and what was said in each frame from the second on.
pub fn one_pass(blueprint: &Blueprint, sequence: &Sequence, seed: u64) -> Result<(TrackRun, Vec<Judged>)> {
    let (mut tracker, mut source, bbox) = (blueprint.tracker(seed)?, open(&sequence.images)?, sequence.init()?);
    check_box(&format!("{}: the first box", sequence.truth_file.display()), &bbox, source.info())?;
    let span = Span { until: sequence.truth.len() - 1, ..Span::default() };
    let run = SingleRun { init: Some(bbox), span, again: &[] };
    let mut witness = Recorder::of(&sequence.truth);
    let (outcome, result) = follow(&mut *source, &mut tracker, &mut witness, run);
    result.map_err(of_file(&sequence.images))?;
    Ok((TrackRun { boxes: outcome.boxes, seconds: outcome.frames.seconds, read: witness.read() }, witness.frames))
}
