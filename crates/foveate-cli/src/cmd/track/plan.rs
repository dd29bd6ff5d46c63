//! The checked arguments of a run: every error in them is reported before anything is tracked or written.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use foveate::config::Blueprint;
use foveate::lab::eval::regret::comparison_gazes;
use foveate::report::run::{AnyTracker, Given, check_box};
use foveate::report::{RunInfo, SurfacePicture};
use foveate::text::counted;
use foveate::video::mot::Tracks;
use foveate::video::{Selection, SourceInfo};
use foveate::{BBox, Error, MultiTracker, Result, Tracker, files};

use super::args::Args;
use super::detections::{DetectionSource, Detections};
use super::init::{Frames, check_again, first_box, known_truth};
use super::measured::Measured;
use super::outputs::{Outputs, run_info};
use super::saved::{SavedState, video_name};
use super::source::{Opened, StreamTo, is_endless};
use crate::cmd::of_file;
use crate::cmd::results::{Results, spare, writable};
use crate::terminal;

/// A checked run.
pub(super) struct Plan<'a> {
    pub opened: Opened,
    pub subject: Subject,
    pub job: Job<'a>,
    pub measured: Option<Measured>,
}

/// The tracker of a run.
pub(super) enum Subject {
    One(Box<Tracker>),
    Many(Box<MultiTracker>, Box<Detections>, DetectionSource),
}

/// The rest of the plan.
pub(super) struct Job<'a> {
    pub source: &'a Path,
    pub out: &'a Path,
    pub json: bool,
    pub stream: Option<&'a StreamTo>,
    pub seed: u64,
    pub about: SourceInfo,
    pub frames: Frames,
    /// The first box of one target; `None` if a saved tracker resumes.
    pub init: Option<BBox>,
    pub given: Vec<Given>,
    pub info: RunInfo,
    pub outputs: Outputs,
    /// Files that the results must not replace.
    inputs: Vec<PathBuf>,
    load_state: Option<&'a Path>,
    save_state: Option<&'a Path>,
}

impl<'a> Plan<'a> {
    /// Checks the arguments, reads the files that they name, and opens the source.
    pub(super) fn new(args: &'a Args, source: &'a Path, out: &'a Path) -> Result<Self> {
        let (mut config, folder, name) = args.configured()?;
        // A configuration of many targets with its own detector needs no first box.
        let begins = config.multi_target.is_some() && config.detector.is_some();
        let many = args.asks_for_many() || (begins && args.init.is_empty() && args.load_state.is_none());
        let mut detector = None;
        if many {
            refuse(args, source)?;
            detector = Some(DetectionSource::choose(&args.many, &mut config)?);
        }
        let shadow = if args.regret { comparison_gazes(&config.policy).gazes() } else { vec![] };
        let blueprint = args.blueprint(config, &folder)?.shadowing(shadow.clone());
        let seed = args.seed.unwrap_or(blueprint.config().seed);
        let mut subject = match detector {
            None => Subject::One(Box::new(blueprint.tracker(seed)?)),
            Some(detector) => Subject::Many(Box::new(blueprint.multi_tracker(seed)?), Box::default(), detector),
        };
        let mut selection = args.input.selection();
        let read = |path: &'a Path| SavedState::read(path).map(|saved| (path, saved));
        let mut saved = args.load_state.as_deref().map(read).transpose()?;
        if let Some((_, saved)) = &saved {
            // Every so many frames from the last tracked one on.
            selection.from = saved.next_frame.saturating_sub(1) % selection.every;
        }
        let opened = args.input.open_selected(source, selection)?;
        if opened.joined
            && let Some((_, saved)) = &mut saved
        {
            (selection.from, saved.next_frame) = (0, 0);
        }
        let about = opened.source.info().clone();
        if opened.tiles.is_some() {
            check_reads_tiles(&blueprint, source, &name, many)?;
        }
        let mut info = run_info(&source.display().to_string(), &about, &name, &blueprint, seed);
        let (frames, init, given) = match &mut subject {
            Subject::One(tracker) => begin((args, source), (tracker, saved), selection, &about)?,
            Subject::Many(tracker, detections, detector) => {
                let frames = Frames::new(0, "the video begins", args.until, &about)?;
                let given = given(args, source, &about, matches!(detector, DetectionSource::Nothing))?;
                check_memory(tracker, &given, &about)?;
                given.iter().filter_map(|given| given.id).for_each(|id| tracker.reserve(id));
                let still = detector.needs_still_camera();
                **detections = Detections::of((args, source), &about, frames, given.is_empty(), still)?;
                detections.warnings = info.warnings.clone();
                detections.every = blueprint.config().multi_target.unwrap_or_default().every;
                (frames, None, given)
            }
        };
        let of = |measure| Measured::new((measure, args), (&opened, source), many, (&blueprint, seed));
        let measured = args.measure.as_ref().map(of).transpose()?;
        let many = many || measured.as_ref().is_some_and(Measured::is_several);
        let report = !args.no_report;
        let outputs = Outputs {
            many,
            video: !args.no_video && !opened.endless,
            report,
            surface: report && !many && subject.has_surface(),
            trace: args.trace,
            regret: args.regret,
            measure: measured.is_some(),
            endless: opened.endless,
        };
        if !many {
            let truth = known_truth(source);
            info.truth = truth.iter().map(|bbox| bbox.map(|bbox| args.input.scaled(&bbox))).collect();
            info.shadow = shadow;
        }
        let (json, stream, inputs) = (args.json, args.stream.as_ref(), args.inputs(source));
        let (load_state, save_state) = (args.load_state.as_deref(), args.save_state.as_deref());
        let job = Job {
            source,
            out,
            json,
            stream,
            seed,
            about,
            frames,
            init,
            given,
            info,
            outputs,
            inputs,
            load_state,
            save_state,
        };
        job.check_written(args.save_state.as_deref().or(args.many.save_detections.as_deref()))?;
        Ok(Self { opened, subject, job, measured })
    }
}

impl Subject {
    /// Returns whether the gaze policy of one target has a surface.
    fn has_surface(&self) -> bool {
        matches!(self, Self::One(tracker) if SurfacePicture::shows(tracker.parts().gaze.policy().snapshot()))
    }

    /// Returns the tracker, and the detections of many targets.
    pub(super) fn parts(&mut self) -> (AnyTracker<'_>, Option<&mut Detections>) {
        match self {
            Self::One(tracker) => (AnyTracker::One(tracker), None),
            Self::Many(tracker, detections, _) => (AnyTracker::Many(tracker), Some(detections)),
        }
    }
}

impl Job<'_> {
    /// Refuses an output file whose folder is missing (the results folder will be created), or that would replace an input file or a
    /// result.
    fn check_written(&self, path: Option<&Path>) -> Result<()> {
        let Some(path) = path else { return Ok(()) };
        let (folder, out) = (files::folder_of(path), self.out);
        if folder != out || folder.is_dir() {
            writable(path)?;
        }
        let result = |name: &&str| path.file_name().is_some_and(|n| n == *name);
        let same = || {
            folder == out
                || std::fs::canonicalize(folder).ok().zip(std::fs::canonicalize(out).ok()).is_some_and(|(a, b)| a == b)
        };
        if self.outputs.names().iter().chain(&["run.json"]).any(result) && same() {
            return Err(Error::malformed(path, "a result of the run has this name; give another name"));
        }
        spare(path, &self.inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())
    }

    /// Begins the results. From here on, standard output is reserved for the lines of --stream.
    pub(super) fn begin_results(&self) -> Result<Results> {
        if self.stream.is_some_and(StreamTo::takes_output) {
            terminal::give_output();
        }
        let begin = if self.outputs.endless { Results::begin_live } else { Results::begin };
        let inputs = self.inputs.iter().map(PathBuf::as_path).chain(self.load_state);
        begin(self.out, &self.outputs.names(), &inputs.collect::<Vec<_>>())
    }

    /// Writes the files beside the results: the state of one target for --load-state, or the detections of many.
    pub(super) fn save(&self, subject: &Subject, next_frame: usize) -> Result<()> {
        match (subject, self.save_state) {
            (Subject::Many(_, detections, _), _) => detections.save(),
            (Subject::One(tracker), Some(path)) => {
                SavedState::write(path, (self.source, &self.about), next_frame, tracker.save())
            }
            (Subject::One(_), None) => Ok(()),
        }
    }
}

/// Returns the frames of a run with one target, its first box, and the boxes of restarts. If there is a saved state, restores it in the
/// tracker and returns no first box.
fn begin(
    (args, source): (&Args, &Path),
    (tracker, saved): (&mut Tracker, Option<(&Path, SavedState)>),
    selection: Selection,
    about: &SourceInfo,
) -> Result<(Frames, Option<BBox>, Vec<Given>)> {
    let frames = |from: usize, start: &'static str| Frames::new(from, start, args.until, about);
    let (frames, init) = match saved {
        Some((path, saved)) => {
            let frames = frames(saved.next_frame, "the saved state continues")?;
            tracker.load(&saved.tracker).map_err(of_file(path))?;
            saved.check_size(path, about)?;
            let (then, now) = (&saved.source, video_name(source));
            if *then != now {
                note!("foveate: the state was saved in {then:?}, and continues in {now:?}: is it the same video?");
            }
            (frames, None)
        }
        None => {
            let frames =
                frames(selection.from, if selection.from == 0 { "the video begins" } else { "--from begins" })?;
            let bbox = first_box(source, args.init.first().copied(), &args.input)?;
            check_box("the first box", &bbox, about)?;
            (frames, Some(bbox))
        }
    };
    let again = check_again(&args.reinit, frames, about)?;
    if let Some(given) = again.iter().find(|given| !selection.takes(given.frame)) {
        let frame = given.frame + 1;
        return Err(Error::Invalid(format!("--reinit {frame}: --every leaves this frame out; give another frame")));
    }
    Ok((frames, init, again))
}

/// Refuses tiled pictures for many targets, and for a configuration that reads whole pictures.
fn check_reads_tiles(blueprint: &Blueprint, source: &Path, config_name: &str, many: bool) -> Result<()> {
    let source = source.display();
    if many {
        return Err(Error::Invalid(format!("{source}: many targets and detectors need whole pictures, not tiles")));
    }
    if blueprint.config().sensor.is_none() {
        return Err(Error::Config(format!(
            "{source}: pictures in tiles are for a configuration with [sensor], such as --config foveated; {config_name} reads whole pictures"
        )));
    }
    Ok(())
}

/// Refuses the options of one target.
fn refuse(args: &Args, source: &Path) -> Result<()> {
    if args.load_state.is_some() {
        let problem = "--load-state is for one target, which it has; leave --detect, --detections and --inits out";
        return Err(Error::Invalid(problem.into()));
    }
    for (given, name) in [
        (!args.reinit.is_empty(), "--reinit"),
        (args.save_state.is_some(), "--save-state"),
        (args.regret, "--regret"),
        (args.trace, "--trace"),
        (args.profile.is_some(), "--profile"),
        (Selection { scale: 1.0, ..args.input.selection() } != Selection::default(), "--from or --every"),
    ] {
        if given {
            return Err(Error::Invalid(format!(
                "{name} is for one target; leave it out, or give one --init and no --detect, --detections, --inits"
            )));
        }
    }
    if args.many.save_detections.is_some() && is_endless(source) {
        return Err(Error::Invalid("--save-detections is for videos with an end; leave it out".into()));
    }
    Ok(())
}

/// Returns the given boxes of many targets: those of --init in frame 1, and those of --inits. All must touch the picture. There must be some
/// if they are `alone`, without detections.
fn given(args: &Args, source: &Path, about: &SourceInfo, alone: bool) -> Result<Vec<Given>> {
    let mut given = vec![];
    for (i, init) in args.init.iter().enumerate() {
        let bbox = first_box(source, Some(*init), &args.input)?;
        check_box(&format!("the first box of target {}", i + 1), &bbox, about)?;
        given.push(Given { frame: 0, id: None, bbox });
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
        given.push(Given { frame: s.frame, id, bbox: s.bbox });
    }
    let mut seen = BTreeSet::new();
    let twice = given.iter().find(|given| given.id.is_some() && !seen.insert((given.frame, given.id)));
    if let Some(Given { frame, id: Some(id), .. }) = twice {
        let frame = frame + 1;
        let problem = format!("frame {frame}: two boxes of target {id}; give one, or other ids");
        return Err(Error::malformed(path, problem));
    }
    if alone {
        if given.is_empty() {
            return Err(Error::malformed(path, "it has no box; give lines frame,id,x,y,w,h"));
        }
        if let Some(until) = args.until.filter(|until| given.iter().all(|given| given.frame as u64 >= *until)) {
            let problem =
                format!("it has no box up to frame {until}, the last one (--until); nothing would be tracked");
            return Err(Error::malformed(path, problem));
        }
    }
    Ok(given)
}

/// Fails if so many first boxes need more memory than allowed.
fn check_memory(many: &MultiTracker, given: &[Given], about: &SourceInfo) -> Result<()> {
    if given.is_empty() {
        return Ok(());
    }
    let side = |of: fn(&BBox) -> f64| given.iter().map(|given| of(&given.bbox)).sum::<f64>() / given.len() as f64;
    many.check_room(given.len(), &BBox::new(0.0, 0.0, side(|b| b.w), side(|b| b.h)), about.size())
}
