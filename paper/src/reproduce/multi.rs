//! The paper's second experiment: tracks digits that grow, turn and pass over each other (section 6.1).

use crate::eval::multi::{Alone, Line, Run, fps};
use foveate::config::{Blueprint, RecogniserConfig};
use foveate::files::Folder;
use foveate::lab::eval::experiment::digest;
use foveate::lab::synthetic::{Multi, MultiVideo};
use foveate::report::{Film, MultiStrip, Observer, Report, RunInfo};
use foveate::{Error, Result};
use serde_json::json;

use super::line::LineSpec;
use super::output::{Picture, Table};
use super::plan::Experiment;
use super::results::Results;
use super::setup::Setup;
use crate::DIGITS;
use foveate_cli::runs::{self, Entry, Finished};

impl Finished for Run {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// Returns a line's configuration with a recogniser of the digits; it does not change the tracks.
fn entry(line: &LineSpec, settings: &[String]) -> Result<Entry> {
    let blueprint = line.entry(settings)?.blueprint;
    let blueprint = blueprint.with_recogniser(RecogniserConfig::multi_fixation(DIGITS), &Folder::here())?;
    Entry::of(blueprint, if line.alone { "alone" } else { "together" })
}

/// Follows all targets of a video, together or each by its own tracker; `seed` is the seed of all random numbers.
fn follow(
    blueprint: &Blueprint,
    alone: bool,
    video: &MultiVideo,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<Run> {
    if !alone {
        return Run::follow(video, &mut blueprint.multi_tracker(seed)?, observer);
    }
    let ids = 1..=video.movers().len() as u64;
    let trackers = ids.map(|id| blueprint.tracker_of(seed, id)).collect::<Result<Vec<_>>>()?;
    Run::follow(video, &mut Alone::new(trackers), observer)
}

/// Makes the missing runs. `None` if runs are missing: those of another shard, or after a stop request.
pub(super) fn multi(experiment: &Experiment, setup: &Setup) -> Result<Option<Table>> {
    let scene = experiment.multi.as_ref();
    let scene = scene.ok_or_else(|| Error::Config(format!("{}: no [multi], the scene", experiment.name)))?;
    let settings = |seed| Multi { seed, frames: experiment.frames, ..scene.video.clone() };
    let settings: Vec<Multi> = experiment.seeds.iter().map(settings).collect();
    let videos = settings.iter().map(|settings| settings.video(&setup.digits)).collect::<Result<Vec<_>>>()?;
    let entries = experiment.lines.iter().map(|line| entry(line, &setup.settings)).collect::<Result<Vec<_>>>()?;

    let jobs: Vec<(usize, usize)> =
        (0..entries.len()).flat_map(|entry| (0..videos.len()).map(move |video| (entry, video))).collect();
    let pixels = runs::pixels(&setup.digits);
    let key = |&(entry, video): &(usize, usize)| {
        let scene = serde_json::to_vec(&settings[video]).expect("settings are plain data");
        digest(&[entries[entry].key.as_bytes(), &scene, pixels.as_bytes()])
    };
    let make = |&(entry, video): &(usize, usize)| {
        let (blueprint, alone, scene) = (&entries[entry].blueprint, experiment.lines[entry].alone, &settings[video]);
        let nobody = &mut Vec::<Box<dyn Observer>>::new();
        let run = follow(blueprint, alone, &videos[video], scene.seed, nobody)?;
        let stored = json!({
            "configuration": blueprint.config(), "video": scene, "digits": setup.from,
            "frames": run.frames, "found": run.found, "seconds": run.seconds,
        });
        let text = runs::text(&stored)?;
        Ok((run, text))
    };
    let runs = setup.store.finished(&experiment.name, &jobs, &|_| experiment.frames, &key, &make)?;
    let Some(runs) = runs.into_iter().collect::<Option<Vec<Run>>>() else { return Ok(None) };

    let (mut lines, mut speeds) = (vec![], vec![]);
    for (line, runs) in experiment.lines.iter().zip(runs.chunks(videos.len())) {
        let judged = runs.iter().zip(&videos).map(|(run, video)| run.judge(video)).collect::<Result<Vec<_>>>()?;
        lines.extend(Line::of(&line.name, &line.config, &scene.name, &judged));
        speeds.push(fps(&runs.iter().collect::<Vec<_>>()));
    }
    let mut results = Results { multi: lines, ..Results::empty(experiment, setup) };
    results.check(experiment, setup);
    let pictures = match videos[0].movers().len() <= MANY {
        true => vec![film(experiment, &entries[0].blueprint, &videos[0], setup)?],
        false => vec![],
    };
    Ok(Some(Table { results, speeds, pictures }))
}

/// Maximum number of targets in a film: with more, boxes hide each other.
const MANY: usize = 50;
/// Number of pictures of the film strip, and per row.
const SHOWN: usize = 8;
const COLUMNS: usize = 4;

/// Draws the first line on the first video: the film strip, and the files NAME.mp4 and NAME-report.html.
fn film(experiment: &Experiment, blueprint: &Blueprint, video: &MultiVideo, setup: &Setup) -> Result<Picture> {
    let (line, seed, name) = (&experiment.lines[0], experiment.seeds.first, &experiment.name);
    let classes: Vec<String> = video.movers().iter().map(|mover| mover.class.to_string()).collect();
    let classes = classes.join(", ");
    let info = RunInfo {
        source: format!("synthetic digits {classes}"),
        reader: setup.from.clone(),
        rate: 30.0,
        config_name: line.name.clone(),
        config_text: blueprint.config().to_toml(),
        seed,
        command: foveate_cli::command(),
        ..RunInfo::default()
    };
    let last = video.frames() - 1;
    let mut shown: Vec<usize> = (0..SHOWN).map(|i| (i * last + SHOWN / 2) / (SHOWN - 1)).map(|t| t.min(last)).collect();
    shown.dedup();
    let title = format!(
        "Digits that grow, turn and pass over each other · no 1 to {} are truly {classes}",
        video.movers().len()
    );
    let file = format!("{name}-strip.png");
    let mut observers: Vec<Box<dyn Observer>> = vec![
        Box::new(MultiStrip::create(setup.out.join(&file), &title, shown, COLUMNS)?),
        Box::new(Film::of_many(setup.out.join(format!("{name}.mp4")), &info)?),
        Box::new(Report::create(setup.out.join(format!("{name}-report.html")), info)?),
    ];
    follow(blueprint, line.alone, video, seed, &mut observers)?;
    observers.finish()?;
    Picture::read(&setup.out, file, format!("Seed {seed}, {}: each target's box, number, track and class.", line.name))
}
