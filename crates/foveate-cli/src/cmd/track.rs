//! `foveate track`: follow a target through a video file or a folder of images.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate::Result;
use foveate::config::{Blueprint, Config, DetectorConfig, RecogniserConfig};
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::report::run::{self, RunPlan, RunSummary};
use foveate::scene::{Cuts, Detection};
use foveate::video::Frame;

use super::configure::{Changes, Profile, config_name, read};
use super::of_file;
use super::results::{Ended, Results};
use crate::terminal;
use detections::{DetectionSource, ManyArgs};
use ending::Ending;
use init::{Init, parse_again, parse_init, truth_file};
use plan::{Job, Plan, Subject};
use source::{SourceArgs, Started, StreamTo, parse_stream};
use tolerant::FailedOutputs;

mod batch;
mod detections;
mod ending;
pub mod init;
pub mod outputs;
mod plan;
mod saved;
pub mod source;
pub mod tolerant;

/// Its section of a configuration.
const RECOGNISER: &str = "recogniser";

/// The recogniser that ships with the program.
pub const DIGITS: &str = "builtin:digits";

/// What is said of files and of numbers in them.
const FILES: &str = "\
Results appear in --out together, when the run ends: whole, or not at all. A run that tracks nothing leaves the folder as it was. \
An earlier run in it is replaced; other files in it stay. A finished run stays, too, where a file of the new one could not be written: \
the other files are in OUT.unplaced-PID then. run.json lists the files of the run, and says how it ended.

Of a stream, a camera or a pipe, boxes.txt and track.csv (tracks.txt and tracks.csv of many targets) grow line by line in the folder
OUT.live-PID beside --out until the run ends, and stay there where it is killed. report.html, trace.jsonl and regret.csv then hold the
first 10,000 frames, and there is no annotated.mp4.

Frames count from 1 everywhere. Boxes on the command line, in boxes.txt, tracks.txt and files of detections count pixels from 1, \
as OTB and MOTChallenge do; track.csv, tracks.csv, trace.jsonl and --json count pixels from 0. A box that lies outside the picture \
stands in boxes.txt at the nearest place where it touches the picture, and in track.csv where it is believed to be.";

#[derive(clap::Args)]
#[command(after_long_help = FILES)]
pub struct Args {
    /// A video file, or a folder of images, or of tiles (foveate tiles); - or a fifo for yuv4mpeg from a pipe; rtsp://, http://, https:// or /dev/video0 for a
    /// stream or camera (through the program ffmpeg). Of several videos each has a folder in --out: finished ones are passed over,
    /// the first box of VIDEO.mp4 is in VIDEO.txt, index.html has the worst first, failures.txt those that failed
    #[arg(required = true, value_name = "SOURCE")]
    sources: Vec<PathBuf>,
    #[command(flatten)]
    input: SourceArgs,
    /// Write a line a frame as it happens: JSON or MOTChallenge's text to standard output, or JSON to an address. What else is said
    /// goes to standard error then
    #[arg(long, value_name = "json|mot|udp:HOST:PORT", num_args = 0..=1, default_missing_value = "json", value_parser = parse_stream)]
    stream: Option<StreamTo>,
    /// The target's box in the first frame: left, top, width, height in pixels, counted from 1 as in boxes.txt.
    /// `motion` takes what moves between the first two frames (the camera must stand still); `motion:W,H` gives it that size.
    /// Left out, the first line of groundtruth_rect.txt in the folder is taken, or of VIDEO.txt beside VIDEO.mp4. Given several times, many targets are followed
    #[arg(long, value_name = "X,Y,W,H|motion", value_parser = parse_init, allow_hyphen_values = true)]
    init: Vec<Init>,
    #[command(flatten)]
    many: ManyArgs,
    /// Restart on the target at a later frame (counted from 1) with a new box; may be given several times
    #[arg(long, value_name = "FRAME:X,Y,W,H", value_parser = parse_again, allow_hyphen_values = true)]
    reinit: Vec<(usize, BBox)>,
    /// Folder for the results: boxes.txt, track.csv, annotated.mp4, report.html, surface.png where the gaze policy learns, and
    /// run.json, which lists them; of many targets tracks.txt, tracks.csv, targets.csv, annotated.mp4, report.html
    #[arg(long, short, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// A configuration file, or the name of one that ships with the program (natural, digits, ...: see `foveate configs`);
    /// natural if left out
    #[arg(long, short, value_name = "FILE|NAME")]
    config: Option<String>,
    /// How much time a frame may take, where no configuration is given
    #[arg(long, value_enum, conflicts_with = "config")]
    profile: Option<Profile>,
    #[command(flatten)]
    changes: Changes,
    /// Seed of all random numbers: the same seed gives the same track. Left out, the configuration's seed is taken
    #[arg(long)]
    seed: Option<u64>,
    /// Go on from a state written by --save-state, at the frame after the last one tracked; needs the same --config and --seed
    #[arg(long, value_name = "FILE", conflicts_with = "init")]
    load_state: Option<PathBuf>,
    /// Write the tracker's whole state after the last frame, for --load-state
    #[arg(long, value_name = "FILE")]
    save_state: Option<PathBuf>,
    /// Stop after this frame (counted from 1)
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u64).range(1..))]
    until: Option<u64>,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    /// Score nine gazes in every frame beside the policy's own, and write the regret against the best of them in
    /// hindsight: regret.csv, regret.svg and a section of the report. Takes time; the track stays the same
    #[arg(long)]
    regret: bool,
    /// Name the target by a model of `foveate train classifier` or `train fixations`. Without MODEL by the one that ships, which knows
    /// the digits 0 to 9 alone and calls everything a digit. The class stands in track.csv, trace.jsonl, video and report; the track stays
    /// the same. MODEL takes the place of the configuration's recogniser; --set recogniser.KEY=VALUE changes its settings
    #[arg(long, visible_alias = "recognize", value_name = "MODEL", num_args = 0..=1, default_missing_value = DIGITS)]
    recognise: Option<String>,
    /// Write trace.jsonl too: every intermediate quantity of every frame, particles included; some 100 kB a frame
    #[arg(long)]
    trace: bool,
    /// Leave out annotated.mp4
    #[arg(long)]
    no_video: bool,
    /// Leave out report.html and surface.png
    #[arg(long)]
    no_report: bool,
}

impl Args {
    /// The models that are named beside the configuration: the recogniser's and the detector's.
    fn models(&self) -> impl Iterator<Item = &Path> {
        let network = match &self.many.detect {
            Some(DetectorConfig::Onnx(settings)) => Some(Path::new(&settings.model)),
            _ => None,
        };
        self.recognise.iter().map(Path::new).chain(network)
    }

    /// The files that the run reads: its results must not replace them. A state that is taken up may be replaced: so it goes on.
    fn inputs(&self, source: &Path) -> Vec<PathBuf> {
        let (files, model) = ([&self.many.detections, &self.many.inits], self.models());
        let config = self.config.iter().map(Path::new);
        let begins = self.init.is_empty() && self.load_state.is_none() && !self.many.asked();
        let truth = truth_file(source).filter(|_| begins || source.is_dir());
        let files = files.into_iter().flatten().map(PathBuf::as_path).chain(model).chain(config).chain([source]);
        files.map(PathBuf::from).chain(truth).collect()
    }

    /// Whether many targets are asked for.
    fn asks_for_many(&self) -> bool {
        self.many.asked() || self.init.len() > 1
    }

    /// The configuration, the folder of its models, and what it is called.
    fn configured(&self) -> Result<(Config, Folder, String)> {
        let name = match (&self.config, self.profile) {
            (None, None) if self.asks_for_many() => self.many.config(),
            (config, profile) => config_name(config.as_deref(), profile),
        };
        // Its settings are those of --recognise, where that takes its place.
        let others = self.recognise.as_ref().map(|_| self.changes.apart(RECOGNISER).1);
        let (config, folder) = read(name, others.as_ref().unwrap_or(&self.changes))?;
        Ok((config, folder, self.changes.describe(name)))
    }

    fn blueprint(&self, config: Config, folder: &Folder) -> Result<Blueprint> {
        let blueprint = config.check(folder)?;
        let Some(model) = &self.recognise else { return Ok(blueprint) };
        let usual = RecogniserConfig::of_model(model, &Folder::here());
        let changed = Config { recogniser: Some(usual), ..blueprint.config().clone() };
        let changed = self.changes.apart(RECOGNISER).0.make(changed)?;
        blueprint.recognising(changed.recogniser.expect("it was put there"), &Folder::here())
    }
}

/// Frames of a run, and those whose status is occluded or lost.
#[derive(Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Tally {
    frames: usize,
    occluded_frames: usize,
    lost_frames: usize,
}

pub fn run(args: Args) -> Result<()> {
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

/// Tracks through one source, to results in `out`.
fn one(args: &Args, source: &Path, out: &Path) -> Result<Tally> {
    let Plan { opened, mut subject, job } = Plan::new(args, source, out)?;
    terminal::catch_interrupts();
    if let Subject::Many(tracker, ..) = &subject {
        terminal::tell_stop(tracker.stopper());
    }
    let (results, failed) = (job.begin_results()?, FailedOutputs::default());
    let mut observers = job.outputs.observers(results.folder(), &job.info, &failed)?;
    let (began, tiles, Started { mut source, counts }) = (Instant::now(), opened.tiles.clone(), opened.start());
    if let Some(stream) = job.stream {
        let stream = stream.observer(counts.meter.clone(), source.remarks())?;
        observers.insert(0, Box::new(if job.outputs.many { stream.of_many() } else { stream }));
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
        // Nothing reads the boxes and times of all frames: memory stays flat.
        endless: true,
        progress: Some(&mut progress),
    };
    let (summary, result) = run::run(&mut *source, tracker, &mut observers, plan);
    let result = result.map_err(of_file(job.source));
    bar.finish_and_clear();
    drop(observers);
    // It stops reading, and ends its ffmpeg.
    drop(source);
    counts.note();
    if result.is_ok() && !summary.stopped {
        note_unused(&job, &subject, &summary, next_frame);
    }
    let tracked = is_tracked(&job, &summary, result.is_ok());
    let kept = keep(results, &failed, tracked, result.is_ok(), &summary);
    let saved = if tracked { job.save(&subject, next_frame) } else { Ok(()) };
    let files = kept.as_ref().map_or(&[][..], Vec::as_slice);
    let error = [result.as_ref().err(), kept.as_ref().err(), saved.as_ref().err()].into_iter().flatten().next();
    tell(&job, &subject, &summary, files, began, error.map(ToString::to_string));
    ended(out, tracked, result.and(kept.map(drop)).and(saved), summary.stopped)?;
    Ok(Tally { frames: summary.frames, occluded_frames: summary.occluded, lost_frames: summary.lost })
}

/// Whether there is a result: a frame that was tracked, or all frames of a video that ended well.
fn is_tracked(job: &Job<'_>, summary: &RunSummary, well: bool) -> bool {
    let tracked = if job.outputs.many { summary.frames > 1 } else { summary.tracked > 0 };
    tracked || (well && !summary.stopped && summary.frames > 0)
}

/// Reports boxes of frames that the video turned out not to have.
fn note_unused(job: &Job<'_>, subject: &Subject, summary: &RunSummary, next_frame: usize) {
    let end = if job.outputs.many { summary.frames } else { next_frame };
    let late: Vec<usize> = job.given.iter().map(|given| given.frame).filter(|frame| *frame >= end).collect();
    let Subject::Many(_, detections, _) = subject else {
        for frame in late {
            note!("foveate: --reinit {}: the video ended at frame {end}; this box was not used", frame + 1);
        }
        return;
    };
    if !late.is_empty() {
        job.info.warnings.add(format!(
            "{} of the first boxes are of frames after frame {end}, the last one: they were not used.",
            late.len()
        ));
    }
    detections.note_late(end);
}

/// Keeps the results of a run in which something was tracked, except those that could not be written; returns their paths. Fails if some
/// could not be written.
fn keep(
    mut results: Results,
    failed: &FailedOutputs,
    tracked: bool,
    well: bool,
    summary: &RunSummary,
) -> Result<Vec<PathBuf>> {
    let ended = match (well && failed.names().is_empty(), summary.stopped) {
        (false, _) => Ended::Error,
        (true, true) => Ended::Stopped,
        (true, false) => Ended::Finished,
    };
    results.set_damaged(summary.damaged);
    let some = results.leave_out(&failed.names());
    let failed = failed.check().map_err(|error| results.with_final_path(&error));
    if tracked && some { results.keep(ended, summary.frames, failed) } else { failed.map(|()| vec![]) }
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
    if let Subject::Many(tracker, _, source) = subject {
        if tracker.is_full() {
            job.info.warnings.add(FULL.into());
        }
        detector = Some((source.to_string(), matches!(source, DetectionSource::Ours(..))));
    }
    let (total, warnings) = (began.elapsed(), job.info.warnings.all());
    let &Job { source, out, seed, json, .. } = job;
    Ending { source, out, seed, json, detector, summary, files, total, warnings, error }.tell();
}

/// The warning of a run in which memory kept tracks from being started.
const FULL: &str =
    "There were more targets than memory allows: some detections started no track. Allow more with --max-memory.";

/// Reports a run in which nothing was tracked, and ends the program if it was asked to stop.
fn ended(out: &Path, tracked: bool, result: Result<()>, stopped: bool) -> Result<()> {
    if !tracked {
        note!("foveate: nothing was tracked; {} was left as it was", out.display());
    }
    result?;
    if stopped {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}
