//! A table's runs, and their summaries.

use std::collections::BTreeMap;

use crate::eval::policy_set::policy_name;
use crate::eval::recognised::Recognised;
use crate::eval::tally::{Figure, Tally};
use foveate::lab::eval::experiment::{Run, reported};
use foveate::{Error, Result};

use super::output::Table;
use super::plan::{Experiment, Measure};
use super::results::{Line, Results};
use super::setup::{Job, Setup};
use foveate_cli::runs::{Entry, Finished};

impl Finished for Recognised {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// A finished run of either kind.
enum Done {
    Track(Run),
    Classes(Recognised),
}

/// Makes the missing runs of a table. `None` if runs are missing: those of another shard, or after a stop request.
pub(super) fn table(experiment: &Experiment, setup: &Setup) -> Result<Option<Table>> {
    let entries = experiment.lines.iter().map(|line| line.entry(&setup.settings)).collect::<Result<Vec<_>>>()?;
    let jobs = jobs(experiment);
    let Some(done) = done(experiment, setup, &entries, &jobs)? else { return Ok(None) };
    let of = |entry: usize, scene: usize| -> Vec<(&Job, &Done)> {
        jobs.iter().zip(&done).filter(|(job, _)| (job.entry, job.scene) == (entry, scene)).collect()
    };
    let figures = |entry: usize, scene: usize| -> Result<Vec<Figure>> {
        of(entry, scene).into_iter().map(|(job, done)| done.figure(job)).collect()
    };
    let (mut lines, mut speeds) = (vec![], vec![]);
    for (k, scene) in experiment.scenes.iter().enumerate() {
        for (i, line) in experiment.lines.iter().enumerate().filter(|(_, line)| line.is_run_on(&scene.name)) {
            let other = experiment.against(i).filter(|&o| experiment.lines[o].is_run_on(&scene.name));
            let compared = other.map(|other| figures(other, k)).transpose()?;
            let tally = Tally::of(&figures(i, k)?, compared.as_deref())
                .map_err(|e| Error::Invalid(format!("{}, line {}: {e}", experiment.name, line.name)))?;
            let runs: Vec<&Done> = of(i, k).into_iter().map(|(_, done)| done).collect();
            lines.push(Line {
                name: line.name.clone(),
                group: line.group,
                row: line.row.clone(),
                configuration: line.config.clone(),
                policy: policy_name(&entries[i].blueprint.config().policy),
                scene: scene.name.clone(),
                other: other.map(|o| experiment.lines[o].name.clone()),
                tally,
                details: details(&runs),
            });
            let (frames, seconds) = runs.iter().fold((0, 0.0), |(n, s), done| match done {
                Done::Track(run) => (n + run.errors.len(), s + run.seconds),
                Done::Classes(_) => (n, s),
            });
            speeds.push((seconds > 0.0).then(|| frames as f64 / seconds));
        }
    }
    let mut results = Results { lines, ..Results::empty(experiment, setup) };
    results.check(experiment, setup);
    Ok(Some(Table { results, speeds, pictures: vec![] }))
}

impl Done {
    fn figure(&self, job: &Job) -> Result<Figure> {
        match self {
            Self::Track(run) => Figure::error(job.video.digit(), run),
            Self::Classes(run) => Figure::accuracy(run),
        }
    }
}

/// Returns further percentages of the runs.
fn details(runs: &[&Done]) -> BTreeMap<String, f64> {
    let tracks: Vec<&Run> =
        runs.iter().filter_map(|d| if let Done::Track(run) = d { Some(run) } else { None }).collect();
    let classes = runs.iter().filter_map(|d| if let Done::Classes(run) = d { Some(run) } else { None });
    let mean = |of: &dyn Fn(&Recognised) -> f64| {
        let (sum, n) = classes.clone().fold((0.0, 0u32), |(sum, n), run| (sum + of(run), n + 1));
        (n > 0).then(|| sum / f64::from(n))
    };
    let [on, off] = reported(&tracks);
    let named = [
        ("reported lost on target", on),
        ("reported lost off target", off),
        ("right by the last looks alone", mean(&Recognised::single)),
        ("right at end", mean(&|run| f64::from(u8::from(run.right_at_end())))),
    ];
    named.into_iter().filter_map(|(name, share)| Some((name.to_owned(), 100.0 * share?))).collect()
}

/// Returns the jobs; runs of a line on a scene are consecutive, in the order of its videos.
fn jobs(experiment: &Experiment) -> Vec<Job> {
    let mut jobs = vec![];
    for (entry, line) in experiment.lines.iter().enumerate() {
        for (k, scene) in experiment.scenes.iter().enumerate().filter(|(_, scene)| line.is_run_on(&scene.name)) {
            for &digit in &experiment.digits {
                let job = |seed| Job { entry, scene: k, video: scene.video.with(digit, seed, experiment.frames), seed };
                jobs.extend(experiment.seeds.iter().map(job));
            }
        }
    }
    jobs
}

fn done(experiment: &Experiment, setup: &Setup, entries: &[Entry], jobs: &[Job]) -> Result<Option<Vec<Done>>> {
    let name = &experiment.name;
    Ok(match experiment.measure {
        Measure::Error => {
            let runs = setup.runs(name, entries, jobs, &Run::follow)?;
            runs.into_iter().map(|run| run.map(Done::Track)).collect()
        }
        Measure::Accuracy => {
            let runs = setup.runs(name, entries, jobs, &Recognised::follow)?;
            runs.into_iter().map(|run| run.map(Done::Classes)).collect()
        }
    })
}
