//! Implements `foveate track`: follows a target through a video file or a folder of images.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate::report::run::{self, RunPlan, RunSummary};
use foveate::scene::{Cuts, Detection};
use foveate::video::Frame;
use foveate::{Error, Result};

use super::of_file;
use super::results::{Ended, Results};
use crate::terminal;
pub(crate) use args::{Args, DIGITS, Measure};
use detections::DetectionSource;
use ending::Ending;
use plan::{Job, Plan, Subject};
use source::Started;
use tolerant::FailedOutputs;

mod args;
mod batch;
mod detections;
mod ending;
pub(crate) mod init;
mod many;
mod measured;
pub(crate) mod outputs;
mod plan;
mod saved;
pub(crate) mod source;
pub(crate) mod tolerant;

/// Numbers of frames of a run, and of frames with status occluded or lost.
#[derive(Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Tally {
    frames: usize,
    occluded_frames: usize,
    lost_frames: usize,
}

pub(crate) fn run(args: Args) -> Result<()> {
    if args.recognise.as_deref() == Some(DIGITS) {
        note!(
            "foveate: the recogniser that ships knows the digits 0 to 9 alone, and calls everything a digit; for other classes train one \
             with foveate train classifier, and give it to --recognise"
        );
    }
    match &args.sources[..] {
        [source] => one(&args, source, &args.out).map(drop),
        _ => batch::run(args),
    }
}

/// Tracks through one source and writes the results to `out`.
fn one(args: &Args, source: &Path, out: &Path) -> Result<Tally> {
    let Plan { opened, mut subject, job, measured } = Plan::new(args, source, out)?;
    terminal::catch_interrupts();
    if let Subject::Many(tracker, ..) = &subject {
        terminal::tell_stop(tracker.stopper());
    }
    let (results, failed) = (job.begin_results()?, FailedOutputs::default());
    let mut observers = job.outputs.observers(results.folder(), &job.info, &failed)?;
    let lines = measured.as_ref().map(|measured| measured.lines.clone()).unwrap_or_default();
    let (began, tiles, Started { mut source, counts }) = (Instant::now(), opened.tiles.clone(), opened.start());
    if let Some(stream) = job.stream {
        let stream = stream.observer(counts.meter.clone(), source.remarks())?;
        observers.insert(0, Box::new(if job.outputs.many { stream.of_many() } else { stream }));
    }
    if let Some(measured) = measured {
        let scale = args.input.selection().scale;
        observers = measured.observers(observers, (results.folder(), job.source, scale), &failed)?;
    }
    let bar = terminal::progress(job.frames.total(&job.about), "tracking");
    let mut next_frame = job.frames.from;
    let mut progress = |frame: &Frame| {
        next_frame = frame.index + 1;
        bar.set_position((next_frame - job.frames.from) as u64);
    };
    let (tracker, detections) = subject.parts();
    let mut detect = detections.map(|detections| {
        move |frame: &Frame, cut: bool, found: &mut Vec<Detection>| detections.next(frame, cut, found)
    });
    let plan = RunPlan {
        init: job.init,
        given: &job.given,
        cuts: detect.is_some().then(Cuts::default),
        detect: detect.as_mut().map(|detect| detect as run::Detect<'_>),
        tiles: tiles.as_ref(),
        from: job.frames.from,
        until: job.frames.until,
        stop: &terminal::stopping,
        clock: job.info.clock.clone(),
        warnings: job.info.warnings.clone(),
        // Boxes and times of all frames are not needed here: memory use stays constant.
        endless: true,
        progress: Some(&mut progress),
    };
    let (summary, result) = run::run(&mut *source, tracker, &mut observers, plan);
    let result = result.map_err(of_file(job.source));
    bar.finish_and_clear();
    drop(observers);
    // Dropping the source stops reading and ends its ffmpeg process.
    drop(source);
    counts.note();
    if result.is_ok() && !summary.stopped {
        note_unused(&job, &subject, next_frame);
    }
    let tracked = is_tracked(&job, &summary, result.is_ok());
    let (files, kept) = keep(results, &failed, tracked, result.is_ok(), &summary);
    let saved = if tracked { job.save(&subject, next_frame) } else { Ok(()) };
    let errors = [result.as_ref().err(), kept.as_ref().err(), saved.as_ref().err()].into_iter().flatten();
    let error = errors.map(ToString::to_string).reduce(|all, error| all + "; " + &error);
    tell(&job, &subject, &summary, &files, began, error.clone());
    if !job.json {
        lines.all().iter().for_each(|line| say!("{line}"));
    }
    ended(out, tracked, error.map_or(Ok(()), |error| Err(Error::Invalid(error))), summary.stopped)?;
    Ok(Tally { frames: summary.frames, occluded_frames: summary.occluded, lost_frames: summary.lost })
}

/// Returns whether the run has a result: a tracked frame, or all frames of a video that ended without an error.
fn is_tracked(job: &Job<'_>, summary: &RunSummary, well: bool) -> bool {
    let tracked = if job.outputs.many { summary.frames > 1 } else { summary.tracked > 0 };
    tracked || (well && !summary.stopped && summary.frames > 0)
}

/// Reports boxes of frames that the video turned out not to have.
fn note_unused(job: &Job<'_>, subject: &Subject, end: usize) {
    if let Subject::Many(_, detections, _) = subject {
        return detections.note_late(end);
    }
    for given in job.given.iter().filter(|given| given.frame >= end) {
        note!("foveate: --reinit {}: the video ended at frame {end}; this box was not used", given.frame + 1);
    }
}

/// Keeps the results of a run in which something was tracked, except those that could not be written. Returns their paths, and an error if
/// some could not be written.
fn keep(
    mut results: Results,
    failed: &FailedOutputs,
    tracked: bool,
    well: bool,
    summary: &RunSummary,
) -> (Vec<PathBuf>, Result<()>) {
    let ended = match (well && failed.names().is_empty(), summary.stopped) {
        (false, _) => Ended::Error,
        (true, true) => Ended::Stopped,
        (true, false) => Ended::Finished,
    };
    results.set_damaged(summary.damaged);
    let cut = results.leave_out(&failed.names());
    let failed = failed.check(&cut).map_err(|error| results.with_final_path(&error));
    if !tracked || results.is_empty() {
        return (vec![], failed);
    }
    match results.keep(ended, summary.frames, failed.as_ref().err()) {
        Ok(paths) => (paths, failed),
        Err(error) => (vec![], Err(error)),
    }
}

/// Prints the end of a run.
fn tell(
    job: &Job<'_>,
    subject: &Subject,
    summary: &RunSummary,
    files: &[PathBuf],
    began: Instant,
    error: Option<String>,
) {
    let mut detector = None;
    if let Subject::Many(_, _, source) = subject {
        detector = Some((source.to_string(), matches!(source, DetectionSource::Ours(..))));
    }
    let (total, warnings) = (began.elapsed(), job.info.warnings.all());
    let &Job { source, out, seed, json, .. } = job;
    Ending { source, out, seed, json, detector, summary, files, total, warnings, error }.tell();
}

/// Reports a run in which nothing was tracked, and ends the program after a stop request.
fn ended(out: &Path, tracked: bool, result: Result<()>, stopped: bool) -> Result<()> {
    if !tracked {
        note!("foveate: nothing was tracked; {} is unchanged", out.display());
    }
    result?;
    if stopped {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}
