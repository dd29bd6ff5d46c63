//! `foveate track` of many targets: with a detector, with detections from a file, or with several first boxes.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use foveate::config::Blueprint;
use foveate::geometry::BBox;
use foveate::many::{Followed, Plan, follow};
use foveate::observe::{CrowdFilm, CrowdReport, ManyObserver, MotFile, RunInfo, TargetsTable, TracksTable};
use foveate::scene::mot::{Sighting, Tracks};
use foveate::scene::{Cuts, Detection, Detector, Flow, Frame, Image, Motion, Saliency, Walkers, ahead, open};
use foveate::{Error, Result};

use super::Args;
use crate::terminal;

/// What makes it many targets.
#[derive(clap::Args)]
pub struct ManyArgs {
    /// Follow everything that a detector finds, with no box drawn: targets are born, die, and are known again when they
    /// come back. Without KIND, motion (the camera must stand still)
    #[arg(long, value_enum, value_name = "KIND", num_args = 0..=1, default_missing_value = "motion", conflicts_with = "detections")]
    pub detect: Option<Kind>,
    /// Follow what another detector found: MOTChallenge's text (frame,id,x,y,w,h,conf,...; ids are not read)
    #[arg(long, value_name = "FILE")]
    pub detections: Option<PathBuf>,
    /// Least confidence at which a line of --detections counts
    #[arg(long, value_name = "CONF", default_value_t = 0.0, requires = "detections", allow_hyphen_values = true)]
    pub least: f64,
    /// First boxes of many targets: frame,id,x,y,w,h a line, counted from 1, as in MOTChallenge's text
    #[arg(long, value_name = "FILE")]
    pub inits: Option<PathBuf>,
    /// Write what the detector found, in MOTChallenge's text, for --detections or other trackers
    #[arg(long, value_name = "FILE")]
    pub save_detections: Option<PathBuf>,
}

/// Detectors that need no model.
#[derive(ValueEnum, Clone, Copy, PartialEq)]
pub enum Kind {
    /// What differs from the background; for a camera that stands still
    Motion,
    /// The same, with boxes for upright walkers: parts above each other are joined, what is too wide is cut
    Walkers,
    /// What is unlike its surroundings
    Saliency,
    /// What moves otherwise than the camera
    Flow,
}

impl Kind {
    fn detector(self, background: &[Image]) -> Box<dyn Detector> {
        match self {
            Self::Motion => {
                let mut motion = Motion::default();
                motion.patience = u8::MAX;
                motion.learn_background(background);
                Box::new(motion)
            }
            Self::Walkers => {
                let mut walkers = Walkers::default();
                walkers.learn_background(background);
                Box::new(walkers)
            }
            Self::Saliency => Box::<Saliency>::default(),
            Self::Flow => Box::<Flow>::default(),
        }
    }
}

/// Frames that the background is learned from, and how far into the video they lie.
const PICTURES: usize = 40;
const AHEAD: usize = 400;

/// Pictures from all over the beginning of a video, up to its first cut.
fn background(source: &Path) -> Result<Vec<Image>> {
    let frames = open(source)?;
    let every = frames.info().frames.map_or(AHEAD, |n| n.min(AHEAD)).div_ceil(PICTURES).max(1);
    let (mut cuts, mut pictures) = (Cuts::default(), vec![]);
    // Where the source breaks, tracking will say so when it comes there.
    for frame in ahead(frames).take(AHEAD).map_while(Result::ok) {
        if cuts.cut(&frame.image) {
            break;
        }
        if frame.index.is_multiple_of(every) {
            pictures.push(frame.image);
        }
    }
    Ok(pictures)
}

impl ManyArgs {
    /// The configuration that ships for this: with what moves, with other detections, or with first boxes alone.
    pub fn config(&self) -> &'static str {
        match self.detect {
            Some(Kind::Motion | Kind::Walkers | Kind::Flow) => "many-motion",
            None if self.detections.is_none() => "many-boxes",
            _ => "many",
        }
    }

    /// Whether many targets are asked for, apart from several --init.
    pub fn asked(&self) -> bool {
        self.detect.is_some() || self.detections.is_some() || self.inits.is_some() || self.save_detections.is_some()
    }
}

/// Follows many targets; `boxes` are the first ones of frame 1.
pub fn run(args: &Args, boxes: &[BBox], blueprint: &Blueprint, config_name: &str, seed: u64) -> Result<()> {
    refuse(args)?;
    let given = given(args, boxes)?;
    let mut detections = Detections::of(args)?;
    let mut many = blueprint.many(seed)?;
    let mut source = ahead(open(&args.source)?);
    let info = super::run_info(&args.source.display().to_string(), source.info(), config_name, blueprint, seed);
    let (mut observers, names) = observers(args, &info)?;
    terminal::catch_interrupts();
    let bar = terminal::progress(source.info().frames, "tracking");
    let plan = Plan {
        given: &given,
        from: 0,
        until: args.until.map_or(usize::MAX, |until| until as usize - 1),
        cuts: Some(Cuts::default()),
        stop: &terminal::stopping,
        clock: info.clock.clone(),
        progress: &mut |frame| bar.set_position(frame.index as u64 + 1),
    };
    let (outcome, result) =
        follow(&mut *source, &mut many, &mut |f, cut, found| detections.next(f, cut, found), &mut observers, plan);
    bar.finish_and_clear();
    detections.save(&args.many)?;
    report(args, &outcome, &names, &result);
    result?;
    if outcome.stopped {
        std::process::exit(130);
    }
    Ok(())
}

/// Options that belong to one target.
fn refuse(args: &Args) -> Result<()> {
    for (given, name) in [
        (!args.reinit.is_empty(), "--reinit"),
        (args.load_state.is_some(), "--load-state"),
        (args.save_state.is_some(), "--save-state"),
        (args.regret, "--regret"),
    ] {
        if given {
            return Err(Error::Invalid(format!(
                "{name} is for one target; leave it out, or give one --init and no --detect, --detections, --inits"
            )));
        }
    }
    Ok(())
}

/// The boxes given by hand: those of --init in frame 1, and those of --inits.
fn given(args: &Args, boxes: &[BBox]) -> Result<Vec<(usize, Option<u64>, BBox)>> {
    let mut given: Vec<_> = boxes.iter().map(|bbox| (0, None, *bbox)).collect();
    let Some(path) = &args.many.inits else { return Ok(given) };
    let tracks = Tracks::read(path)?;
    for s in &tracks.sightings {
        let id = match s.id {
            -1 => None,
            id @ 0.. => Some(id as u64),
            id => {
                return Err(Error::malformed(
                    path,
                    format!("frame {}: id {id}; give 0 or more, or -1 for a new one", s.frame + 1),
                ));
            }
        };
        given.push((s.frame, id, s.bbox));
    }
    if given.is_empty() && args.many.detect.is_none() && args.many.detections.is_none() {
        return Err(Error::malformed(path, "it has no box; give lines frame,id,x,y,w,h"));
    }
    Ok(given)
}

/// Where detections come from, and what came.
struct Detections {
    kind: Option<Kind>,
    detector: Option<Box<dyn Detector>>,
    read: Vec<Vec<Detection>>,
    kept: Option<Tracks>,
}

impl Detections {
    fn of(args: &Args) -> Result<Self> {
        let (source, args) = (&args.source, &args.many);
        let mut read = vec![];
        if let Some(path) = &args.detections {
            let tracks = Tracks::read(path)?;
            read.resize(tracks.frames(), vec![]);
            let counts = |s: &&Sighting| s.confidence >= args.least && s.bbox.w >= 1.0 && s.bbox.h >= 1.0;
            for s in tracks.sightings.iter().filter(counts) {
                read[s.frame].push(Detection { bbox: s.bbox, score: s.confidence });
            }
        }
        let kept = args.save_detections.is_some().then(Tracks::default);
        let pictures = match args.detect {
            Some(Kind::Motion | Kind::Walkers) => background(source)?,
            _ => vec![],
        };
        Ok(Self { kind: args.detect, detector: args.detect.map(|kind| kind.detector(&pictures)), read, kept })
    }

    fn next(&mut self, frame: &Frame, cut: bool, found: &mut Vec<Detection>) -> Result<()> {
        if let (true, Some(kind)) = (cut, self.kind) {
            self.detector = Some(kind.detector(&[]));
        }
        match &mut self.detector {
            Some(detector) => detector.detect(frame, found),
            None => found.extend_from_slice(self.read.get(frame.index).map_or(&[], Vec::as_slice)),
        }
        if let Some(kept) = &mut self.kept {
            kept.sightings.extend(found.iter().map(|d| Sighting {
                frame: frame.index,
                id: -1,
                bbox: d.bbox,
                confidence: d.score,
            }));
        }
        Ok(())
    }

    fn save(&self, args: &ManyArgs) -> Result<()> {
        match (&args.save_detections, &self.kept) {
            (Some(path), Some(kept)) => kept.write(path),
            _ => Ok(()),
        }
    }
}

type Observers = Vec<Box<dyn ManyObserver>>;

/// The observers that write a run's files into `out`, and the names of those files.
fn observers(args: &Args, info: &RunInfo) -> Result<(Observers, Vec<PathBuf>)> {
    let out = &args.out;
    std::fs::create_dir_all(out).map_err(Error::io(out, "cannot create the folder for results"))?;
    let names = ["tracks.txt", "tracks.csv", "targets.csv"].map(|name| out.join(name));
    let mut observers: Observers = vec![
        Box::new(MotFile::create(&names[0])?),
        Box::new(TracksTable::create(&names[1])?),
        Box::new(TargetsTable::create(&names[2])?),
    ];
    let mut names = names.to_vec();
    if !args.no_video {
        names.push(out.join("annotated.mp4"));
        observers.push(Box::new(CrowdFilm::create(out.join("annotated.mp4"), info)?));
    }
    if !args.no_report {
        names.push(out.join("report.html"));
        observers.push(Box::new(CrowdReport::create(out.join("report.html"), info.clone())?));
    }
    Ok((observers, names))
}

fn report(args: &Args, outcome: &Followed, outputs: &[PathBuf], result: &Result<()>) {
    let (tracking, detecting) = (outcome.tracking.as_secs_f64(), outcome.detecting.as_secs_f64());
    let Followed { frames, born, found, cuts, most, .. } = outcome;
    if args.json {
        let summary = serde_json::json!({
            "source": args.source.display().to_string(), "frames": frames, "targets": born, "found": found, "cuts": cuts,
            "most_at_a_time": most, "tracking_seconds": tracking, "detecting_seconds": detecting, "outputs": outputs,
            "error": result.as_ref().err().map(ToString::to_string),
        });
        say!("{}", serde_json::to_string_pretty(&summary).expect("plain data is JSON"));
        return;
    }
    let rate = |seconds: f64| if seconds > 0.0 { *frames as f64 / seconds } else { 0.0 };
    say!(
        "{frames} frames, {born} targets, at most {most} at a time, {found} times one was found again, {cuts} cuts; \
         {:.0} frames a second in the trackers, {:.0} with detection.",
        rate(tracking),
        rate(tracking + detecting)
    );
    let names: Vec<String> = outputs.iter().filter_map(|o| o.file_name()).map(|n| n.to_string_lossy().into()).collect();
    say!("{}: {}", args.out.display(), names.join(", "));
}
