//! `foveate reproduce`: the paper's tables and figures beside ours, on one page.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate::scene::Digits;
use foveate::{Error, Result, files};

use self::page::{Content, Section};
use self::plan::{EXPERIMENTS, Experiment, Kind};
use self::results::Results;
use super::experiment::runner::{Store, digits};
use crate::terminal;

mod crowd;
mod docs;
mod figures;
mod markdown;
mod page;
mod peers;
mod plan;
mod results;
mod table;

/// The paper's tables and figures beside ours: runs what is not done yet, and writes one page.
///
/// WHAT is all, tables, figures, why (what had to change, each thing on its own), or names such as table1, fig-digits,
/// why-reward. DIR gets index.html, which needs nothing else, NAME.json and NAME.csv of each table, and the pictures.
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed, and results do not
/// depend on the number of threads. It fails where a figure is outside of its expected range.
#[derive(clap::Args)]
pub struct Args {
    /// What to run
    #[arg(value_name = "WHAT", default_value = "all")]
    what: Vec<String>,
    /// Folder with MNIST's test files in it or in mnist/, and sequences in tracking/ [default: $FOVEATE_DATA or data;
    /// without MNIST the digits are drawn by a pen]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the page, the results and the finished runs
    #[arg(long, short, value_name = "DIR", default_value = "out/reproduce")]
    out: PathBuf,
    /// Videos of each digit [default: what the experiment says, 10 for the paper's tables]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: Option<u64>,
    /// A small variant of everything, to see whether it works: a minute or two
    #[arg(long)]
    quick: bool,
    /// Do only part I of N of the runs, and no page: for several machines, whose folders are put together by --merge
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<(u32, u32)>,
    /// Take finished runs from these folders of other --out too; may be repeated
    #[arg(long, value_name = "DIR")]
    merge: Vec<PathBuf>,
    /// Results of other trackers on the same videos, as bench/peers.py writes them; may be repeated
    #[arg(long, value_name = "FILE")]
    peer: Vec<PathBuf>,
    /// Put the tables into a checkout of the project: experiments/results, docs and README.md
    #[arg(long, value_name = "CHECKOUT", conflicts_with_all = ["quick", "shard"])]
    write_docs: Option<PathBuf>,
}

/// What the experiments are run on.
pub struct Ground {
    digits: Digits,
    /// What the digits are.
    from: String,
    /// Whether they are MNIST's.
    mnist: bool,
    data: PathBuf,
    store: Store,
    quick: bool,
}

fn parse_shard(text: &str) -> std::result::Result<(u32, u32), String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i - 1, n)),
        _ => Err(format!("expected a part and the number of parts, such as 1/4, got {text}")),
    }
}

/// The experiments that are asked for, each once, in the order of the page.
fn chosen(what: &[String]) -> Result<Vec<Experiment>> {
    let mut wanted: Vec<&str> = vec![];
    for word in what {
        let such = |prefix: &'static str| EXPERIMENTS.iter().map(|e| e.0).filter(move |name| name.starts_with(prefix));
        match word.as_str() {
            "all" => wanted.extend(such("")),
            "tables" => wanted.extend(such("table")),
            "figures" => wanted.extend(such("fig-")),
            "why" => wanted.extend(such("why-")),
            name => wanted.push(Experiment::builtin(name).map(|_| name)?),
        }
    }
    EXPERIMENTS.iter().filter(|e| wanted.contains(&e.0)).map(|e| Experiment::builtin(e.0)).collect()
}

pub fn run(args: Args) -> Result<()> {
    let began = Instant::now();
    let mut experiments = chosen(&args.what)?;
    for experiment in &mut experiments {
        if args.quick {
            experiment.make_quick();
        }
        experiment.seeds = args.seeds.unwrap_or(experiment.seeds);
    }
    let ground = ground(&args)?;
    let peers = peers::read(&args.peer)?;
    let (mut sections, mut missing) = (vec![], 0);
    for (i, experiment) in experiments.iter().enumerate() {
        eprintln!("{} of {}: {}", i + 1, experiments.len(), experiment.title);
        let content = match content(experiment, &ground, &args)? {
            _ if terminal::stopping() => {
                say!("stopped at {}; the same command goes on from there", experiment.name);
                std::process::exit(130);
            }
            Some(content) => content,
            None => {
                missing += 1;
                continue;
            }
        };
        let content = match content {
            Content::Table(mut table) => {
                for line in peers::lines(&peers, experiment) {
                    table.results.lines.push(line);
                    table.speeds.push(None);
                }
                write_table(&args.out, &table.results)?;
                figures::write(&table.pictures, &args.out)?;
                Content::Table(table)
            }
            Content::Figure(shown) => {
                shown.write(&args.out, &experiment.name)?;
                Content::Figure(shown)
            }
        };
        let (title, about) = (experiment.title.clone(), experiment.about.trim().to_owned());
        sections.push(Section { name: experiment.name.clone(), title, about, content });
    }
    if args.shard.is_some() {
        say!(
            "{}: this part is done. Put all parts together by the same command without --shard and with",
            args.out.display()
        );
        say!("--merge DIR for each part's folder.");
        return Ok(());
    }
    if missing > 0 {
        return Err(Error::Invalid(format!("{missing} experiments have no results")));
    }
    let path = args.out.join("index.html");
    files::write(&path, page::html(&sections, &ground.from, began.elapsed()).as_bytes())?;
    let tables: Vec<&Results> = sections.iter().filter_map(Section::results).collect();
    if let Some(root) = &args.write_docs {
        docs::write(root, &tables)?;
    }
    report(&path, &tables, began)
}

fn ground(args: &Args) -> Result<Ground> {
    let data = args.data.clone().or_else(|| std::env::var_os("FOVEATE_DATA").map(PathBuf::from));
    let (digits, from) = digits(args.data.as_deref())?;
    let mnist = from.starts_with("MNIST");
    let others = args.merge.iter().map(|dir| dir.join("runs")).collect();
    let store = Store { others, shard: args.shard, ..Store::of(&args.out) };
    if let Some(absent) = store.others.iter().find(|folder| !folder.is_dir()) {
        return Err(Error::Invalid(format!(
            "{}: no finished runs here; --merge takes what was given as --out",
            absent.display()
        )));
    }
    Ok(Ground { digits, from, mnist, data: data.unwrap_or_else(|| "data".into()), store, quick: args.quick })
}

/// Runs an experiment. `None` where runs are missing: those of another shard, or it was asked to stop. Figures that take
/// seconds are no part of a shard.
fn content(experiment: &Experiment, ground: &Ground, args: &Args) -> Result<Option<Content>> {
    Ok(match experiment.kind {
        Kind::Table => table::table(experiment, ground)?.map(Box::new).map(Content::Table),
        Kind::Crowd => crowd::crowd(experiment, ground, &args.out)?.map(Box::new).map(Content::Table),
        Kind::Digits => figures::digits(experiment, ground)?.map(Content::Figure),
        _ if args.shard.is_some() => None,
        Kind::Policy => Some(Content::Figure(figures::policy(experiment, ground)?)),
        Kind::Face => Some(Content::Figure(figures::face(experiment, ground, &args.out)?)),
    })
}

fn write_table(out: &Path, results: &Results) -> Result<()> {
    files::write(out.join(format!("{}.json", results.experiment)), results.json()?.as_bytes())?;
    files::write(out.join(format!("{}.csv", results.experiment)), results.csv().as_bytes())
}

/// Says what came out; fails where an expectation is not met.
fn report(path: &Path, tables: &[&Results], began: Instant) -> Result<()> {
    let checks: Vec<_> = tables.iter().flat_map(|results| &results.checks).collect();
    checks.iter().for_each(|check| say!("{}", check.text()));
    say!("{} ({:.1} min)", path.display(), began.elapsed().as_secs_f64() / 60.0);
    match checks.iter().filter(|check| !check.met && !check.goal).count() {
        0 => Ok(()),
        n => Err(Error::Invalid(format!("{n} of {} figures are outside of their expected range", checks.len()))),
    }
}
