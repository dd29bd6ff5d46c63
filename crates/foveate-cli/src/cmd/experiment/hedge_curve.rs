//! `foveate experiment hedge-curve`: how fast Hedge learns to look at the centre (the companion paper's figure 4).

use std::path::Path;

use clap::ValueEnum;
use foveate::eval::learning::{self, Curve, Learning, PAPER, Template};
use foveate::scene::synthetic::{Clutter, Drawn, Synthetic};
use foveate::tracker::Tracker;
use foveate::{Error, Result};
use serde_json::json;

use super::{Common, Job, Kept, Scenes, all_runs, entries, jobs, report};

/// The companion paper's curve: how fast Hedge learns to look at the centre.
///
/// Each configuration (authors, unless told otherwise) follows digits among static ones, without noise. Beside the
/// paper's figures stand all runs, those on target, and those of the eight, which is what the paper's figure shows.
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
#[command(mut_arg("policies", |arg| arg.hide(true)))]
pub struct Args {
    /// Density of salt and pepper in the videos; the paper's figure has none
    #[arg(long, value_enum, default_value_t = Noise::Clean)]
    noise: Noise,
    /// What the target's template is read from
    #[arg(long, value_enum, default_value_t = From::Frame)]
    template: From,
    #[command(flatten)]
    common: Common,
}

#[derive(ValueEnum, Clone, Copy)]
enum Noise {
    /// None
    Clean,
    /// 0.3
    Noisy,
}

#[derive(ValueEnum, Clone, Copy)]
enum From {
    /// The first frame as it is
    Frame,
    /// The box alone, median filtered, on black, as in the authors' program
    Authors,
}

impl Kept for Learning {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// The digit in the paper's figure.
const SHOWN: u8 = 8;

pub fn run(args: Args) -> Result<()> {
    let common = &args.common;
    if common.policies {
        return Err(Error::Config(
            "hedge-curve runs each configuration with its own policy; leave out --policies".into(),
        ));
    }
    let frames = common.videos.frames();
    let noise = match args.noise {
        Noise::Clean => 0.0,
        Noise::Noisy => foveate::scene::synthetic::NOISE,
    };
    let settings = move |digit, seed| Synthetic::Clutter(Clutter { digit, seed, noise, frames, ..Clutter::default() });
    let scenes = Scenes {
        name: "hedge-curve",
        title: "Probability of the centre gaze".into(),
        peers: "",
        kinds: vec![(noise, Box::new(settings))],
    };
    let (digits, from) = common.videos.digits()?;
    let mut entries = entries(common, &["authors"])?;
    entries.retain(|entry| entry.own);
    let template = match args.template {
        From::Frame => Template::Frame,
        From::Authors => Template::Authors,
    };
    entries.iter_mut().for_each(|entry| entry.key.push_str(&format!(" hedge-curve {template:?}")));
    let jobs = jobs(common, &scenes, entries.len());
    let out = common.out.clone().unwrap_or_else(|| Path::new("out").join(scenes.name));
    let follow = move |video: &dyn Drawn, tracker: &mut Tracker| Learning::follow(video, tracker, template);
    let runs = all_runs(scenes.name, &out, &entries, &jobs, (&digits, &from), &follow)?;
    let mut curves = Vec::new();
    for (i, entry) in entries.iter().enumerate() {
        let such = |wanted: &dyn Fn(&Job, &Learning) -> bool| -> Vec<&Learning> {
            let both = jobs.iter().zip(&runs).filter(|(job, run)| job.entry == i && wanted(job, run));
            both.map(|(_, run)| run).collect()
        };
        let sets: [(&str, Vec<&Learning>); 4] = [
            ("all", such(&|_, _| true)),
            ("on target", such(&|_, run| run.on_target())),
            ("the eight", such(&|job, _| job.video.digit() == SHOWN)),
            ("the eight, on target", such(&|job, run| job.video.digit() == SHOWN && run.on_target())),
        ];
        curves.extend(sets.iter().filter_map(|(name, runs)| Curve::of(&format!("{}: {name}", entry.name), runs)));
    }
    let results = json!({ "experiment": "hedge-curve", "paper": PAPER, "curves": curves });
    let more = [("curve.svg", learning::plot(&curves))];
    report(common, (&scenes.title, &from), &out, &learning::text(&curves), results, &more)
}
