//! One run over time: on digits, and on faces in real videos.

use std::path::Path;

use crate::eval::timeline::Timeline;
use foveate::Seen;
use foveate::geometry::BBox;
use foveate::lab::eval::sequence::find_sequences;
use foveate::lab::synthetic::Drawn;
use foveate::report::run::{RunPlan, run};
use foveate::report::{Observer, RunInfo, Strip, SurfacePicture};
use foveate::video::{Frame, FrameSource, encode_png, open};
use foveate::{Error, Result};
use serde_json::{Value, json};

use super::line::LineSpec;
use super::output::{Figure, Picture};
use super::plan::Experiment;
use super::setup::Setup;
use foveate_cli::terminal;

/// Number of stills of a film strip.
const STILLS: usize = 6;

/// The record of a run.
struct Recording {
    timeline: Timeline,
    strip: Strip,
    surface: Option<SurfacePicture>,
}

impl Recording {
    fn each(&mut self, mut call: impl FnMut(&mut dyn Observer) -> Result<()>) -> Result<()> {
        call(&mut self.timeline)?;
        call(&mut self.strip)?;
        self.surface.as_mut().map_or(Ok(()), |surface| call(surface))
    }
}

impl Observer for Recording {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.each(|o| o.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.each(|o| o.finish())
    }
}

/// Follows a target through a source of `frames` frames.
fn record(
    source: &mut dyn FrameSource,
    line: &LineSpec,
    (name, truth, frames): (&str, Vec<Option<BBox>>, usize),
    (setup, seed): (&Setup, u64),
    surface: Option<&Path>,
) -> Result<Recording> {
    let blueprint = line.entry(&setup.settings)?.blueprint;
    let info = RunInfo::of(name.to_owned(), source.info(), line.name.clone(), &blueprint, seed);
    let info = RunInfo { command: foveate_cli::command(), truth: truth.clone(), ..info };
    let surface = surface.map(|path| SurfacePicture::create(path, info.clone())).transpose()?;
    let mut recording =
        Recording { timeline: Timeline::new(truth.clone()), strip: Strip::new(&info, frames, STILLS), surface };
    let mut tracker = blueprint.tracker(seed)?;
    let (until, stop, clock) = (frames.saturating_sub(1), &terminal::stopping, info.clock.clone());
    let plan = RunPlan { init: truth.first().copied().flatten(), until, stop, clock, ..RunPlan::default() };
    let (_, result) = run(source, &mut tracker, &mut recording, plan);
    result.map(|()| recording)
}

/// Draws the film strip and the plot of a run, and formats its numbers.
fn show(recording: &Recording, file: &str, title: &str) -> (Vec<Picture>, Value) {
    let timeline = &recording.timeline;
    let errors = timeline.errors();
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let strip = Picture {
        file: format!("{file}-strip.png"),
        caption: format!(
            "{title}: mean error {mean:.2} px. Green: truth; blue: estimate; amber: the look's sharp window."
        ),
        bytes: encode_png(&recording.strip.picture(title)),
    };
    let plot = Picture {
        file: format!("{file}.svg"),
        caption: format!("{title}, over time."),
        bytes: timeline.plot(title).into(),
    };
    let gazes: Vec<[f64; 2]> = timeline.gazes.iter().map(|g| [g.u, g.v]).collect();
    let numbers = json!({
        "run": title, "mean_error": mean, "errors": errors, "gazes": gazes, "rewards": timeline.rewards,
        "policy": timeline.policy, "classes": timeline.classes,
    });
    (vec![strip, plot], numbers)
}

/// Makes one run of each line on the first video of each digit.
pub(super) fn policy(experiment: &Experiment, setup: &Setup) -> Result<Figure> {
    let (mut figure, scene, seed) = (Figure::default(), experiment.scene()?, experiment.seeds.first);
    for (i, line) in experiment.lines.iter().enumerate() {
        for &digit in &experiment.digits {
            let video = scene.video.with(digit, seed, experiment.frames).video(&setup.digits)?;
            let truth = video.truth().iter().copied().map(Some).collect();
            let title = format!("A moving {digit}, {}", line.name);
            let run = (&*title, truth, experiment.frames);
            let recording = record(&mut video.source(), line, run, (setup, seed), None)?;
            let (pictures, numbers) = show(&recording, &format!("{}-{}-{digit}", experiment.name, i + 1), &title);
            figure.pictures.extend(pictures);
            figure.numbers.push(numbers);
        }
    }
    Ok(figure)
}

/// Runs each line on each sequence; lists missing sequences.
pub(super) fn face(experiment: &Experiment, setup: &Setup) -> Result<Figure> {
    let mut figure = Figure::default();
    for name in &experiment.sequences {
        let folder = setup.data.join("tracking").join(name);
        if !folder.is_dir() {
            let problem =
                format!("{name}: there is no {}; name the folder of the data with --data DIR", folder.display());
            figure.missing.push(problem);
            continue;
        }
        for (i, line) in experiment.lines.iter().enumerate() {
            let (pictures, numbers) = sequence(experiment, line, &folder, (name, i), setup)?;
            figure.pictures.extend(pictures);
            figure.numbers.push(numbers);
        }
    }
    Ok(figure)
}

fn sequence(
    experiment: &Experiment,
    line: &LineSpec,
    folder: &Path,
    (name, i): (&str, usize),
    setup: &Setup,
) -> Result<(Vec<Picture>, Value)> {
    let all = find_sequences(&[folder.to_path_buf()])?;
    let sequence = all.first().ok_or_else(|| Error::malformed(folder, "no sequence with its truth is here"))?;
    sequence.init()?;
    let truth = sequence.truth.clone();
    let frames = truth.len().min(experiment.frames);
    let file = format!("{}-{name}-{}", experiment.name, i + 1);
    let title = format!("{name}, {}", line.name);
    let surface = format!("{file}-surface.png");
    let mut source = open(&sequence.images)?;
    let (run, path) = ((&*title, truth, frames), setup.out.join(&surface));
    let recording = record(&mut *source, line, run, (setup, experiment.seeds.first), Some(&path))?;
    let (mut pictures, numbers) = show(&recording, &file, &title);
    let caption =
        format!("{title}: template, believed reward with all fixations, its deviation, the view at the best gaze.");
    pictures.insert(1, Picture::read(&setup.out, surface, caption)?);
    Ok((pictures, numbers))
}
