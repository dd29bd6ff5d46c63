//! `foveate track` of many targets: with a detector, with detections from a file, or with several first boxes.

mod detections;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foveate::config::{Config, DetectorConfig};
use foveate::files::Folder;
use foveate::report::run::multi::Detect;
use foveate::report::run::{MultiOutcome, MultiRun, Span, check_box, follow_many};
use foveate::report::{
    Limited, MotFile, MultiFilm, MultiObserver, MultiReport, RunInfo, Summary, TargetsTable, TracksTable,
};
use foveate::scene::Cuts;
use foveate::text::counted;
use foveate::video::mot::Tracks;
use foveate::video::{Frame, Selection, SourceInfo, without_password};
use foveate::{BBox, Error, MultiTracker, Result};

use detections::Detections;
pub use detections::ManyArgs;

use super::init::{Frames, first_box};
use super::outputs::{FIRST, run_info, sinks, tell_files};
use super::source::{Started, is_endless};
use super::spared::Lost;
use super::{Args, Tally, ended, keep};
use crate::cmd::of_file;
use crate::terminal;

/// Follows many targets.
pub fn run(args: &Args, mut config: Config, folder: &Folder, config_name: &str) -> Result<Tally> {
    refuse(args)?;
    let detector = Source::choose(&args.many, &mut config)?;
    let blueprint = args.blueprint(config, folder)?;
    let seed = args.seed.unwrap_or(blueprint.config().seed);
    let mut many = blueprint.multi_tracker(seed)?;
    let opened = args.input.open(&args.source)?;
    if opened.tiles.is_some() {
        let source = args.source.display();
        return Err(Error::Invalid(format!("{source}: many targets and detectors need whole pictures, not tiles")));
    }
    let (about, endless) = (opened.source.info().clone(), opened.endless);
    let frames = Frames::new(0, "the video begins", args.until, &about)?;
    let given = given(args, &about)?;
    room(&many, &given, &about)?;
    let mut detections = Detections::of(args, &about, frames, given.is_empty(), detector.needs_still_camera())?;
    args.check_written(args.many.save_detections.as_deref(), &names(args, endless))?;
    let info = run_info(&args.source.display().to_string(), &about, config_name, &blueprint, seed);
    terminal::catch_interrupts();
    terminal::tell_stop(many.stopper());
    detections.warnings = info.warnings.clone();
    let (results, lost) = (args.results(&names(args, endless), endless)?, Lost::default());
    let mut observers = observers(args, results.folder(), &info, endless, &lost)?;
    let (began, Started { mut source, counts }) = (Instant::now(), opened.start());
    if let Some(stream) = &args.stream {
        observers.insert(0, Box::new(stream.observer(counts.meter.clone(), source.remarks())?));
    }
    let bar = terminal::progress(frames.total(&about), "tracking");
    let mut progress = |frame: &Frame| bar.set_position(frame.index as u64 + 1);
    let (stop, clock, warnings) = (&terminal::stopping, info.clock.clone(), info.warnings.clone());
    let span = Span {
        until: frames.until,
        stop,
        clock,
        warnings,
        endless: true,
        progress: Some(&mut progress),
        ..Span::default()
    };
    let detect: Detect = &mut |f, cut, found| detections.next(f, cut, found);
    let run = MultiRun { given: &given, detect, cuts: Some(Cuts::default()), span };
    let (outcome, result) = follow_many(&mut *source, &mut many, &mut observers, run);
    let result = result.map_err(of_file(&args.source));
    bar.finish_and_clear();
    drop(observers);
    drop(source);
    counts.note();
    let whole = result.is_ok() && !outcome.frames.stopped;
    let late = given.iter().filter(|(frame, ..)| whole && *frame >= outcome.frames.count).count();
    if late > 0 {
        let end = outcome.frames.count;
        info.warnings.add(format!(
            "{late} of the first boxes are of frames after frame {end}, the last one: they were not used."
        ));
    }
    if whole {
        detections.note_late(&args.many, outcome.frames.count);
    }
    let tracked = outcome.frames.count > 1 || (whole && outcome.frames.count > 0);
    let kept = keep(results, &lost, tracked, result.is_ok(), &outcome.frames);
    let saved = if tracked { detections.save(&args.many) } else { Ok(()) };
    let files = kept.as_ref().map_or(&[][..], Vec::as_slice);
    let error = [result.as_ref().err(), kept.as_ref().err(), saved.as_ref().err()].into_iter().flatten().next();
    let error = error.map(ToString::to_string);
    if many.is_full() {
        info.warnings.add(FULL.into());
    }
    let (detects, warnings) = (matches!(detector, Source::Ours(..)), info.warnings.all());
    let (detector, total) = (detector.to_string(), began.elapsed());
    tell(args, &outcome, &Told { files, detector, detects, seed, total, warnings, error });
    let result = ended(&args.out, tracked, result.and(kept.map(drop)).and(saved), outcome.frames.stopped);
    result.map(|()| Tally { frames: outcome.frames.count, ..Tally::default() })
}

/// Where detections come from: one detector at most.
enum Source {
    Nothing,
    /// The program's, in the place of the configuration's where that has one.
    Ours(DetectorConfig, Option<DetectorConfig>),
    File(PathBuf, Option<DetectorConfig>),
    /// The configuration's: the tracker runs it.
    Configured(DetectorConfig),
}

impl Source {
    /// What is asked for comes first; then the configuration's detector does not run.
    fn choose(args: &ManyArgs, config: &mut Config) -> Result<Self> {
        let chosen = match (args.detector()?, &args.detections) {
            (Some(kind), _) => Self::Ours(kind, config.detector.take()),
            (None, Some(path)) => Self::File(path.clone(), config.detector.take()),
            (None, None) => config.detector.clone().map_or(Self::Nothing, Self::Configured),
        };
        match chosen {
            Self::Nothing | Self::Configured(_) if args.save_detections.is_some() => Err(Error::Invalid(
                "--save-detections writes what --detect finds; give --detect KIND too, or leave it out".into(),
            )),
            chosen => Ok(chosen),
        }
    }
}

impl Source {
    /// Whether it takes for granted that the camera stands still.
    fn needs_still_camera(&self) -> bool {
        let (Self::Ours(kind, _) | Self::Configured(kind)) = self else { return false };
        matches!(kind, DetectorConfig::Motion | DetectorConfig::Walkers)
    }
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = |detector: &DetectorConfig| match detector {
            DetectorConfig::Onnx(settings) => format!("onnx:{}", settings.model),
            detector => detector.name().to_owned(),
        };
        let replaced = match self {
            Self::Nothing => return write!(f, "none, given boxes alone"),
            Self::Configured(kind) => return write!(f, "{}, the configuration's", name(kind)),
            Self::Ours(kind, replaced) => write!(f, "{} (--detect)", name(kind)).map(|()| replaced)?,
            Self::File(path, replaced) => write!(f, "{}", path.display()).map(|()| replaced)?,
        };
        match replaced {
            Some(kind) => write!(f, ", in the place of the configuration's {}", name(kind)),
            None => Ok(()),
        }
    }
}

/// Options that belong to one target.
fn refuse(args: &Args) -> Result<()> {
    for (given, name) in [
        (!args.reinit.is_empty(), "--reinit"),
        (args.load_state.is_some(), "--load-state"),
        (args.save_state.is_some(), "--save-state"),
        (args.regret, "--regret"),
        (args.trace, "--trace"),
        (Selection { scale: 1.0, ..args.input.selection() } != Selection::default(), "--from or --every"),
        (
            args.many.save_detections.is_some() && is_endless(&args.source),
            "--save-detections, of a source without an end,",
        ),
    ] {
        if given {
            return Err(Error::Invalid(format!(
                "{name} is for one target; leave it out, or give one --init and no --detect, --detections, --inits"
            )));
        }
    }
    Ok(())
}

/// The boxes given by hand: those of --init in frame 1, and those of --inits. All must be where the video has pixels.
fn given(args: &Args, about: &SourceInfo) -> Result<Vec<(usize, Option<u64>, BBox)>> {
    let mut given = vec![];
    for (i, init) in args.init.iter().enumerate() {
        let bbox = first_box(&args.source, Some(*init), &args.input)?;
        check_box(&format!("the first box of target {}", i + 1), &bbox, about)?;
        given.push((0, None, bbox));
    }
    let Some(path) = &args.many.inits else { return Ok(given) };
    for s in &Tracks::read(path)?.sightings {
        let wrong = |problem: String| Error::malformed(path, format!("frame {}: {problem}", s.frame + 1));
        if let Some(n) = about.exact_frames().filter(|n| s.frame >= *n) {
            return Err(wrong(format!("the video has {}; give boxes of these alone", counted(n, "frame"))));
        }
        let id = match s.id {
            -1 => None,
            id @ 0.. => Some(id as u64),
            id => return Err(wrong(format!("id {id}; give 0 or more, or -1 for a new one"))),
        };
        check_box("the box", &s.bbox, about).map_err(|e| wrong(e.to_string()))?;
        given.push((s.frame, id, s.bbox));
    }
    let mut seen = BTreeSet::new();
    if let Some((frame, Some(id), _)) = given.iter().find(|(frame, id, _)| id.is_some() && !seen.insert((*frame, *id)))
    {
        let frame = frame + 1;
        let problem = format!("frame {frame}: two boxes of target {id}; give one, or other ids");
        return Err(Error::malformed(path, problem));
    }
    if given.is_empty() && args.many.detect.is_none() && args.many.detections.is_none() {
        return Err(Error::malformed(path, "it has no box; give lines frame,id,x,y,w,h"));
    }
    Ok(given)
}

/// Fails where so many first boxes take more memory than there may be.
fn room(many: &MultiTracker, given: &[(usize, Option<u64>, BBox)], about: &SourceInfo) -> Result<()> {
    if given.is_empty() {
        return Ok(());
    }
    let side = |of: fn(&BBox) -> f64| given.iter().map(|(_, _, bbox)| of(bbox)).sum::<f64>() / given.len() as f64;
    many.check_room(given.len(), &BBox::new(0.0, 0.0, side(|b| b.w), side(|b| b.h)), (about.width, about.height))
}

/// What is said where memory kept tracks from being started.
const FULL: &str =
    "There were more targets than memory allows: some detections started no track. Allow more with --max-memory.";

type Observers = Vec<Box<dyn MultiObserver>>;

/// The names of the files that a run makes.
fn names(args: &Args, endless: bool) -> Vec<&'static str> {
    let video = (!args.no_video && !endless).then_some("annotated.mp4");
    let report = (!args.no_report).then_some("report.html");
    ["tracks.txt", "tracks.csv", "targets.csv"].into_iter().chain(video).chain(report).collect()
}

/// The observers that write them.
fn observers(args: &Args, folder: &Path, info: &RunInfo, endless: bool, lost: &Lost) -> Result<Observers> {
    let at = |name: &str| folder.join(name);
    let sink = sinks(endless);
    let (file, table) = (MotFile::to(sink(at("tracks.txt"))?), TracksTable::to(sink(at("tracks.csv"))?));
    let targets = TargetsTable::create(at("targets.csv"))?;
    let mut observers: Observers = vec![
        Box::new(lost.spare(&["tracks.txt"], file)),
        Box::new(lost.spare(&["tracks.csv"], table)),
        Box::new(lost.spare(&["targets.csv"], targets)),
    ];
    if !args.no_video && !endless {
        let film = MultiFilm::create(at("annotated.mp4"), info)?;
        observers.push(Box::new(lost.spare(&["annotated.mp4"], film)));
    }
    if !args.no_report {
        let report = MultiReport::create(at("report.html"), info.clone())?;
        let most = if endless { FIRST } else { usize::MAX };
        observers.push(Box::new(lost.spare(&["report.html"], Limited::new(report, most))));
    }
    Ok(observers)
}

/// What is told of at the end, beside the outcome.
struct Told<'a> {
    files: &'a [PathBuf],
    detector: String,
    /// Whether it is the program that detects: then its time is known.
    detects: bool,
    seed: u64,
    total: Duration,
    warnings: Vec<String>,
    error: Option<String>,
}

fn tell(args: &Args, outcome: &MultiOutcome, told: &Told<'_>) {
    let MultiOutcome { initiated, reidentified, cuts, most, .. } = outcome;
    let (frames, detecting) = (outcome.frames.count, outcome.detecting.as_secs_f64());
    let (tracking, total) = ((outcome.frames.spent.as_secs_f64() - detecting).max(0.0), told.total.as_secs_f64());
    let rate = |seconds| Summary::rate(frames, seconds);
    if args.json {
        // A name need not be Unicode.
        let outputs: Vec<_> = told.files.iter().map(|file| file.to_string_lossy()).collect();
        let summary = serde_json::json!({
            "source": without_password(&args.source.to_string_lossy()), "frames": frames, "targets": initiated, "reidentified": reidentified,
            "cuts": cuts, "most_at_a_time": most, "detector": told.detector, "tracking_seconds": tracking,
            "detecting_seconds": detecting, "total_seconds": total, "total_fps": rate(total), "seed": told.seed,
            "outputs": outputs, "damaged_frames": outcome.frames.damaged, "warnings": told.warnings, "error": told.error,
        });
        say!("{summary:#}");
        return;
    }
    if told.files.is_empty() {
        return;
    }
    let detected =
        if told.detects { format!(", {:.0} with detection", rate(tracking + detecting)) } else { String::new() };
    say!(
        "{}, {}, at most {most} at a time, {reidentified} re-identified, {}; {} a second in the trackers{detected}, {:.0} end to end.",
        counted(frames, "frame"),
        counted(*initiated, "target"),
        counted(*cuts, "cut"),
        counted(rate(tracking).round() as usize, "frame"),
        rate(total)
    );
    say!("Detector: {}.", told.detector);
    told.warnings.iter().for_each(|warning| say!("Warning: {warning}"));
    tell_files(&args.out, told.files);
}
