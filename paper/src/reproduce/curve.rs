//! How fast Hedge learns to look at the centre: the companion paper's figure 4.

use crate::eval::learning::{self, Curve, Learning, PAPER};
use foveate::lab::synthetic::Drawn;
use foveate::{Result, Tracker};
use serde_json::json;

use super::output::{Figure, Picture};
use super::plan::Experiment;
use super::setup::{Job, Setup};
use foveate_cli::runs::{Entry, Finished};

impl Finished for Learning {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// The digit in the paper's figure.
const SHOWN: u8 = 8;

/// Computes the curve of each line: of all runs, of those on target, and of those of the eight, as in the paper's figure. `None` if runs
/// are missing.
pub(super) fn curve(experiment: &Experiment, setup: &Setup) -> Result<Option<Figure>> {
    let scene = &experiment.scene()?.video;
    let mut curves = vec![];
    for line in &experiment.lines {
        let template = line.template;
        let entry = Entry::of(line.entry(&setup.settings)?.blueprint, &format!("curve {template:?}"))?;
        let job = |digit, seed| Job { entry: 0, scene: 0, video: scene.with(digit, seed, experiment.frames), seed };
        let jobs: Vec<Job> = (experiment.digits.iter())
            .flat_map(|&digit| experiment.seeds.iter().map(move |seed| job(digit, seed)))
            .collect();
        let follow = move |video: &dyn Drawn, tracker: &mut Tracker| Learning::follow(video, tracker, template);
        let runs = setup.runs(&experiment.name, &[entry], &jobs, &follow)?;
        let Some(runs) = runs.into_iter().collect::<Option<Vec<Learning>>>() else { return Ok(None) };
        for (name, eight, on_target) in [
            ("all", false, false),
            ("on target", false, true),
            ("the eight", true, false),
            ("the eight, on target", true, true),
        ] {
            let such = |(job, run): &(&Job, &Learning)| {
                (!eight || job.video.digit() == SHOWN) && (!on_target || run.on_target())
            };
            let runs: Vec<&Learning> = jobs.iter().zip(&runs).filter(such).map(|(_, run)| run).collect();
            curves.extend(Curve::of(&format!("{}: {name}", line.name), &runs));
        }
    }
    let picture = Picture {
        file: format!("{}.svg", experiment.name),
        caption: "Median over runs, the band from 10 to 90 %, and the paper's values.".into(),
        bytes: learning::plot(&curves).into(),
    };
    let numbers = vec![json!({ "paper": PAPER, "curves": curves })];
    Ok(Some(Figure { pictures: vec![picture], numbers, text: learning::text(&curves), missing: vec![] }))
}
