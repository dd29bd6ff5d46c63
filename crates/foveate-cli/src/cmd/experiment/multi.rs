//! `foveate experiment multi`: digits that grow, turn and pass over each other (section 6.1, the second experiment).

use std::path::{Path, PathBuf};

use foveate::config::{Blueprint, Config, RecogniserConfig};
use foveate::eval::experiment::{digest, fingerprint};
use foveate::eval::multi::{self, Alone, Line, Run};
use foveate::observe::{CrowdFilm, CrowdReport, CrowdStrip, ManyObserver, RunInfo};
use foveate::scene::Digits;
use foveate::scene::synthetic::{Multi, MultiVideo};
use foveate::{Error, Result};
use serde_json::json;

use super::runner::{Kept, Store, whole};
use super::{Videos, keep};
use crate::cmd::synth::MultiScene;
use crate::cmd::track::{DIGITS, blueprint};

/// Digits that grow, turn and pass over each other, all followed from their true first boxes.
///
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
pub struct Args {
    /// A configuration file, or the name of one that ships with the program; may be repeated
    #[arg(long, short, value_name = "FILE", default_value = "digits-multi")]
    config: Vec<String>,
    #[command(flatten)]
    scene: MultiScene,
    #[command(flatten)]
    videos: Videos,
    /// Folder for table.txt, table.json and the finished runs
    #[arg(long, short, value_name = "DIR", default_value = "out/multi")]
    out: PathBuf,
    /// The recogniser that says which digit is which; it does not change the tracks
    #[arg(long, visible_alias = "recognize", value_name = "MODEL", default_value = DIGITS)]
    recognise: String,
    /// Show the first video, as followed by the first configuration: figure.png (the film strip), annotated.mp4, report.html
    #[arg(long)]
    figure: bool,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
}

impl Kept for Run {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// A way to follow all targets.
pub struct Way {
    pub name: String,
    pub blueprint: Blueprint,
    /// Whether targets know of each other.
    together: bool,
    /// What its results depend on: configuration, models, program.
    key: String,
}

impl Way {
    /// With the recogniser's model that says which digit is which; model files are found relative to `base`.
    pub fn of(name: String, config: Config, base: &Path, recognise: &str, together: bool) -> Result<Self> {
        // The seed of each run is its video's.
        let recogniser = RecogniserConfig::multi_fixation(recognise);
        let blueprint = Config { seed: 0, ..config }.check(base)?.recognising(recogniser, Path::new("."))?;
        let (print, text) = (fingerprint(&blueprint)?, blueprint.config().to_toml());
        let how = if together { "together" } else { "alone" };
        let key = format!("{} {print} {text} {how}", env!("CARGO_PKG_VERSION"));
        Ok(Self { name, blueprint, together, key })
    }

    pub fn follow(&self, video: &MultiVideo, seed: u64, observer: &mut dyn ManyObserver) -> Result<Run> {
        if self.together {
            return Run::follow(video, &mut self.blueprint.many(seed)?, observer);
        }
        let ids = 1..=video.movers().len() as u64;
        let trackers = ids.map(|id| self.blueprint.tracker(seed, id)).collect::<Result<Vec<_>>>()?;
        Run::follow(video, &mut Alone::new(trackers), observer)
    }
}

fn ways(args: &Args) -> Result<Vec<Way>> {
    let mut ways = vec![];
    for name in &args.config {
        let config = blueprint(name)?.config().clone();
        let file = Path::new(name);
        let base = if file.is_file() { file.parent().unwrap_or(Path::new(".")) } else { Path::new(".") };
        let stem = file.file_stem().filter(|_| file.is_file());
        let shown = stem.map_or_else(|| name.clone(), |stem| stem.to_string_lossy().into_owned());
        for (together, how) in [(true, "together"), (false, "alone")] {
            ways.push(Way::of(format!("{shown}, {how}"), config.clone(), base, &args.recognise, together)?);
        }
    }
    Ok(ways)
}

pub fn run(args: Args) -> Result<()> {
    let (digits, from) = args.videos.digits()?;
    let ways = ways(&args)?;
    let (seeds, frames) = (args.videos.seeds(), args.videos.frames());
    let scenes: Vec<Multi> = seeds.map(|seed| args.scene.settings(seed, frames)).collect();
    let crowd = Crowd::new(scenes, (&digits, &from))?;
    let runs = whole(crowd.runs("multi", &Store::of(&args.out), &ways)?);
    report(&args, &from, &crowd.lines(&ways, &runs)?)?;
    if args.figure { figure(&args, &ways[0], &crowd, &from) } else { Ok(()) }
}

/// Videos of many targets.
pub struct Crowd<'a> {
    scenes: Vec<Multi>,
    videos: Vec<MultiVideo>,
    digits: &'a Digits,
    /// What the digits are.
    from: &'a str,
}

impl<'a> Crowd<'a> {
    /// The videos of some settings; with the digits comes what they are.
    pub fn new(scenes: Vec<Multi>, (digits, from): (&'a Digits, &'a str)) -> Result<Self> {
        let videos = scenes.iter().map(|scene| scene.video(digits)).collect::<Result<Vec<_>>>()?;
        Ok(Self { scenes, videos, digits, from })
    }

    /// All videos in each of the ways, way by way, done where they are not kept yet. Each tracker's randomness is named by
    /// the video's seed.
    pub fn runs(&self, name: &str, store: &Store, ways: &[Way]) -> Result<Vec<Option<Run>>> {
        let videos = 0..self.scenes.len();
        let jobs: Vec<(usize, usize)> =
            (0..ways.len()).flat_map(|way| videos.clone().map(move |video| (way, video))).collect();
        let pixels = digest(&[&self.digits.images, &self.digits.labels]);
        let key = |&(way, video): &(usize, usize)| {
            let scene = serde_json::to_vec(&self.scenes[video]).expect("settings are plain data");
            digest(&[ways[way].key.as_bytes(), &scene, pixels.as_bytes()])
        };
        let make = |&(way, video): &(usize, usize)| {
            let (way, scene) = (&ways[way], &self.scenes[video]);
            let run = way.follow(&self.videos[video], scene.seed, &mut Vec::<Box<dyn ManyObserver>>::new())?;
            let stored = json!({
                "configuration": way.blueprint.config(), "video": scene, "digits": self.from,
                "frames": run.frames, "found": run.found, "seconds": run.seconds,
            });
            let text = serde_json::to_vec(&stored).map_err(|e| Error::Invalid(e.to_string()))?;
            Ok((run, text))
        };
        store.kept(name, &jobs, &|&(_, video)| self.scenes[video].frames, &key, &make)
    }

    /// One line a way, of the runs as [`Crowd::runs`] gives them.
    pub fn lines(&self, ways: &[Way], runs: &[Run]) -> Result<Vec<Line>> {
        let mut lines = vec![];
        for (way, runs) in ways.iter().zip(runs.chunks(self.scenes.len())) {
            let judged =
                runs.iter().zip(&self.videos).map(|(run, video)| run.judge(video)).collect::<Result<Vec<_>>>()?;
            lines.extend(Line::of(&way.name, &runs.iter().collect::<Vec<_>>(), &judged));
        }
        Ok(lines)
    }

    /// The first video and its seed, of which pictures are made; `None` without any.
    pub fn first(&self) -> Option<(&MultiVideo, u64)> {
        Some((self.videos.first()?, self.scenes.first()?.seed))
    }
}

/// Pictures of a film strip, and how many stand in a row.
const SHOWN: usize = 8;
const COLUMNS: usize = 4;

/// The film strip of a video, to be written to `path`.
pub fn strip(path: PathBuf, video: &MultiVideo) -> Result<CrowdStrip> {
    let last = video.frames() - 1;
    let mut shown: Vec<usize> = (0..SHOWN).map(|i| (i * last + SHOWN / 2) / (SHOWN - 1)).map(|t| t.min(last)).collect();
    shown.dedup();
    let title = format!(
        "Digits that grow, turn and pass over each other · no 1 to {} are truly {}",
        video.movers().len(),
        classes(video)
    );
    CrowdStrip::create(path, &title, shown, COLUMNS)
}

fn classes(video: &MultiVideo) -> String {
    video.movers().iter().map(|mover| mover.class.to_string()).collect::<Vec<_>>().join(", ")
}

fn figure(args: &Args, way: &Way, crowd: &Crowd<'_>, from: &str) -> Result<()> {
    let Some((video, seed)) = crowd.first() else { return Ok(()) };
    let info = RunInfo {
        source: format!("synthetic digits {}", classes(video)),
        reader: from.into(),
        rate: 30.0,
        config_name: way.name.clone(),
        config_text: way.blueprint.config().to_toml(),
        seed,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        ..RunInfo::default()
    };
    let mut observers: Vec<Box<dyn ManyObserver>> = vec![
        Box::new(strip(args.out.join("figure.png"), video)?),
        Box::new(CrowdFilm::create(args.out.join("annotated.mp4"), &info)?),
        Box::new(CrowdReport::create(args.out.join("report.html"), info)?),
    ];
    way.follow(video, seed, &mut observers)?;
    observers.finish()?;
    say!("{}: figure.png, annotated.mp4, report.html", args.out.display());
    Ok(())
}

fn report(args: &Args, from: &str, lines: &[Line]) -> Result<()> {
    let videos = &args.videos;
    let scene = args.scene.settings(videos.first_seed, videos.frames());
    let text = format!(
        "{} digits that grow, turn and cross: {from}; {videos}, size 28 px times {} to {}, up to {}° from upright\n\n{}",
        scene.targets,
        scene.scale[0],
        scene.scale[1],
        scene.turn,
        multi::text(lines)
    );
    let all = json!({
        "experiment": "multi", "digits_from": from, "scene": scene, "seeds": videos.seeds, "lines": lines,
    });
    keep(&args.out, &text, &all, args.json, &[])
}
