//! `foveate experiment recognise`: what the target is called, along real tracks (the paper's table 2).

use std::path::Path;

use clap::ValueEnum;
use foveate::config::{Exp3Config, PolicyConfig, RECOGNISERS, RecogniserConfig};
use foveate::eval::experiment::digest;
use foveate::eval::line_up::policy_name;
use foveate::eval::recognised::{self, Line, Recognised};
use foveate::gaze::Grid;
use foveate::identity::accumulate::Accumulate;
use foveate::identity::multi_fixation::classifier_path;
use foveate::scene::synthetic::{Clutter, Synthetic};
use foveate::{Error, Result};
use serde_json::json;

use super::super::track::DIGITS;
use super::clutter::Noise;
use super::{Common, Entry, Job, Kept, Scenes, Settings, all_runs, entries, jobs, report};

/// A digit among static ones, tracked and recognised: how many frames have the right decision.
///
/// Each configuration (digits-hedge, unless told otherwise) tracks with its own policy; a recogniser looks at the
/// estimate where each of --looks says. Finished runs are kept in DIR/runs: the same command goes on where it was stopped
/// or killed.
#[derive(clap::Args)]
#[command(mut_arg("policies", |arg| arg.hide(true)))]
pub struct Args {
    /// The recogniser: a model of `foveate train fixations`, with ten classes
    #[arg(long, value_name = "MODEL", default_value = DIGITS)]
    recognise: String,
    /// Where it looks; may be repeated [default: random and circular]
    #[arg(long, value_enum, value_name = "POLICY")]
    looks: Vec<Looks>,
    /// How frames add up
    #[arg(long, value_enum, default_value_t = Rule::Sum)]
    accumulate: Rule,
    /// Frames that a forgetting sum remembers
    #[arg(long, value_name = "FRAMES", default_value_t = 50.0)]
    memory: f64,
    /// Half the side of the square of gazes, in template units
    #[arg(long, value_name = "UNITS", default_value_t = 0.5)]
    reach: f64,
    /// Without salt and pepper, with it (density 0.3), or both
    #[arg(long, value_enum, default_value_t = Noise::Clean)]
    noise: Noise,
    #[command(flatten)]
    common: Common,
}

#[derive(ValueEnum, Clone, Copy)]
enum Looks {
    /// Uniformly among nine gazes
    Random,
    /// The nine in turn
    Circular,
    /// EXP3 over the nine, rewarded by how sure a look leaves it
    Learned,
    /// The centre alone
    Fixed,
}

#[derive(ValueEnum, Clone, Copy)]
enum Rule {
    /// Log-probabilities
    Sum,
    /// The authors' counter of likeliest classes
    Count,
    /// Log-probabilities that fade with age
    Forgetting,
}

impl Kept for Recognised {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

impl Args {
    fn looks(&self) -> Vec<PolicyConfig> {
        let grid = Grid { reach: self.reach, ..Grid::default() };
        let chosen = if self.looks.is_empty() { &[Looks::Random, Looks::Circular][..] } else { &self.looks };
        let policy = |looks: &Looks| match looks {
            Looks::Random => PolicyConfig::Random { grid },
            Looks::Circular => PolicyConfig::Circular { grid },
            Looks::Learned => PolicyConfig::Exp3(Exp3Config { grid, ..Exp3Config::default() }),
            Looks::Fixed => PolicyConfig::Fixed { u: 0.0, v: 0.0 },
        };
        chosen.iter().map(policy).collect()
    }
    /// A digest of the model's files: runs depend on what is in them.
    fn model(&self) -> Result<String> {
        if let Some(name) = self.recognise.strip_prefix("builtin:") {
            let shipped = RECOGNISERS.iter().find(|model| model.0 == name);
            return Ok(shipped.map(|model| digest(&[model.1])).unwrap_or_default());
        }
        let bytes = std::fs::read(&self.recognise).map_err(Error::io(&self.recognise, "cannot read the model"))?;
        let classifier = std::fs::read(classifier_path(Path::new(&self.recognise))).unwrap_or_default();
        Ok(digest(&[&bytes, &classifier]))
    }
}

pub fn run(args: Args) -> Result<()> {
    let common = &args.common;
    if common.policies {
        return Err(Error::Config(
            "recognise runs each configuration with its own policy; leave out --policies".into(),
        ));
    }
    let frames = common.videos.frames();
    let kind = |&noise: &f64| -> (f64, Settings) {
        let clutter =
            move |digit, seed| Synthetic::Clutter(Clutter { digit, seed, noise, frames, ..Clutter::default() });
        (noise, Box::new(clutter))
    };
    let scenes = Scenes {
        name: "recognise",
        title: "Recognition of a digit among static ones".into(),
        peers: recognised::PAPER,
        kinds: args.noise.densities().iter().map(kind).collect(),
    };
    let (digits, from) = common.videos.digits()?;
    let (model, looks) = (args.model()?, args.looks());
    let mut all: Vec<(Entry, String)> = vec![];
    for entry in entries(common, &["digits-hedge"])?.into_iter().filter(|entry| entry.own) {
        for policy in &looks {
            all.push((with(&args, &entry, policy, &model)?, policy_name(policy)));
        }
    }
    let (entries, looks): (Vec<Entry>, Vec<String>) = all.into_iter().unzip();
    let jobs = jobs(common, &scenes, entries.len());
    let out = common.out.clone().unwrap_or_else(|| Path::new("out").join(scenes.name));
    let runs = all_runs(scenes.name, &out, &entries, &jobs, (&digits, &from), &Recognised::follow)?;
    let mut lines = vec![];
    for (kind, (noise, _)) in scenes.kinds.iter().enumerate() {
        for (i, entry) in entries.iter().enumerate() {
            let mine = |job: &Job| job.entry == i && job.kind == kind;
            let such: Vec<_> = jobs.iter().zip(&runs).filter(|(job, _)| mine(job)).map(|(_, run)| run).collect();
            lines.extend(Line::of(&entry.name, &entry.policy, &looks[i], *noise, &such));
        }
    }
    let results = json!({ "experiment": "recognise", "lines": lines, "others": recognised::PAPER });
    report(common, (&scenes.title, &from), &out, &recognised::text(&lines), results, &[])
}

/// The entry with a recogniser that looks by this policy.
fn with(args: &Args, entry: &Entry, policy: &PolicyConfig, model: &str) -> Result<Entry> {
    let accumulate = match args.accumulate {
        Rule::Sum => Accumulate::Sum,
        Rule::Count => Accumulate::Count,
        Rule::Forgetting => Accumulate::Forgetting { memory: args.memory },
    };
    let weights = args.recognise.clone();
    let recogniser =
        RecogniserConfig::MultiFixation { weights, accumulate, policy: Some(policy.clone()), alarm: false };
    Ok(Entry {
        name: entry.name.clone(),
        policy: entry.policy.clone(),
        own: true,
        fixed: 0,
        blueprint: entry.blueprint.clone().recognising(recogniser, Path::new("."))?,
        key: format!("{} recognise {accumulate:?} {policy:?} {model}", entry.key),
    })
}
