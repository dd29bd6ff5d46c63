//! `foveate experiment`: the paper's experiments, as tables.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use clap::{Subcommand, ValueEnum};
use foveate::config::{BUILTIN, Blueprint, Config};
use foveate::eval::clutter::{self, Line, Run};
use foveate::scene::synthetic::{Clutter, NOISE};
use foveate::scene::{Digits, Split};
use foveate::{Error, Result, files};
use serde::Serialize;
use serde_json::json;

use super::track::blueprint;
use crate::terminal;

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
    Clutter(ClutterArgs),
}

/// A digit among static ones: every configuration and policy beside the fixed centre, on the same videos.
///
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
struct ClutterArgs {
    /// A configuration file, or the name of one that ships with the program; may be repeated
    /// [default: digits and its variants, and authors]
    #[arg(long, short, value_name = "FILE")]
    config: Vec<String>,
    /// Run each configuration with every policy: fixed, random, circular, hedge, anchor+random, anchor+hedge
    /// (else with its own and the fixed centre)
    #[arg(long)]
    policies: bool,
    /// Without salt and pepper, with it (density 0.3), or both
    #[arg(long, value_enum, default_value_t = Noise::Both)]
    noise: Noise,
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
    /// Folder for table.txt, table.json and the finished runs
    #[arg(long, short, value_name = "DIR", default_value = "out/clutter")]
    out: PathBuf,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
}

#[derive(ValueEnum, Clone, Copy)]
enum Noise {
    Clean,
    Noisy,
    Both,
}

impl Noise {
    fn densities(self) -> &'static [f64] {
        match self {
            Self::Clean => &[0.0],
            Self::Noisy => &[NOISE],
            Self::Both => &[0.0, NOISE],
        }
    }
}

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

/// Which run: indices of the entry, and the video.
struct Job {
    entry: usize,
    video: Clutter,
}

/// What a finished run's file holds.
#[derive(Serialize)]
struct Stored<'a> {
    configuration: &'a Config,
    video: &'a Clutter,
    digits: &'a str,
    #[serde(flatten)]
    run: &'a Run,
}

pub fn run(args: Args) -> Result<()> {
    let Kind::Clutter(args) = args.kind;
    let (digits, from) = digits(args.data.as_deref())?;
    let entries = entries(&args)?;
    let jobs = jobs(&args, entries.len());
    let store = args.out.join("runs");
    std::fs::create_dir_all(&store).map_err(Error::io(&store, "cannot create the folder for finished runs"))?;
    let pixels = clutter::digest(&[&digits.images, &digits.labels]);

    terminal::catch_interrupts();
    let bar = terminal::progress(Some(jobs.len()), "clutter");
    let resumed = AtomicUsize::new(0);
    let work = |job: &Job| {
        let entry = &entries[job.entry];
        let scene = serde_json::to_vec(&job.video).expect("settings are plain data");
        let path = store.join(format!("{}.json", clutter::digest(&[entry.key.as_bytes(), &scene, pixels.as_bytes()])));
        if let Some(run) = read(&path, job.video.frames) {
            resumed.fetch_add(1, Ordering::Relaxed);
            bar.inc(1);
            return Ok(run);
        }
        let mut tracker = entry.blueprint.tracker(job.video.seed, u64::from(job.video.digit))?;
        let run = Run::follow(job.video.video(&digits)?, &mut tracker)?;
        let stored = Stored { configuration: entry.blueprint.config(), video: &job.video, digits: &from, run: &run };
        files::write(&path, &serde_json::to_vec(&stored).map_err(|e| Error::Invalid(e.to_string()))?)?;
        bar.inc(1);
        Ok(run)
    };
    let runs = side_by_side(&jobs, &work)?;
    bar.finish_and_clear();
    let done = runs.iter().flatten().count();
    if done < jobs.len() {
        println!("stopped after {done} of {} runs; the same command goes on from there", jobs.len());
        std::process::exit(130);
    }
    let runs: Vec<Run> = runs.into_iter().flatten().collect();
    eprintln!("{} runs, {} of them from {}", jobs.len(), resumed.into_inner(), store.display());
    report(&args, &from, &table(&args, &entries, &jobs, &runs)?)
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
fn entries(args: &ClutterArgs) -> Result<Vec<Entry>> {
    let shipped = || BUILTIN.iter().map(|b| b.0).filter(|name| name.starts_with("digits") || *name == "authors");
    let names: Vec<String> =
        if args.config.is_empty() { shipped().map(String::from).collect() } else { args.config.clone() };
    let mut entries = Vec::new();
    for name in names {
        let config = blueprint(&name)?.config().clone();
        let file = Path::new(&name);
        let base = if file.is_file() { file.parent().unwrap_or(Path::new(".")) } else { Path::new(".") };
        let own = config.policy.clone();
        let mut policies =
            if args.policies { clutter::policies(&own, args.frames as usize) } else { vec![clutter::FIXED] };
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
                clutter::fingerprint(&blueprint)?,
                blueprint.config().to_toml()
            );
            entries.push(Entry {
                name: shown.clone(),
                policy: clutter::policy_name(&policy),
                own: policy == own,
                fixed,
                blueprint,
                key,
            });
        }
    }
    Ok(entries)
}

/// All runs, entry after entry, noise after noise: those of one line stand together, in the order of its videos.
fn jobs(args: &ClutterArgs, entries: usize) -> Vec<Job> {
    let seeds: Vec<u64> = (0..args.seeds).map(|i| args.first_seed.wrapping_add(i)).collect();
    let mut jobs = Vec::new();
    for entry in 0..entries {
        for &noise in args.noise.densities() {
            for &digit in &args.digits {
                let video =
                    |&seed: &u64| Clutter { digit, seed, noise, frames: args.frames as usize, ..Clutter::default() };
                jobs.extend(seeds.iter().map(video).map(|video| Job { entry, video }));
            }
        }
    }
    jobs
}

/// A finished run; `None` where there is none, or its file is damaged.
fn read(path: &Path, frames: usize) -> Option<Run> {
    let run: Run = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
    run.is_of(frames).then_some(run)
}

/// Does all jobs, as many at a time as there are threads and each one in a single thread; the results stand in the order
/// of the jobs, and are missing where it was asked to stop.
fn side_by_side(jobs: &[Job], work: &(dyn Fn(&Job) -> Result<Run> + Sync)) -> Result<Vec<Option<Run>>> {
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

/// One line for each entry and noise.
fn table(args: &ClutterArgs, entries: &[Entry], jobs: &[Job], runs: &[Run]) -> Result<Vec<Line>> {
    let of = |entry: usize, noise: f64| -> Vec<&Run> {
        let mine = |job: &Job| job.entry == entry && job.video.noise == noise;
        jobs.iter().zip(runs).filter(|(job, _)| mine(job)).map(|(_, run)| run).collect()
    };
    let mut lines = Vec::new();
    for &noise in args.noise.densities() {
        for (i, entry) in entries.iter().enumerate() {
            let fixed = (entry.fixed != i).then(|| of(entry.fixed, noise));
            let line = Line::of(&entry.name, &entry.policy, noise, &of(i, noise), fixed.as_deref())?;
            lines.push(Line { own: entry.own, ..line });
        }
    }
    Ok(lines)
}

fn report(args: &ClutterArgs, from: &str, lines: &[Line]) -> Result<()> {
    let last = args.first_seed.wrapping_add(args.seeds - 1);
    let title = format!(
        "A digit among static ones: {from}; digits {:?}, seeds {} to {last}, {} frames",
        args.digits, args.first_seed, args.frames
    );
    let text = format!("{title}\n\n{}", clutter::text(lines));
    let all = json!({
        "digits_from": from,
        "digits": args.digits,
        "first_seed": args.first_seed,
        "seeds": args.seeds,
        "frames": args.frames,
        "lines": lines,
        "others": clutter::PEERS,
    });
    let all = serde_json::to_string_pretty(&all).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(args.out.join("table.txt"), text.as_bytes())?;
    files::write(args.out.join("table.json"), all.as_bytes())?;
    if args.json {
        println!("{all}");
    } else {
        println!("{text}\n{}: table.txt, table.json", args.out.display());
    }
    Ok(())
}
