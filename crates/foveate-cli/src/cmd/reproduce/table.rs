//! A table's runs, and their sums.

use foveate::eval::experiment::Run;
use foveate::eval::recognised::Recognised;
use foveate::eval::tally::{Figure, Tally};
use foveate::{Error, Result};

use super::Ground;
use super::figures::Picture;
use super::plan::{Experiment, Measure};
use super::results::{Line, Results};
use crate::cmd::experiment::runner::{Entry, Job};

/// A table with its pictures, and what depends on the machine: frames a second of each line, where they are known.
pub struct Table {
    pub results: Results,
    pub speeds: Vec<Option<f64>>,
    pub pictures: Vec<Picture>,
}

/// What one run gave, and how long it took.
struct Done {
    figure: Figure,
    frames: usize,
    seconds: f64,
}

/// All runs of a table that are not done yet. `None` where some are missing: those of another shard, or it was asked to
/// stop.
pub fn table(experiment: &Experiment, ground: &Ground) -> Result<Option<Table>> {
    let entries = experiment.lines.iter().map(|line| line.entry()).collect::<Result<Vec<_>>>()?;
    let jobs = jobs(experiment);
    let Some(done) = done(experiment, ground, &entries, &jobs)? else { return Ok(None) };
    let of = |entry: usize, kind: usize| -> Vec<&Done> {
        let both = jobs.iter().zip(&done).filter(|(job, _)| (job.entry, job.kind) == (entry, kind));
        both.map(|(_, done)| done).collect()
    };
    let (mut lines, mut speeds) = (vec![], vec![]);
    for (kind, scene) in experiment.scenes.iter().enumerate() {
        for (i, line) in experiment.lines.iter().enumerate().filter(|(_, line)| line.is_run_on(&scene.name)) {
            let figures = |i: usize| of(i, kind).iter().map(|d| d.figure).collect::<Vec<_>>();
            let other = experiment.against(i).filter(|&o| experiment.lines[o].is_run_on(&scene.name));
            let compared = other.map(figures);
            let tally = Tally::of(&figures(i), compared.as_deref())
                .map_err(|e| Error::Invalid(format!("{}, line {}: {e}", experiment.name, line.name)))?;
            lines.push(Line {
                name: line.name.clone(),
                group: line.group,
                row: line.row.clone(),
                configuration: line.config().to_owned(),
                policy: entries[i].policy.clone(),
                scene: scene.name.clone(),
                other: other.map(|o| experiment.lines[o].name.clone()),
                tally,
            });
            let (frames, seconds) = of(i, kind).iter().fold((0, 0.0), |(n, s), d| (n + d.frames, s + d.seconds));
            speeds.push((seconds > 0.0).then(|| frames as f64 / seconds));
        }
    }
    let mut results = Results { lines, ..Results::empty(experiment, ground) };
    results.check(experiment, ground.quick, ground.mnist);
    Ok(Some(Table { results, speeds, pictures: vec![] }))
}

/// Runs of a line on a scene stand together, in the order of its videos.
fn jobs(experiment: &Experiment) -> Vec<Job> {
    let mut jobs = vec![];
    for (entry, line) in experiment.lines.iter().enumerate() {
        for (kind, scene) in experiment.scenes.iter().enumerate().filter(|(_, scene)| line.is_run_on(&scene.name)) {
            for &digit in &experiment.digits {
                let job = |seed| Job { entry, kind, video: scene.video.with(digit, seed, experiment.frames), seed };
                jobs.extend((1..=experiment.seeds).map(job));
            }
        }
    }
    jobs
}

fn done(experiment: &Experiment, ground: &Ground, entries: &[Entry], jobs: &[Job]) -> Result<Option<Vec<Done>>> {
    let (name, digits) = (&experiment.name, (&ground.digits, ground.from.as_str()));
    match experiment.measure {
        Measure::Error => {
            let runs = ground.store.runs(name, entries, jobs, digits, &Run::follow)?;
            let done = |(job, run): (&Job, Option<Run>)| -> Option<Result<Done>> {
                let run = run?;
                let (frames, seconds) = (run.errors.len(), run.seconds);
                Some(Figure::error(job.video.digit(), &run).map(|figure| Done { figure, frames, seconds }))
            };
            jobs.iter().zip(runs).map(done).collect::<Option<Result<_>>>().transpose()
        }
        Measure::Accuracy => {
            let runs = ground.store.runs(name, entries, jobs, digits, &Recognised::follow)?;
            let done = |run: Option<Recognised>| -> Option<Result<Done>> {
                Some(Figure::accuracy(&run?).map(|figure| Done { figure, frames: 0, seconds: 0.0 }))
            };
            runs.into_iter().map(done).collect::<Option<Result<_>>>().transpose()
        }
    }
}
