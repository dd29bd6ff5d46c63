//! The paper's figures: one run over time, reward surfaces of digits, faces in real videos.

use std::path::Path;

use foveate::eval::sequence::find_sequences;
use foveate::eval::story::Story;
use foveate::geometry::BBox;
use foveate::observe::{Observer, RunInfo, Strip, SurfacePicture};
use foveate::run::{Follow, follow};
use foveate::scene::synthetic::Drawn;
use foveate::scene::{FrameSource, encode_png, open};
use foveate::step::Step;
use foveate::{Error, Result, files, scene};
use serde_json::{Value, json};

use super::Ground;
use super::plan::{Experiment, LineOf};
use crate::cmd::experiment::runner::{Entry, Job};
use crate::cmd::experiment::surfaces::{self, Learned, POINTS};
use crate::cmd::track::run_info;
use crate::terminal;

/// Stills of a film strip.
const STILLS: usize = 6;

/// A figure: pictures, and the numbers behind them.
pub struct Shown {
    pub pictures: Vec<Picture>,
    pub numbers: Value,
    /// What could not be shown, and why.
    pub missing: Vec<String>,
}

/// A picture of the page.
pub struct Picture {
    /// Its file's name: `.png` or `.svg`.
    pub file: String,
    pub caption: String,
    pub bytes: Vec<u8>,
}

/// A run that is watched for a figure.
struct Watched {
    story: Story,
    strip: Strip,
    surface: Option<SurfacePicture>,
}

impl Watched {
    fn each(&mut self, mut tell: impl FnMut(&mut dyn Observer) -> Result<()>) -> Result<()> {
        tell(&mut self.story)?;
        tell(&mut self.strip)?;
        self.surface.as_mut().map_or(Ok(()), |surface| tell(surface))
    }
}

impl Observer for Watched {
    fn start(&mut self, frame: &scene::Frame, bbox: &BBox) -> Result<()> {
        self.each(|o| o.start(frame, bbox))
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.each(|o| o.observe(step))
    }
    fn finish(&mut self) -> Result<()> {
        self.each(|o| o.finish())
    }
}

/// Follows a target through a source; `frames` is how many there are.
fn watch(
    source: &mut dyn FrameSource,
    entry: &Entry,
    (name, truth, frames): (&str, Vec<BBox>, usize),
    surface: Option<&Path>,
) -> Result<Watched> {
    let mut info: RunInfo = run_info(name, source.info(), &entry.name, &entry.blueprint, 1);
    info.truth = truth.clone();
    let surface = surface.map(|path| SurfacePicture::create(path, info.clone())).transpose()?;
    let mut watched = Watched { story: Story::new(truth.clone()), strip: Strip::new(&info, frames, STILLS), surface };
    let mut tracker = entry.blueprint.tracker(1, 0)?;
    let plan = Follow {
        init: truth.first().copied(),
        again: &[],
        from: 0,
        until: frames.saturating_sub(1),
        stop: &terminal::stopping,
        clock: info.clock.clone(),
        progress: &mut |_| (),
    };
    let (_, result) = follow(source, &mut tracker, &mut watched, plan);
    result.map(|()| watched)
}

/// What a run looked like, told in two pictures, and its numbers.
fn tell(watched: &Watched, file: &str, title: &str) -> (Vec<Picture>, Value) {
    let story = &watched.story;
    let errors = story.errors();
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let strip = Picture {
        file: format!("{file}-strip.png"),
        caption: format!(
            "{title}: mean error {mean:.2} px. Green: truth; blue: estimate; amber: the look's sharp window."
        ),
        bytes: encode_png(&watched.strip.picture(title)),
    };
    let plot = Picture {
        file: format!("{file}.svg"),
        caption: format!("{title}, over time."),
        bytes: story.plot(title).into(),
    };
    let gazes: Vec<[f64; 2]> = story.gazes.iter().map(|g| [g.u, g.v]).collect();
    let numbers = json!({
        "run": title, "mean_error": mean, "errors": errors, "gazes": gazes, "rewards": story.rewards,
        "policy": story.policy, "classes": story.classes,
    });
    (vec![strip, plot], numbers)
}

/// One run of each line on the first video of each digit.
pub fn policy(experiment: &Experiment, ground: &Ground) -> Result<Shown> {
    let mut shown = Shown { pictures: vec![], numbers: json!([]), missing: vec![] };
    let scene = experiment.scenes.first().ok_or_else(|| Error::Config(format!("{}: no scene", experiment.name)))?;
    for (i, line) in experiment.lines.iter().enumerate() {
        let entry = line.entry()?;
        for &digit in &experiment.digits {
            let video = scene.video.with(digit, 1, experiment.frames).video(&ground.digits)?;
            let (truth, title) = (video.truth().to_vec(), format!("A moving {digit}, {}", line.name));
            let watched = watch(&mut video.source(), &entry, (&title, truth, experiment.frames), None)?;
            let (pictures, numbers) = tell(&watched, &format!("{}-{}-{digit}", experiment.name, i + 1), &title);
            shown.add(pictures, numbers);
        }
    }
    Ok(shown)
}

/// Reward surfaces; `None` where runs are missing.
pub fn digits(experiment: &Experiment, ground: &Ground) -> Result<Option<Shown>> {
    let mut shown = Shown { pictures: vec![], numbers: json!([]), missing: vec![] };
    let scene = experiment.scenes.first().ok_or_else(|| Error::Config(format!("{}: no scene", experiment.name)))?;
    for (i, line) in experiment.lines.iter().enumerate() {
        let entries = [surfaces::entry(line.entry()?)];
        let settings = experiment.digits.iter().map(|&digit| scene.video.with(digit, 1, experiment.frames));
        let settings: Vec<_> = settings.collect();
        let job = |video: &_, seed| Job { entry: 0, kind: 0, video: Clone::clone(video), seed };
        let jobs: Vec<Job> = settings.iter().flat_map(|v| (1..=experiment.seeds).map(|seed| job(v, seed))).collect();
        let from = (&ground.digits, ground.from.as_str());
        let runs = ground.store.runs(&experiment.name, &entries, &jobs, from, &Learned::follow)?;
        let Some(learned) = runs.into_iter().collect::<Option<Vec<_>>>() else { return Ok(None) };
        let videos = settings.iter().map(|video| video.video(&ground.digits)).collect::<Result<Vec<_>>>()?;
        let title = format!("Where it learned to look: {} runs on a video of each digit", experiment.seeds);
        let (bytes, rows) = surfaces::picture(&title, &videos, &learned, &*entries[0].blueprint.retina());
        let caption =
            format!("{}: reward surfaces and best gazes; below, the mean of the views at the best gazes.", line.name);
        let picture = Picture { file: format!("{}-{}.png", experiment.name, i + 1), caption, bytes };
        shown.add(vec![picture], json!({ "line": line.name, "points": POINTS, "surfaces": rows }));
    }
    Ok(Some(shown))
}

/// Each line on each sequence; those that are not there are named.
pub fn face(experiment: &Experiment, ground: &Ground, out: &Path) -> Result<Shown> {
    let mut shown = Shown { pictures: vec![], numbers: json!([]), missing: vec![] };
    for name in &experiment.sequences {
        let folder = ground.data.join("tracking").join(name);
        if !folder.is_dir() {
            shown.missing.push(format!("{name}: there is no {}; --data DIR says where the data are", folder.display()));
            continue;
        }
        for (i, line) in experiment.lines.iter().enumerate() {
            let (pictures, numbers) = sequence(experiment, line, &folder, name, (out, i))?;
            shown.add(pictures, numbers);
        }
    }
    Ok(shown)
}

fn sequence(
    experiment: &Experiment,
    line: &LineOf,
    folder: &Path,
    name: &str,
    (out, i): (&Path, usize),
) -> Result<(Vec<Picture>, Value)> {
    let all = find_sequences(&[folder.to_path_buf()])?;
    let sequence = all.first().ok_or_else(|| Error::malformed(folder, "no sequence with its truth is here"))?;
    sequence.init()?;
    let truth: Vec<BBox> = sequence.truth.iter().map_while(|bbox| *bbox).collect();
    let frames = truth.len().min(experiment.frames);
    let file = format!("{}-{name}-{}", experiment.name, i + 1);
    let title = format!("{name}, {}", line.name);
    let surface = out.join(format!("{file}-surface.png"));
    let mut source = open(&sequence.images)?;
    let watched = watch(&mut *source, &line.entry()?, (&title, truth, frames), Some(&surface))?;
    let (mut pictures, numbers) = tell(&watched, &file, &title);
    let bytes = std::fs::read(&surface).map_err(Error::io(&surface, "cannot read the picture just written"))?;
    let caption =
        format!("{title}: template, believed reward with all fixations, its deviation, the view at the best gaze.");
    pictures.insert(1, Picture { file: format!("{file}-surface.png"), caption, bytes });
    Ok((pictures, numbers))
}

/// Pictures as files.
pub fn write(pictures: &[Picture], out: &Path) -> Result<()> {
    pictures.iter().try_for_each(|picture| files::write(out.join(&picture.file), &picture.bytes))
}

impl Shown {
    fn add(&mut self, pictures: Vec<Picture>, numbers: Value) {
        self.pictures.extend(pictures);
        if let Some(all) = self.numbers.as_array_mut() {
            all.push(numbers);
        }
    }

    /// The pictures and the numbers as files.
    pub fn write(&self, out: &Path, name: &str) -> Result<()> {
        write(&self.pictures, out)?;
        let numbers = serde_json::to_string(&self.numbers).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write(out.join(format!("{name}.json")), numbers.as_bytes())
    }
}
