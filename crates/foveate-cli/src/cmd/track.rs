//! `foveate track`: follow a target through a video file or a folder of images.

use std::path::{Path, PathBuf};

use foveate::config::{BUILTIN, Blueprint, Config, RecogniserConfig};
use foveate::eval::line_up;
use foveate::geometry::BBox;
use foveate::observe::{
    Boxes, Clock, Film, Observer, RegretFiles, Report, RunInfo, Summary, SurfacePicture, Table, Trace,
};
use foveate::run::{Follow, Outcome, follow_with};
use foveate::scene::{SourceInfo, ahead, annotation, motion, open};
use foveate::{Error, Result, files};

use crate::terminal;

mod many;

/// The recogniser that ships with the program.
pub const DIGITS: &str = "builtin:digits";

#[derive(clap::Args)]
pub struct Args {
    /// A video file, or a folder of images
    source: PathBuf,
    /// The target's box in the first frame: left, top, width, height in pixels, counted from 1 as in boxes.txt.
    /// `motion` takes what moves between the first two frames (the camera must stand still); `motion:W,H` gives it that size.
    /// Left out, the first line of groundtruth_rect.txt in the folder is taken. Given several times, many targets are followed
    #[arg(long, value_name = "X,Y,W,H|motion", value_parser = parse_init, allow_hyphen_values = true)]
    init: Vec<Init>,
    #[command(flatten)]
    many: many::ManyArgs,
    /// Restart on the target at a later frame (counted from 1) with a new box; may be given several times
    #[arg(long, value_name = "FRAME:X,Y,W,H", value_parser = parse_again, allow_hyphen_values = true)]
    reinit: Vec<(usize, BBox)>,
    /// Folder for the results: boxes.txt, track.csv, trace.jsonl, annotated.mp4, report.html, surface.png
    #[arg(long, short, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// A configuration file, or the name of one that ships with the program (natural, digits, ...); natural if left out
    #[arg(long, short, value_name = "FILE|NAME")]
    config: Option<String>,
    /// How much time a frame may take, where no configuration is given
    #[arg(long, value_enum, conflicts_with = "config")]
    profile: Option<Profile>,
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
    /// Say what the target is, by a model of `foveate train classifier` or `train fixations`; without MODEL, which digit it is. Its class stands
    /// in track.csv, trace.jsonl, video and report; the track stays the same. It takes the place of the configuration's
    /// recogniser
    #[arg(long, visible_alias = "recognize", value_name = "MODEL", num_args = 0..=1, default_missing_value = DIGITS)]
    recognise: Option<String>,
    /// Leave out annotated.mp4
    #[arg(long)]
    no_video: bool,
    /// Leave out report.html and surface.png
    #[arg(long)]
    no_report: bool,
    /// Leave out trace.jsonl
    #[arg(long)]
    no_trace: bool,
}

/// Configurations for real video, by the time they take.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub enum Profile {
    /// Thousands of frames a second: natural-fast
    Fast,
    /// What is taken unless told otherwise: natural
    Balanced,
    /// Some hundred frames a second: natural-accurate
    Accurate,
}

/// The configuration asked for by name or by profile; `natural` unless told otherwise.
pub fn config_name(config: Option<&str>, profile: Option<Profile>) -> &str {
    match (config, profile) {
        (Some(name), _) => name,
        (None, Some(Profile::Fast)) => "natural-fast",
        (None, Some(Profile::Accurate)) => "natural-accurate",
        (None, Some(Profile::Balanced) | None) => "natural",
    }
}

/// Where the first box comes from.
#[derive(Clone, Copy)]
enum Init {
    Given(BBox),
    /// What moved, in a box of its own size or of a given one.
    Motion(Option<(f64, f64)>),
}

fn parse_init(text: &str) -> std::result::Result<Init, String> {
    let Some(size) = text.strip_prefix("motion") else { return parse_box(text).map(Init::Given) };
    let sides = size.strip_prefix(':').and_then(|s| s.split_once(','));
    let sides = sides.and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    match sides {
        None if size.is_empty() => Ok(Init::Motion(None)),
        Some((w, h)) if (1.0..1e5).contains(&w) && (1.0..1e5).contains(&h) => Ok(Init::Motion(Some((w, h)))),
        _ => Err(format!("expected motion, or motion:w,h such as motion:28,28, got \"{text}\"")),
    }
}

/// `x,y,w,h` counted from 1, to a box counted from 0.
fn parse_box(text: &str) -> std::result::Result<BBox, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse())
        .collect::<std::result::Result<_, _>>()
        .map_err(|_| format!("expected four numbers x,y,w,h such as 120,80,40,60, got \"{text}\""))?;
    match numbers[..] {
        [x, y, w, h] if numbers.iter().all(|n| n.is_finite()) => Ok(BBox { x: x - 1.0, y: y - 1.0, w, h }),
        _ => Err(format!("expected four finite numbers x,y,w,h such as 120,80,40,60, got \"{text}\"")),
    }
}

fn parse_again(text: &str) -> std::result::Result<(usize, BBox), String> {
    let (frame, bbox) = text.split_once(':').ok_or_else(|| format!("expected FRAME:x,y,w,h, got \"{text}\""))?;
    let frame = frame.parse().ok().filter(|f| *f > 1);
    Ok((frame.ok_or_else(|| format!("expected a frame number from 2 on, got \"{text}\""))?, parse_box(bbox)?))
}

/// A configuration by file or by name: how it is called, and what it says.
pub fn blueprint(name: &str) -> Result<Blueprint> {
    let path = Path::new(name);
    if path.is_file() {
        return Config::read(path)?.check(path.parent().unwrap_or(Path::new(".")));
    }
    match Config::builtin(name) {
        Some(config) => config?.check(Path::new(".")),
        None => Err(Error::Config(format!(
            "there is no configuration file {name}, and none of that name ships with the program; those that do: {}",
            BUILTIN.iter().map(|b| b.0).collect::<Vec<_>>().join(", ")
        ))),
    }
}

/// What is written beside boxes.txt and track.csv.
#[derive(Clone, Copy)]
pub struct Outputs {
    pub video: bool,
    pub report: bool,
    pub trace: bool,
}

/// All that watch a run.
type Observers = Vec<Box<dyn Observer>>;

/// The observers that write a run's files into `out`, and the names of those files.
pub fn observers(out: &Path, info: &RunInfo, outputs: Outputs) -> Result<(Observers, Vec<PathBuf>)> {
    std::fs::create_dir_all(out).map_err(Error::io(out, "cannot create the folder for results"))?;
    let mut names = vec![out.join("boxes.txt"), out.join("track.csv")];
    let mut observers: Observers = vec![Box::new(Boxes::create(&names[0])?), Box::new(Table::create(&names[1])?)];
    if outputs.trace {
        names.push(out.join("trace.jsonl"));
        observers.push(Box::new(Trace::create(out.join("trace.jsonl"))?));
    }
    if outputs.video {
        names.push(out.join("annotated.mp4"));
        observers.push(Box::new(Film::create(out.join("annotated.mp4"), info)?));
    }
    if outputs.report {
        names.push(out.join("report.html"));
        observers.push(Box::new(Report::create(out.join("report.html"), info.clone())?));
        names.push(out.join("surface.png"));
        observers.push(Box::new(SurfacePicture::create(out.join("surface.png"), info.clone())?));
    }
    if !info.shadow.is_empty() {
        names.extend(["regret.csv", "regret.svg"].map(|name| out.join(name)));
        observers.push(Box::new(RegretFiles::create(out, info.shadow.clone())?));
    }
    Ok((observers, names))
}

/// What is known of a run before it begins.
pub fn run_info(source: &str, info: &SourceInfo, config_name: &str, blueprint: &Blueprint, seed: u64) -> RunInfo {
    RunInfo {
        source: source.to_owned(),
        reader: info.reader.clone(),
        rate: info.rate,
        config_name: config_name.to_owned(),
        config_text: blueprint.config().to_toml(),
        seed,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        retina: Some(blueprint.retina()),
        truth: vec![],
        clock: Clock::default(),
        shadow: vec![],
    }
}

pub fn run(args: Args) -> Result<()> {
    let is_many = args.many.asked() || args.init.len() > 1;
    let name = match (&args.config, args.profile) {
        (None, None) if is_many => args.many.config(),
        (config, profile) => config_name(config.as_deref(), profile),
    };
    let mut blueprint = blueprint(name)?;
    if let Some(model) = &args.recognise {
        blueprint = blueprint.recognising(RecogniserConfig::of_model(model, Path::new(".")), Path::new("."))?;
    }
    let shadow = if args.regret { line_up::rivals(&blueprint.config().policy).gazes() } else { vec![] };
    blueprint = blueprint.shadowing(shadow.clone());
    let seed = args.seed.unwrap_or(blueprint.config().seed);
    if is_many {
        let boxes = args.init.iter().map(|init| first_box(&args, Some(*init))).collect::<Result<Vec<_>>>()?;
        return many::run(&args, &boxes, &blueprint, name, seed);
    }
    let mut tracker = blueprint.tracker(seed, 0)?;
    let mut source = ahead(open(&args.source)?);
    let loaded = args.load_state.as_deref().map(read_state).transpose()?;
    let init = match &loaded {
        Some(saved) => {
            tracker.load(&saved.tracker)?;
            None
        }
        None => Some(first_box(&args, args.init.first().copied())?),
    };
    let from = loaded.map_or(0, |saved| saved.next_frame);
    let mut info = run_info(&args.source.display().to_string(), source.info(), name, &blueprint, seed);
    info.truth = known_truth(&args.source);
    info.shadow = shadow;
    let outputs = Outputs { video: !args.no_video, report: !args.no_report, trace: !args.no_trace };
    let (mut observers, names) = observers(&args.out, &info, outputs)?;

    terminal::catch_interrupts();
    let again: Vec<(usize, BBox)> = args.reinit.iter().map(|(frame, bbox)| (frame - 1, *bbox)).collect();
    let bar = terminal::progress(source.info().frames, "tracking");
    let mut next_frame = from;
    let plan = Follow {
        init,
        again: &again,
        from,
        until: args.until.map_or(usize::MAX, |until| until as usize - 1),
        stop: &terminal::stopping,
        clock: info.clock.clone(),
        progress: &mut |frame| {
            next_frame = frame.index + 1;
            bar.set_position(next_frame as u64);
        },
    };
    let (outcome, result) = follow_with(&mut blueprint.scout(), &mut *source, &mut tracker, &mut observers, plan);
    bar.finish_and_clear();
    if let (Some(path), true) = (&args.save_state, outcome.frames > 0) {
        let saved = SavedState { next_frame, tracker: tracker.save() };
        let text = serde_json::to_string(&saved).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write(path, text.as_bytes())?;
    }
    report(&args, &outcome, seed, names, &result);
    result?;
    if outcome.stopped {
        std::process::exit(130);
    }
    Ok(())
}

/// A tracker in mid-video, as a file.
#[derive(serde::Serialize, serde::Deserialize)]
struct SavedState {
    next_frame: usize,
    tracker: serde_json::Value,
}

fn read_state(path: &Path) -> Result<SavedState> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path, "cannot read the saved state"))?;
    serde_json::from_str(&text)
        .map_err(|e| Error::malformed(path, format!("not a state written by --save-state: {e}; write it again")))
}

/// The truth, where the source has one, for the report to compare with; it never reaches the tracker.
fn known_truth(source: &Path) -> Vec<BBox> {
    let truth = annotation::read_truth(source.join("groundtruth_rect.txt")).unwrap_or_default();
    truth.into_iter().map_while(|bbox| bbox).collect()
}

/// The given box, or the first one of groundtruth_rect.txt.
fn first_box(args: &Args, init: Option<Init>) -> Result<BBox> {
    match init {
        Some(Init::Given(bbox)) => return Ok(bbox),
        Some(Init::Motion(size)) => return moving(args, size),
        None => {}
    }
    let truth = args.source.join("groundtruth_rect.txt");
    if !truth.is_file() {
        return Err(Error::Invalid(format!(
            "{}: no box to start from; give --init x,y,w,h (left, top, width, height in pixels, counted from 1)",
            args.source.display()
        )));
    }
    annotation::read_truth(&truth)?
        .first()
        .copied()
        .flatten()
        .ok_or_else(|| Error::malformed(&truth, "its first line has no box; give --init x,y,w,h"))
}

/// The box of what moves between the first two frames.
fn moving(args: &Args, size: Option<(f64, f64)>) -> Result<BBox> {
    let mut frames = open(&args.source)?.take(2);
    let pair = (frames.next().transpose()?, frames.next().transpose()?);
    let found = match pair {
        (Some(a), Some(b)) => motion::first_box(&a.image, &b.image, size),
        _ => None,
    };
    found.ok_or_else(|| {
        let source = args.source.display();
        Error::Invalid(format!("{source}: nothing moves between the first two frames; give --init x,y,w,h"))
    })
}

fn report(args: &Args, outcome: &Outcome, seed: u64, outputs: Vec<PathBuf>, result: &Result<()>) {
    let seconds = outcome.tracking.as_secs_f64();
    let fps = Summary::rate(outcome.frames, seconds);
    let bbox = outcome.boxes.last().copied();
    if args.json {
        let summary = Summary {
            source: args.source.display().to_string(),
            frames: outcome.frames,
            seconds,
            fps,
            lost_frames: outcome.lost,
            bbox,
            class: outcome.class,
            class_name: outcome.class_name.clone(),
            seed,
            outputs,
            error: result.as_ref().err().map(ToString::to_string),
        };
        say!("{}", summary.to_json());
        return;
    }
    let lost = if outcome.lost == 0 { "never lost".into() } else { format!("lost on {} of them", outcome.lost) };
    say!("{} frames tracked, {lost}; {fps:.0} frames a second in the tracker.", outcome.frames);
    if let Some(b) = bbox {
        say!("Last box: {:.1},{:.1},{:.1},{:.1} (x,y,w,h, counted from 1).", b.x + 1.0, b.y + 1.0, b.w, b.h);
    }
    if let Some((class, p)) = outcome.class {
        let name = outcome.class_name.clone().unwrap_or_else(|| format!("class {class}"));
        say!("Recognised as {name}, with probability {p:.3}.");
    }
    let names: Vec<String> = outputs.iter().filter_map(|o| o.file_name()).map(|n| n.to_string_lossy().into()).collect();
    say!("{}: {}", args.out.display(), names.join(", "));
}
