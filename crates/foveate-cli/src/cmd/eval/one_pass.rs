//! One pass over a sequence, from the true box of its first frame.

use foveate::config::Blueprint;
use foveate::lab::eval::confidence::{Judged, Recorder};
use foveate::lab::eval::{Sequence, TrackRun};
use foveate::report::run::{RunPlan, check_box, run};
use foveate::text::counted;
use foveate::video::open;
use foveate::{Error, Result};

use crate::cmd::of_file;

/// Refuses sequences that no tracker can run on, before running any: the first box must be valid for a target, and there must be a picture
/// for each box. Reports surplus pictures.
pub(super) fn check(sequences: &[Sequence]) -> Result<()> {
    for sequence in sequences {
        let (bbox, source, truth) = (sequence.init()?, open(&sequence.images)?, sequence.truth_file.display());
        check_box(&format!("{truth}: the first box"), &bbox, source.info())?;
        let (boxes, pictures) = (sequence.truth.len(), source.info().exact_frames().unwrap_or(sequence.truth.len()));
        let (images, of_boxes, of_pictures) =
            (sequence.images.display(), counted(boxes, "box"), counted(pictures, "picture"));
        if boxes > pictures {
            let problem = format!("{} for {} in {images}; expected a picture for each box", of_boxes, of_pictures);
            return Err(Error::malformed(&sequence.truth_file, problem));
        }
        if boxes < pictures {
            note!(
                "{truth}: {of_boxes} for {of_pictures} in {images}: the first {} used; where the boxes begin later, take the \
                 pictures before them away",
                counted(boxes, "picture")
            );
        }
    }
    Ok(())
}

/// Returns the boxes of all frames, and the reports in each frame from the second on.
pub(super) fn one_pass(blueprint: &Blueprint, sequence: &Sequence, seed: u64) -> Result<(TrackRun, Vec<Judged>)> {
    let (mut tracker, mut source, bbox) = (blueprint.tracker(seed)?, open(&sequence.images)?, sequence.init()?);
    let plan = RunPlan { init: Some(bbox), until: sequence.truth.len() - 1, ..RunPlan::default() };
    let mut witness = Recorder::of(&sequence.truth);
    let (summary, result) = run(&mut *source, &mut tracker, &mut witness, plan);
    result.map_err(of_file(&sequence.images))?;
    Ok((TrackRun { boxes: summary.boxes, seconds: summary.seconds, read: witness.read() }, witness.frames))
}
