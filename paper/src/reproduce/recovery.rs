//! Re-detection after occlusions inserted into real sequences.

use crate::eval::recovery::{AFTER, Case, lines, text};
use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::confidence_fit::follow;
use foveate::lab::eval::experiment::digest;
use foveate::lab::eval::{Sequence, find_sequences};
use foveate::lab::hide::{Hide, WAYS};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::output::Figure;
use super::plan::Experiment;
use super::setup::Setup;
use foveate_cli::runs::{self, Finished};
use foveate_cli::videos::{self, of_sequence};

/// All clips of one sequence.
#[derive(Clone, Serialize, Deserialize)]
#[serde(transparent)]
struct Clips(Vec<Case>);

impl Finished for Clips {
    fn is_of(&self, _: usize) -> bool {
        true
    }
}

/// Runs each line on all clips of each sequence; `None` if runs are missing. Three clips are cut from each sequence for each seed: the
/// image beside the target covers it; the camera moves away and back; it moves away and then to another place.
pub(super) fn recovery(experiment: &Experiment, setup: &Setup) -> Result<Option<Figure>> {
    let folder = setup.data.join("tracking");
    let mut figure = Figure::default();
    if !folder.is_dir() {
        figure.missing.push(format!("there is no {}; name the folder of the data with --data DIR", folder.display()));
        return Ok(Some(figure));
    }
    let mut sequences = find_sequences(&[folder])?;
    sequences.retain(|s| experiment.sequences.is_empty() || experiment.sequences.contains(&s.name));
    if setup.quick {
        sequences.truncate(1);
    }
    let named = |sequence: Sequence| videos::digest(&sequence).map(|data| (sequence, data));
    let sequences: Vec<(Sequence, String)> = sequences.into_iter().map(named).collect::<Result<_>>()?;
    for line in &experiment.lines {
        let entry = line.entry(&setup.settings)?;
        let key = |(_, data): &(Sequence, String)| {
            let settings = format!("{:?} {:?}", experiment.occluded, experiment.seeds);
            digest(&[entry.key.as_bytes(), settings.as_bytes(), data.as_bytes()])
        };
        let make = |(sequence, _): &(Sequence, String)| {
            let cases = cases(experiment, &entry.blueprint, sequence)?;
            let text = runs::text(&cases)?;
            Ok((Clips(cases), text))
        };
        let runs = setup.store.finished(&experiment.name, &sequences, &|s| s.0.truth.len(), &key, &make)?;
        let clips = runs.into_iter().map(|run| run.map(|clips| clips.0));
        let Some(runs) = clips.collect::<Option<Vec<Vec<Case>>>>() else { return Ok(None) };
        let short = sequences.iter().zip(&runs).filter(|(_, cases)| cases.is_empty());
        figure.missing.extend(short.map(|((sequence, _), _)| format!("{}: too short", sequence.name)));
        let cases: Vec<Case> = runs.concat();
        figure.text += &format!("{}\n\n{}", line.name, text(&cases));
        let lines = lines(&cases.iter().collect::<Vec<_>>());
        figure.numbers.push(json!({ "line": line.name, "lines": lines, "cases": cases }));
    }
    Ok(Some(figure))
}

/// Returns all clips of one sequence; none if it is too short.
fn cases(experiment: &Experiment, blueprint: &Blueprint, sequence: &Sequence) -> Result<Vec<Case>> {
    let video = of_sequence(sequence)?;
    let mut cases = vec![];
    for seed in experiment.seeds.iter() {
        for way in WAYS {
            let Ok(hide) = Hide::choose(way, &video.truth, video.size, experiment.occluded, seed) else { continue };
            let tracker = &mut blueprint.tracker_of(seed, way as u64)?;
            let track = follow(&video.truth, hide.until + AFTER, Some(&hide), &*video.picture, tracker)?;
            cases.push(Case::of(&sequence.name, seed, hide, &track));
        }
    }
    Ok(cases)
}
