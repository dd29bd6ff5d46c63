//! `foveate track`: follow a target through a video file or a folder of images.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate::config::{Blueprint, Config, DetectorConfig, RecogniserConfig};
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::lab::eval::regret::comparison_gazes;
use foveate::report::SurfacePicture;
use foveate::report::run::{self, SingleRun, Span, check_box, follow, follow_tiles};
use foveate::video::{Frame, SourceInfo};
use foveate::{Error, Result, Tracker, files};

use super::configure::{Changes, Profile, config_name, read};
use super::of_file;
use super::results::{Ended, Results, spare, writable};
use crate::terminal;
use init::{Frames, Init, check_again, first_box, known_truth, parse_again, parse_init, truth_file};
use outputs::{Outputs, Told, tell};
use saved::{SavedState, video_name};
use source::{SourceArgs, Started, StreamTo, parse_stream};
use spared::Lost;

mod batch;
pub mod init;
mod multi;
pub mod outputs;
mod saved;
pub mod source;
pub mod spared;

pub use outputs::run_info;

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
    /// The one that is tracked now.
    #[arg(skip)]
    source: PathBuf,
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
    many: multi::ManyArgs,
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

    /// What the run reads, for its results must not replace that. A state that is taken up may be: so it goes on.
    fn inputs(&self) -> Vec<PathBuf> {
        let (files, model) = ([&self.many.detections, &self.many.inits], self.models());
        let config = self.config.iter().map(Path::new);
        let begins = self.init.is_empty() && self.load_state.is_none() && !self.many.asked();
        let truth = truth_file(&self.source).filter(|_| begins || self.source.is_dir());
        let files = files.into_iter().flatten().map(PathBuf::as_path).chain(model).chain(config).chain([&*self.source]);
        files.map(PathBuf::from).chain(truth).collect()
    }

    /// Begins the results. Lines of --stream to standard output have it for themselves from here on.
    fn results(&self, names: &[&str], endless: bool) -> Result<Results> {
        if self.stream.as_ref().is_some_and(StreamTo::takes_output) {
            terminal::give_output();
        }
        let begin = if endless { Results::begin_live } else { Results::begin };
        let inputs = self.inputs();
        let inputs = inputs.iter().chain(&self.load_state).map(PathBuf::as_path);
        begin(&self.out, names, &inputs.collect::<Vec<_>>())
    }

    /// Refuses a file to be written at the end, where its folder is not there (that of the results will be), or
    /// where it would change what is read.
    fn check_written(&self, path: Option<&Path>, names: &[&str]) -> Result<()> {
        let Some(path) = path else { return Ok(()) };
        let (folder, out) = (files::folder_of(path), &*self.out);
        if folder != out || folder.is_dir() {
            writable(path)?;
        }
        let result = |name: &&str| path.file_name().is_some_and(|n| n == *name);
        let same = || {
            folder == out
                || std::fs::canonicalize(folder).ok().zip(std::fs::canonicalize(out).ok()).is_some_and(|(a, b)| a == b)
        };
        if names.iter().chain(&["run.json"]).any(result) && same() {
            return Err(Error::malformed(path, "a result of the run has this name; give another name"));
        }
        let inputs = self.inputs();
        spare(path, &inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())
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

pub fn run(mut args: Args) -> Result<()> {
    if args.recognise.as_deref() == Some(DIGITS) {
        note!(
            "foveate: the recogniser that ships knows the digits 0 to 9 alone, and calls everything a digit; for other classes train one \
             with foveate train classifier, and give it to --recognise"
        );
    }
    if args.sources.len() > 1 {
        return batch::run(args);
    }
    args.source = args.sources.pop().unwrap_or_default();
    one(&args).map(drop)
}

/// Tracks through `args.source`.
fn one(args: &Args) -> Result<Tally> {
    let (config, folder, described) = args.configured()?;
    // A configuration of many targets with a detector of its own needs nothing else to begin with.
    let begins = config.multi_target.is_some() && config.detector.is_some();
    if args.asks_for_many() || (begins && args.init.is_empty() && args.load_state.is_none()) {
        return multi::run(args, config, &folder, &described);
    }
    single(args, args.blueprint(config, &folder)?, &described)
}

fn single(args: &Args, blueprint: Blueprint, config_name: &str) -> Result<Tally> {
    let shadow = if args.regret { comparison_gazes(&blueprint.config().policy).gazes() } else { vec![] };
    let blueprint = blueprint.shadowing(shadow.clone());
    let seed = args.seed.unwrap_or(blueprint.config().seed);
    let mut tracker = blueprint.tracker(seed)?;
    let opened = args.input.open(&args.source)?;
    let about = opened.source.info().clone();
    let Begin { frames, init, again } = begin(args, &blueprint, &mut tracker, seed, &about)?;
    let mut info = run_info(&args.source.display().to_string(), &about, config_name, &blueprint, seed);
    info.truth = known_truth(&args.source).iter().map(|bbox| bbox.map(|bbox| args.input.scaled(&bbox))).collect();
    info.shadow = shadow;
    let endless = opened.endless;
    let tiles = opened.tiles.clone();
    if tiles.is_some() {
        check_reads_tiles(&blueprint, &args.source, config_name)?;
    }
    let (video, report) = (!args.no_video && !endless, !args.no_report);
    let (trace, regret) = (args.trace, args.regret);
    let surface = report && SurfacePicture::shows(tracker.parts().gaze.policy().snapshot());
    let outputs = Outputs { video, report, surface, trace, regret, endless };
    args.check_written(args.save_state.as_deref(), &outputs.names())?;
    terminal::catch_interrupts();
    let (results, lost) = (args.results(&outputs.names(), endless)?, Lost::default());
    let mut observers = outputs.observers(results.folder(), &info, &lost)?;
    let (began, Started { mut source, counts }) = (Instant::now(), opened.start());
    if let Some(stream) = &args.stream {
        observers.insert(0, Box::new(stream.observer(counts.meter.clone(), source.remarks())?));
    }
    let bar = terminal::progress(frames.total(&about), "tracking");
    let mut next_frame = frames.from;
    let mut progress = |frame: &Frame| {
        next_frame = frame.index + 1;
        bar.set_position((next_frame - frames.from) as u64);
    };
    let (stop, clock, warnings) = (&terminal::stopping, info.clock.clone(), info.warnings.clone());
    // Nobody reads boxes and times of all frames: memory stays flat.
    let span = Span {
        from: frames.from,
        until: frames.until,
        stop,
        clock,
        warnings,
        endless: true,
        progress: Some(&mut progress),
    };
    let run = SingleRun { init, again: &again, span };
    let (outcome, result) = match &tiles {
        Some(tiles) => follow_tiles(tiles, &mut *source, &mut tracker, &mut observers, run),
        None => follow(&mut *source, &mut tracker, &mut observers, run),
    };
    let result = result.map_err(of_file(&args.source));
    bar.finish_and_clear();
    drop(observers);
    // It stops reading, and ends its ffmpeg.
    drop(source);
    counts.note();
    let whole = result.is_ok() && !outcome.frames.stopped;
    let tracked = outcome.tracked > 0 || (whole && outcome.frames.count > 0);
    let kept = keep(results, &lost, tracked, result.is_ok(), &outcome.frames);
    let saved = match &args.save_state {
        Some(path) if tracked => {
            SavedState::write(path, (&args.source, &about), &blueprint, seed, next_frame, tracker.save())
        }
        _ => Ok(()),
    };
    let files = kept.as_ref().map_or(&[][..], Vec::as_slice);
    let error = [result.as_ref().err(), kept.as_ref().err(), saved.as_ref().err()].into_iter().flatten().next();
    let error = error.map(ToString::to_string);
    let (source, out, total) = (&*args.source, &*args.out, began.elapsed());
    let warnings = info.warnings.all();
    tell(&outcome, &Told { source, out, seed, json: args.json, files, total, warnings, error });
    note_unreached(&again, next_frame, whole);
    ended(out, tracked, result.and(kept.map(drop)).and(saved), outcome.frames.stopped)?;
    Ok(Tally { frames: outcome.frames.count, occluded_frames: outcome.occluded, lost_frames: outcome.lost })
}

/// From which frame on a run tracks, and what it is told of the target.
struct Begin {
    frames: Frames,
    /// The box in its first frame; none where a saved tracker goes on.
    init: Option<BBox>,
    /// Boxes that are given again, and in which frames.
    again: Vec<(usize, BBox)>,
}

/// Looks up where to begin, in the saved state or on the command line, and has the tracker take up the state.
fn begin(args: &Args, blueprint: &Blueprint, tracker: &mut Tracker, seed: u64, about: &SourceInfo) -> Result<Begin> {
    let selection = args.input.selection();
    let frames = |from: usize, start: &'static str| Frames::new(from, start, args.until, about);
    let (frames, init) = match &args.load_state {
        Some(path) => {
            let saved = SavedState::read(path, blueprint, seed)?;
            let frames = frames(saved.next_frame, "the saved state goes on")?;
            tracker.load(&saved.tracker).map_err(of_file(path))?;
            saved.check_size(path, about)?;
            let (then, now) = (&saved.source, video_name(&args.source));
            if !then.is_empty() && *then != now {
                note!("foveate: the state was saved in {then:?}, and goes on in {now:?}: is it the same video?");
            }
            (frames, None)
        }
        None => {
            let frames =
                frames(selection.from, if selection.from == 0 { "the video begins" } else { "--from begins" })?;
            let bbox = first_box(&args.source, args.init.first().copied(), &args.input)?;
            check_box("the first box", &bbox, about)?;
            (frames, Some(bbox))
        }
    };
    let again = check_again(&args.reinit, frames, about)?;
    if let Some((frame, _)) = again.iter().find(|(frame, _)| !selection.takes(*frame)) {
        let frame = frame + 1;
        return Err(Error::Invalid(format!("--reinit {frame}: --every leaves this frame out; give another frame")));
    }
    Ok(Begin { frames, init, again })
}

/// Refuses pictures in tiles for a configuration that reads whole ones.
fn check_reads_tiles(blueprint: &Blueprint, source: &Path, config_name: &str) -> Result<()> {
    if blueprint.config().sensor.is_some() {
        return Ok(());
    }
    let source = source.display();
    Err(Error::Config(format!(
        "{source}: pictures in tiles are for a configuration with [sensor], such as --config foveated; {config_name} reads whole pictures"
    )))
}

/// Keeps the results of a run in which something was tracked, and which went well or not, but for those that were lost; answers where they
/// are. Fails where some were lost.
fn keep(mut results: Results, lost: &Lost, tracked: bool, well: bool, frames: &run::Frames) -> Result<Vec<PathBuf>> {
    let ended = match (well && lost.names().is_empty(), frames.stopped) {
        (false, _) => Ended::Error,
        (true, true) => Ended::Stopped,
        (true, false) => Ended::Finished,
    };
    results.set_damaged(frames.damaged);
    let some = results.leave_out(&lost.names());
    let lost = lost.check().map_err(|error| results.told(&error));
    if tracked && some { results.keep(ended, frames.count, lost) } else { lost.map(|()| vec![]) }
}

/// Says what became of a run that did not go well, and ends the program where it was asked to stop.
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

/// Boxes given again in frames that the video turned out not to have: nobody could know before.
fn note_unreached(again: &[(usize, BBox)], next_frame: usize, whole: bool) {
    for (frame, _) in again.iter().filter(|(frame, _)| whole && *frame >= next_frame) {
        note!("foveate: --reinit {}: the video ended at frame {next_frame}; this box was not used", frame + 1);
    }
}
