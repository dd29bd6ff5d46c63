//! Implements `paper reproduce`: the paper's tables and figures beside ours, and user-defined experiments, on one page.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate::text::counted;
use foveate::{Error, Result, files};

use self::output::{Content, Section};
use self::plan::{EXPERIMENTS, Experiment, Kind};
use self::results::Results;
use self::seeds::Seeds;
use self::setup::Setup;
use foveate_cli::runs::{self, Store};
use foveate_cli::{note, say, terminal};

mod curve;
mod docs;
mod figures;
mod line;
mod markdown;
mod multi;
mod multi_table;
mod output;
mod page;
mod peers;
mod plan;
mod recovery;
mod results;
mod seeds;
mod setup;
mod surfaces;
mod table;

/// Run the paper's experiments and write its tables and figures beside those of foveate on one page.
///
/// NAME is all, tables, figures, why (each necessary change on its own), an experiment such as table1, closeup, fig-digits, why-reward,
/// recovery, or a TOML file in the format of experiments/NAME/experiment.toml. DIR receives the self-contained index.html, NAME.json,
/// NAME.csv of each table, NAME.txt of some figures, and the pictures. Finished runs are kept in DIR/runs: the same command resumes after
/// an interruption, and results do not depend on the number of threads. The command fails if a value lies outside its expected range.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Experiments to run
    #[arg(value_name = "NAME", default_value = "all")]
    names: Vec<String>,
    /// Folder with MNIST's test files in it or in mnist/, and sequences in tracking/ [default: $FOVEATE_DATA or data; without MNIST, digits
    /// are drawn with pen strokes]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Output folder for the page, the results and the finished runs
    #[arg(long, short, value_name = "DIR", default_value = "out/reproduce")]
    out: PathBuf,
    /// Seeds of videos and trackers: their number, or a range such as 11..=20 [default: the experiment's seeds]
    #[arg(long, value_name = "N|A..=B")]
    seeds: Option<Seeds>,
    /// Change a setting of every configuration, such as particles=400. Repeatable
    #[arg(long, value_name = "KEY=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
    /// Run a small variant of everything as a quick test: a minute or two
    #[arg(long)]
    quick: bool,
    /// Do only shard I of N of the runs and write no page, to distribute the runs over several machines; combine their folders with --merge
    #[arg(long, value_name = "I/N", value_parser = runs::parse_shard)]
    shard: Option<(u32, u32)>,
    /// Also take finished runs from these other --out folders. Repeatable
    #[arg(long, value_name = "DIR")]
    merge: Vec<PathBuf>,
    /// Results of other trackers on the same videos, as bench/peers.py writes them. Repeatable
    #[arg(long, value_name = "FILE")]
    peer: Vec<PathBuf>,
    /// Write the tables into a checkout of the project: experiments/results, docs
    #[arg(long, value_name = "CHECKOUT", conflicts_with_all = ["quick", "shard", "set"])]
    write_docs: Option<PathBuf>,
}

/// Returns the requested experiments, each once: those of the program in the order of the page, then files. Fails if the results of two
/// files would have the same names.
fn chosen(names: &[String]) -> Result<Vec<Experiment>> {
    let such = |name: &str, word: &str| match word {
        "all" => true,
        "tables" => name.starts_with("table"),
        "figures" => name.starts_with("fig-"),
        "why" => name.starts_with("why-"),
        _ => name == word,
    };
    let ours = EXPERIMENTS.iter().map(|e| e.0);
    let mut wanted: Vec<&str> = ours.filter(|name| names.iter().any(|word| such(name, word))).collect();
    for word in names.iter().filter(|word| !EXPERIMENTS.iter().any(|e| such(e.0, word))) {
        if !wanted.contains(&&**word) {
            wanted.push(word);
        }
    }
    let all: Vec<Experiment> = wanted.iter().map(|word| Experiment::named(word)).collect::<Result<_>>()?;
    for (i, experiment) in all.iter().enumerate() {
        if let Some(before) = all[..i].iter().position(|other| other.name == experiment.name) {
            return Err(Error::Config(format!(
                "{}: its results would replace those of {}; rename one of the files",
                wanted[i], wanted[before]
            )));
        }
    }
    Ok(all)
}

pub(crate) fn run(args: Args) -> Result<()> {
    let began = Instant::now();
    let mut experiments = chosen(&args.names)?;
    for experiment in &mut experiments {
        if args.quick {
            experiment.make_quick();
        }
        experiment.seeds = args.seeds.unwrap_or(experiment.seeds);
    }
    let store = Store::shared(&args.out, &args.merge, args.shard)?;
    let setup = Setup::of(args.data, store, args.out)?;
    let setup = Setup { settings: args.set, quick: args.quick, ..setup };
    if let Some(root) = &args.write_docs {
        docs::check(root, &setup)?;
    }
    let peers = peers::read(&args.peer)?;
    std::fs::create_dir_all(&setup.out).map_err(Error::io(&setup.out, "cannot make the folder for results"))?;
    let (mut sections, mut missing) = (vec![], 0);
    for (i, experiment) in experiments.iter().enumerate() {
        note!("{} of {}: {}", i + 1, experiments.len(), experiment.title);
        let content = content(experiment, &setup)?;
        if terminal::stopping() {
            say!("stopped at {}; the same command continues from there", experiment.name);
            std::process::exit(terminal::stop_status());
        }
        let Some(mut content) = content else {
            missing += 1;
            continue;
        };
        if let Content::Table(table) = &mut content {
            table.results.lines.extend(peers::lines(&peers, experiment));
            table.speeds.resize(table.results.lines.len().max(table.speeds.len()), None);
        }
        let (title, about) = (experiment.title.clone(), experiment.about.trim().to_owned());
        let section = Section { name: experiment.name.clone(), title, about, content };
        section.write(&setup.out)?;
        sections.push(section);
    }
    if setup.store.shard.is_some() {
        runs::part_is_done(&setup.out);
        return Ok(());
    }
    if missing > 0 {
        return Err(Error::Invalid(format!("no results of {}", counted(missing, "experiment"))));
    }
    let path = setup.out.join("index.html");
    files::write_inside(&path, page::html(&sections, &setup.from, setup.quick, began.elapsed()).as_bytes())?;
    let tables: Vec<&Results> = sections.iter().filter_map(Section::results).collect();
    if let Some(root) = &args.write_docs {
        docs::write(root, &tables)?;
    }
    report(&path, &sections, began)
}

/// Runs an experiment. `None` if runs are missing: those of another shard, or after a stop request. Figures that take seconds are not part
/// of a shard.
fn content(experiment: &Experiment, setup: &Setup) -> Result<Option<Content>> {
    let table = |table| Content::Table(Box::new(table));
    Ok(match experiment.kind {
        Kind::Table => table::table(experiment, setup)?.map(table),
        Kind::Multi => multi::multi(experiment, setup)?.map(table),
        Kind::Digits => surfaces::surfaces(experiment, setup)?.map(Content::Figure),
        Kind::Curve => curve::curve(experiment, setup)?.map(Content::Figure),
        Kind::Recovery => recovery::recovery(experiment, setup)?.map(Content::Figure),
        _ if setup.store.shard.is_some() => None,
        Kind::Policy => Some(Content::Figure(figures::policy(experiment, setup)?)),
        Kind::Face => Some(Content::Figure(figures::face(experiment, setup)?)),
    })
}

/// Prints the results; fails if an expectation is not met.
fn report(path: &Path, sections: &[Section], began: Instant) -> Result<()> {
    for section in sections {
        if let Content::Figure(figure) = &section.content {
            figure.missing.iter().for_each(|what| say!("{}, not shown: {what}", section.title));
            if !figure.text.is_empty() {
                say!("{}\n\n{}", section.title, figure.text);
            }
        }
    }
    let checks: Vec<_> = sections.iter().filter_map(Section::results).flat_map(|results| &results.checks).collect();
    checks.iter().for_each(|check| say!("{}", check.text()));
    say!("{} ({:.1} min)", path.display(), began.elapsed().as_secs_f64() / 60.0);
    match checks.iter().filter(|check| !check.met && !check.goal).count() {
        0 => Ok(()),
        n => {
            let all = counted(checks.len(), "figure");
            Err(Error::Invalid(format!("outside of the expected range: {n} of {all}")))
        }
    }
}
