//! `foveate experiment`: the paper's experiments, as tables.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use foveate::config::Config;
use foveate::eval::experiment::{self, Line, Run};
use foveate::eval::line_up;
use foveate::scene::Digits;
use foveate::scene::synthetic::Synthetic;
use foveate::{Error, Result, files};
use serde_json::{Value, json};

use self::runner::{Entry, Job, Kept, all_runs, digits};
use super::track::blueprint;

mod clutter;
mod hedge_curve;
pub mod multi;
mod partial;
mod recognise;
pub(in crate::cmd) mod recovery;
pub mod runner;
pub mod surfaces;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    kind: Kind,
}

#[derive(Subcommand)]
enum Kind {
    /// A digit among static ones: every configuration and policy beside the fixed centre, on the same videos
    Clutter(clutter::Args),
    /// The companion paper's curve: how fast Hedge learns to look at the centre
    HedgeCurve(hedge_curve::Args),
    /// Digits that grow, turn and pass over each other, all followed: the paper's second experiment
    Multi(multi::Args),
    /// A digit on black that passes behind bars, under noise: policies of partial information beside the others
    Partial(partial::Args),
    /// A digit among static ones, tracked and recognised: how many frames have the right decision
    Recognise(recognise::Args),
    /// Targets that vanish from real video and come back: how soon they are found, and whether anything else is taken for them
    Recovery(recovery::Args),
    /// Where it learned to look at each digit: the paper's figure of reward surfaces
    Surfaces(surfaces::Args),
}

pub fn run(args: Args) -> Result<()> {
    match args.kind {
        Kind::Clutter(args) => clutter::run(args),
        Kind::HedgeCurve(args) => hedge_curve::run(args),
        Kind::Multi(args) => multi::run(args),
        Kind::Partial(args) => partial::run(args),
        Kind::Recognise(args) => recognise::run(args),
        Kind::Recovery(args) => recovery::run(args),
        Kind::Surfaces(args) => surfaces::run(args),
    }
}

/// Which videos of digits there are.
#[derive(clap::Args)]
struct Videos {
    /// Number of videos; of each digit, where digits are followed one by one
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// The first video's seed; it names the trackers' randomness, too
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    first_seed: u64,
    /// Length of each video
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    frames: u32,
    /// Folder with MNIST's test files (t10k-*, plain or .gz) [default: $FOVEATE_DATA or data; without them the digits are
    /// drawn by a pen]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

impl Videos {
    /// One after the other.
    fn seeds(&self) -> impl Iterator<Item = u64> + use<> {
        let first = self.first_seed;
        (0..self.seeds).map(move |i| first.wrapping_add(i))
    }
    fn frames(&self) -> usize {
        self.frames as usize
    }
    /// What they are made of, and what that is called.
    fn digits(&self) -> Result<(Digits, String)> {
        digits(self.data.as_deref())
    }
}

impl std::fmt::Display for Videos {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let last = self.first_seed.wrapping_add(self.seeds - 1);
        write!(f, "seeds {} to {last}, {} frames", self.first_seed, self.frames)
    }
}

/// What all experiments on digits one by one can be told.
#[derive(clap::Args)]
struct Common {
    /// A configuration file, or the name of one that ships with the program; may be repeated
    #[arg(long, short, value_name = "FILE")]
    config: Vec<String>,
    /// Run each configuration with every policy (else with its own and the fixed centre)
    #[arg(long)]
    policies: bool,
    /// The digits to follow, such as 3 or 0-4,7
    #[arg(long, value_name = "LIST", default_value = "0-9", value_parser = parse_digits)]
    digits: ::std::vec::Vec<u8>, // spelt out, or clap would take it for an option given many times
    #[command(flatten)]
    videos: Videos,
    /// Folder for table.txt, table.json and the finished runs [default: out/ and the experiment's name]
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
}

/// One kind of video, and what to say of it.
struct Scenes {
    /// The experiment's name.
    name: &'static str,
    /// First line of the table.
    title: String,
    /// What others have, below the table.
    peers: &'static str,
    /// For each kind: what its column says, and the settings for a digit and a seed.
    kinds: Vec<(f64, Settings)>,
}

/// Settings of the video with this digit and seed.
type Settings = Box<dyn Fn(u8, u64) -> Synthetic + Sync>;

pub fn parse_digits(text: &str) -> std::result::Result<Vec<u8>, String> {
    let wrong = || format!("expected digits from 0 to 9 such as 3 or 0-4,7, got {text}");
    let digit = |part: &str| part.trim().parse::<u8>().ok().filter(|d| *d <= 9).ok_or_else(wrong);
    let mut digits = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        digits.extend(digit(first)?..=digit(last)?);
    }
    digits.sort();
    digits.dedup();
    if digits.is_empty() { Err(wrong()) } else { Ok(digits) }
}

/// Does all runs that are not done yet, and writes the table.
fn compare(args: &Common, shipped: &[&str], scenes: &Scenes) -> Result<()> {
    let (digits, from) = args.videos.digits()?;
    let entries = entries(args, shipped)?;
    let jobs = jobs(args, scenes, entries.len());
    let out = args.out.clone().unwrap_or_else(|| Path::new("out").join(scenes.name));
    let runs: Vec<Run> = all_runs(scenes.name, &out, &entries, &jobs, (&digits, &from), &Run::follow)?;
    let lines = table(scenes, &entries, &jobs, &runs)?;
    let results = json!({ "experiment": scenes.title, "lines": lines, "others": scenes.peers });
    report(args, (&scenes.title, &from), &out, &experiment::text(&lines, scenes.peers), results, &[])
}

/// What is run: for each configuration the fixed centre first, then the other policies.
fn entries(args: &Common, shipped: &[&str]) -> Result<Vec<Entry>> {
    let names: Vec<String> = if args.config.is_empty() {
        shipped.iter().map(|name| name.to_string()).collect()
    } else {
        args.config.clone()
    };
    let mut entries = Vec::new();
    for name in names {
        let config = blueprint(&name)?.config().clone();
        let file = Path::new(&name);
        let base = if file.is_file() { file.parent().unwrap_or(Path::new(".")) } else { Path::new(".") };
        let own = config.policy.clone();
        let mut policies = if args.policies { line_up::policies(&own) } else { vec![line_up::FIXED] };
        if !policies.contains(&own) {
            policies.push(own.clone());
        }
        let fixed = entries.len();
        let stem = file.file_stem().filter(|_| file.is_file());
        let shown = stem.map_or_else(|| name.clone(), |stem| stem.to_string_lossy().into_owned());
        for policy in policies {
            let own = policy == own;
            let entry = Entry::of(&shown, Config { policy, ..config.clone() }, base)?;
            entries.push(Entry { own, fixed, ..entry });
        }
    }
    Ok(entries)
}

/// All runs, entry after entry, kind after kind: those of one line stand together, in the order of its videos.
fn jobs(args: &Common, scenes: &Scenes, entries: usize) -> Vec<Job> {
    let mut jobs = Vec::new();
    for entry in 0..entries {
        for (kind, (_, settings)) in scenes.kinds.iter().enumerate() {
            for &digit in &args.digits {
                jobs.extend(args.videos.seeds().map(|seed| Job { entry, kind, video: settings(digit, seed), seed }));
            }
        }
    }
    jobs
}

/// One line for each entry and kind of video.
fn table(scenes: &Scenes, entries: &[Entry], jobs: &[Job], runs: &[Run]) -> Result<Vec<Line>> {
    let of = |entry: usize, kind: usize| -> Vec<&Run> {
        let mine = |job: &Job| job.entry == entry && job.kind == kind;
        jobs.iter().zip(runs).filter(|(job, _)| mine(job)).map(|(_, run)| run).collect()
    };
    let mut lines = Vec::new();
    for (kind, (noise, _)) in scenes.kinds.iter().enumerate() {
        for (i, entry) in entries.iter().enumerate() {
            let fixed = (entry.fixed != i).then(|| of(entry.fixed, kind));
            let line = Line::of(&entry.name, &entry.policy, *noise, &of(i, kind), fixed.as_deref())?;
            lines.push(Line { own: entry.own, ..line });
        }
    }
    Ok(lines)
}

/// [`keep`]s the results, which are an object, with what the experiment ran on.
fn report(
    args: &Common,
    (title, from): (&str, &str),
    out: &Path,
    text: &str,
    mut results: Value,
    more: &[(&str, String)],
) -> Result<()> {
    let videos = &args.videos;
    let text = format!("{title}: {from}; digits {:?}, {videos}\n\n{text}", args.digits);
    for (name, value) in [
        ("digits_from", json!(from)),
        ("digits", json!(args.digits)),
        ("first_seed", json!(videos.first_seed)),
        ("seeds", json!(videos.seeds)),
        ("frames", json!(videos.frames)),
    ] {
        results[name] = value;
    }
    keep(out, &text, &results, args.json, more)
}

/// Writes table.txt, table.json and `more` files into `out`, and prints the text, or else the JSON.
fn keep(out: &Path, text: &str, results: &Value, json: bool, more: &[(&str, String)]) -> Result<()> {
    let results = serde_json::to_string_pretty(results).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(out.join("table.txt"), text.as_bytes())?;
    files::write(out.join("table.json"), results.as_bytes())?;
    more.iter().try_for_each(|(name, content)| files::write(out.join(name), content.as_bytes()))?;
    if json {
        say!("{results}");
    } else {
        let names: Vec<&str> = ["table.txt", "table.json"].into_iter().chain(more.iter().map(|m| m.0)).collect();
        say!("{text}\n{}: {}", out.display(), names.join(", "));
    }
    Ok(())
}
