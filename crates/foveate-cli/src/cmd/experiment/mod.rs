//! `foveate experiment`: the paper's experiments, as tables.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use clap::Subcommand;
use foveate::config::{Blueprint, Config};
use foveate::eval::experiment::{self, Line, Run};
use foveate::eval::line_up;
use foveate::scene::synthetic::{Drawn, Synthetic};
use foveate::scene::{Digits, Split};
use foveate::tracker::Tracker;
use foveate::{Error, Result, files};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use super::track::blueprint;
use crate::terminal;

mod clutter;
mod hedge_curve;
mod partial;
mod recognise;
pub(in crate::cmd) mod recovery;
mod surfaces;

/// Digits drawn of each class where there is no MNIST.
const DRAWN: usize = 40;

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
        Kind::Partial(args) => partial::run(args),
        Kind::Recognise(args) => recognise::run(args),
        Kind::Recovery(args) => recovery::run(args),
        Kind::Surfaces(args) => surfaces::run(args),
    }
}

/// What all experiments on digits can be told.
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
    /// Videos of each digit
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// The first video's seed; it names the tracker's randomness, too
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    first_seed: u64,
    /// Length of each video
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    frames: u32,
    /// Folder with MNIST's test files (t10k-*, plain or .gz) [default: $FOVEATE_DATA or data; without them the digits are
    /// drawn by a pen]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
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

fn parse_digits(text: &str) -> std::result::Result<Vec<u8>, String> {
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

/// A configuration with one of its policies.
struct Entry {
    name: String,
    policy: String,
    own: bool,
    /// The entry of the same configuration with the fixed centre.
    fixed: usize,
    blueprint: Blueprint,
    /// What its results depend on: configuration, model, program.
    key: String,
}

/// Which run: indices of the entry and of the kind of video, and the video.
struct Job {
    entry: usize,
    kind: usize,
    video: Synthetic,
}

/// What a finished run's file holds.
#[derive(Serialize)]
struct Stored<'a, R> {
    configuration: &'a Config,
    video: &'a Synthetic,
    digits: &'a str,
    #[serde(flatten)]
    run: &'a R,
}

/// Follows the target of a video.
type Following<R> = dyn Fn(&dyn Drawn, &mut Tracker) -> Result<R> + Sync;

/// What an experiment keeps of one tracker on one video.
trait Kept: Serialize + DeserializeOwned + Clone + Send {
    /// Whether it could be that of a video of so many frames: a check of what was read from a file.
    fn is_of(&self, frames: usize) -> bool;
}

impl Kept for Run {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// Does all runs that are not done yet, and writes the table.
fn compare(args: &Common, shipped: &[&str], scenes: &Scenes) -> Result<()> {
    let (digits, from) = digits(args.data.as_deref())?;
    let entries = entries(args, shipped)?;
    let jobs = jobs(args, scenes, entries.len());
    let out = args.out.clone().unwrap_or_else(|| Path::new("out").join(scenes.name));
    let runs: Vec<Run> = all_runs(scenes.name, &out, &entries, &jobs, (&digits, &from), &Run::follow)?;
    report(args, scenes, &out, &from, &table(scenes, &entries, &jobs, &runs)?)
}

/// The runs of all jobs, in their order; those that are not in the store of `out` yet are done by `follow` and put
/// there. With the digits comes what they are.
fn all_runs<R: Kept>(
    name: &'static str,
    out: &Path,
    entries: &[Entry],
    jobs: &[Job],
    (digits, from): (&Digits, &str),
    follow: &Following<R>,
) -> Result<Vec<R>> {
    let store = out.join("runs");
    std::fs::create_dir_all(&store).map_err(Error::io(&store, "cannot create the folder for finished runs"))?;
    let pixels = experiment::digest(&[&digits.images, &digits.labels]);

    terminal::catch_interrupts();
    let bar = terminal::progress(Some(jobs.len()), name);
    let resumed = AtomicUsize::new(0);
    let work = |job: &Job| {
        let entry = &entries[job.entry];
        let scene = serde_json::to_vec(&job.video).expect("settings are plain data");
        let key = experiment::digest(&[entry.key.as_bytes(), &scene, pixels.as_bytes()]);
        let path = store.join(format!("{key}.json"));
        if let Some(run) = read::<R>(&path, job.video.frames()) {
            resumed.fetch_add(1, Ordering::Relaxed);
            bar.inc(1);
            return Ok(run);
        }
        let mut tracker = entry.blueprint.tracker(job.video.seed(), u64::from(job.video.digit()))?;
        let run = follow(&*job.video.video(digits)?, &mut tracker)?;
        let stored = Stored { configuration: entry.blueprint.config(), video: &job.video, digits: from, run: &run };
        files::write(&path, &serde_json::to_vec(&stored).map_err(|e| Error::Invalid(e.to_string()))?)?;
        bar.inc(1);
        Ok(run)
    };
    let runs = side_by_side(jobs, &work)?;
    bar.finish_and_clear();
    let done = runs.iter().flatten().count();
    if done < jobs.len() {
        println!("stopped after {done} of {} runs; the same command goes on from there", jobs.len());
        std::process::exit(130);
    }
    eprintln!("{} runs, {} of them from {}", jobs.len(), resumed.into_inner(), store.display());
    Ok(runs.into_iter().flatten().collect())
}

/// The digits that videos are made of, and what they are.
fn digits(data: Option<&Path>) -> Result<(Digits, String)> {
    let mnist = |dir: &Path| Ok((Digits::load(dir, Split::Test)?, "MNIST test digits".to_owned()));
    if let Some(dir) = data {
        return mnist(dir);
    }
    let dir = std::env::var_os("FOVEATE_DATA").map_or_else(|| PathBuf::from("data"), PathBuf::from);
    mnist(&dir).or_else(|error| {
        let note = "digits drawn by a pen, NOT MNIST: figures are not to be compared with those on MNIST";
        eprintln!("foveate: {note} ({error}; --data DIR says where they are)");
        Ok((Digits::drawn(1, DRAWN), note.to_owned()))
    })
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
            // The seed of each run is its video's.
            let blueprint = Config { policy: policy.clone(), seed: 0, ..config.clone() }.check(base)?;
            let key = format!(
                "{} {} {}",
                env!("CARGO_PKG_VERSION"),
                experiment::fingerprint(&blueprint)?,
                blueprint.config().to_toml()
            );
            entries.push(Entry {
                name: shown.clone(),
                policy: line_up::policy_name(&policy),
                own: policy == own,
                fixed,
                blueprint,
                key,
            });
        }
    }
    Ok(entries)
}

/// All runs, entry after entry, kind after kind: those of one line stand together, in the order of its videos.
fn jobs(args: &Common, scenes: &Scenes, entries: usize) -> Vec<Job> {
    let seeds: Vec<u64> = (0..args.seeds).map(|i| args.first_seed.wrapping_add(i)).collect();
    let mut jobs = Vec::new();
    for entry in 0..entries {
        for (kind, (_, settings)) in scenes.kinds.iter().enumerate() {
            for &digit in &args.digits {
                jobs.extend(seeds.iter().map(|&seed| Job { entry, kind, video: settings(digit, seed) }));
            }
        }
    }
    jobs
}

/// A finished run; `None` where there is none, or its file is damaged.
fn read<R: Kept>(path: &Path, frames: usize) -> Option<R> {
    let run: R = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
    run.is_of(frames).then_some(run)
}

/// Does all jobs, as many at a time as there are threads and each one in a single thread; the results stand in the order
/// of the jobs, and are missing where it was asked to stop.
fn side_by_side<R: Kept>(jobs: &[Job], work: &(dyn Fn(&Job) -> Result<R> + Sync)) -> Result<Vec<Option<R>>> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let runs = Mutex::new(vec![None; jobs.len()]);
    // A pool of one thread: what the tracker shares out stays in its own job, or times would be those of several.
    let worker = || -> Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|e| Error::Invalid(format!("cannot start a thread: {e}; give a smaller --threads")))?;
        while !terminal::stopping() && !failed.load(Ordering::Relaxed) {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(i) else { break };
            let run = pool.install(|| work(job));
            failed.fetch_or(run.is_err(), Ordering::Relaxed);
            runs.lock().expect("no thread panics while it holds the list")[i] = Some(run?);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..rayon::current_num_threads()).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().try_for_each(|w| w.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })?;
    Ok(runs.into_inner().expect("all threads have ended"))
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

fn report(args: &Common, scenes: &Scenes, out: &Path, from: &str, lines: &[Line]) -> Result<()> {
    let last = args.first_seed.wrapping_add(args.seeds - 1);
    let title = format!(
        "{}: {from}; digits {:?}, seeds {} to {last}, {} frames",
        scenes.title, args.digits, args.first_seed, args.frames
    );
    let text = format!("{title}\n\n{}", experiment::text(lines, scenes.peers));
    let all = json!({
        "experiment": scenes.title,
        "digits_from": from,
        "digits": args.digits,
        "first_seed": args.first_seed,
        "seeds": args.seeds,
        "frames": args.frames,
        "lines": lines,
        "others": scenes.peers,
    });
    let all = serde_json::to_string_pretty(&all).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(out.join("table.txt"), text.as_bytes())?;
    files::write(out.join("table.json"), all.as_bytes())?;
    if args.json {
        println!("{all}");
    } else {
        println!("{text}\n{}: table.txt, table.json", out.display());
    }
    Ok(())
}
