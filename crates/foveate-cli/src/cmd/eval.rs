//! `foveate eval`: scores trackers on sequences with truth: of one target (one-pass evaluation, as OTB does it), of many.

mod choose;
mod grid;
pub(crate) mod kept;
mod one_pass;
pub(crate) mod record;

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use foveate::lab::eval::confidence::{ConfidenceScore, Judged};
use foveate::lab::eval::{
    Case, Evaluation, Row, Sequence, by_attribute, cases, confidence, confidence_plot, curves, find_sequences, mot,
    run_all, score_folder, table, track_files,
};
use foveate::text::counted;
use foveate::{Error, Result, files};

use self::record::{Data, Record, Settings};
use super::configure::{Changes, Profile, config_name, read};
use super::results::InPlace;
use crate::runs::{self, Entry, Store};
use crate::terminal;

/// Scores trackers on sequences whose true boxes are known (one-pass evaluation, as OTB does it).
///
/// Without --results, foveate itself is run on every sequence, from the true box of frame 1, and scored; and so is what it
/// says about being lost: calibration, false alarms, frames to notice a loss, coverage of credible regions.
///
/// By attribute of the sequences (occlusion, fast motion, ...) and by half stand the figures of foveate and of every peer. With
/// --choose, settings are chosen on one half of the sequences and judged on the other, both ways.
///
/// With --mot, tracks of many targets are scored instead: MOTA, IDF1, HOTA and what they are made of, as TrackEval has them:
/// foveate eval --mot --truth DIR --results DIR
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Sequences in the layout of OTB (groundtruth_rect.txt, img/), VOT, GOT-10k or LaSOT (groundtruth.txt), or folders that hold them
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "mot")]
    pub seqs: Vec<PathBuf>,
    /// Score tracks of many targets in MOTChallenge's text (frame,id,x,y,w,h,conf,...) instead
    #[arg(long, requires_all = ["truth", "results"], conflicts_with_all = ["seqs", "config", "policy", "set", "seed", "seeds"])]
    pub mot: bool,
    /// With --mot: sequences (gt/gt.txt, seqinfo.ini), folders that hold them, or files of true tracks.
    /// Rows whose conf is 0 do not count; classes are not read
    #[arg(long, value_name = "DIR|FILE", num_args = 1.., requires = "mot")]
    pub truth: Vec<PathBuf>,
    /// Score these results instead: a folder for each tracker, or one that holds such folders, with SEQUENCE.txt (x,y,w,h a
    /// frame, counted from 1) and, for frames per second, SEQUENCE_time.txt (seconds a frame), or these in seed-1, seed-2 ...;
    /// the curves of the first are drawn thickest. With --mot: SEQUENCE.txt, data/SEQUENCE.txt or
    /// SEQUENCE/tracks.txt, or a file for the only sequence
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["policy", "set"])]
    pub results: Vec<PathBuf>,
    /// Results of other trackers, to stand beside foveate's own in table and curves: folders as --results has them
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["results", "mot"])]
    pub peers: Vec<PathBuf>,
    /// The tracker to run: a configuration file, or the name of one that ships with the program (natural, digits, ...); natural if left out
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "results")]
    pub config: Option<String>,
    /// How much time a frame may take, where no configuration is given
    #[arg(long, value_enum, conflicts_with_all = ["config", "results", "mot"])]
    pub profile: Option<Profile>,
    #[command(flatten)]
    pub changes: Changes,
    /// Choose among values of a setting by mean AUC, on one half of the sequences, and judge on the other half, both ways; also
    /// leave one source video out. For example colour.mixing_weight=0.1,0.2; given several times, all combinations are
    /// candidates. Goes on after a stop
    #[arg(long, value_name = "KEY=VALUE,...", conflicts_with_all = ["results", "mot"])]
    pub choose: Vec<String>,
    /// First seed of the tracker to run
    #[arg(long, default_value_t = 1, conflicts_with = "results")]
    pub seed: u64,
    /// Number of seeds to run, counting up from --seed; mean and spread over them are reported
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000), conflicts_with = "results")]
    pub seeds: u64,
    /// Make the runs side by side, each in one thread, instead of one after another in all threads: the same boxes sooner. Frames
    /// a second are then those of a busy machine. With --choose, --shard and --merge it is always so
    #[arg(long, conflicts_with_all = ["results", "mot"])]
    pub side_by_side: bool,
    /// Do only part I of N of the runs, and no scores: for several machines, whose folders are put together by --merge. A run is
    /// a sequence with a seed (with --choose also a candidate), in one thread, kept in runs/ of --out
    #[arg(long, value_name = "I/N", value_parser = runs::parse_shard, conflicts_with_all = ["results", "mot"])]
    pub shard: Option<(u32, u32)>,
    /// Take finished runs from these folders of other --out (or this one), and do those that they lack; may be repeated
    #[arg(long, value_name = "DIR", conflicts_with_all = ["results", "mot"])]
    pub merge: Vec<PathBuf>,
    /// Folder for table.txt, scores.json, curves.svg (not with --mot); where the tracker is run, the tracks in foveate/, confidence.txt, confidence.json,
    /// reliability.svg and report.html: where the first seed won and lost, with pictures. With --choose: cross.txt, cross.json,
    /// the tracks of each candidate in candidates/, and table.txt, scores.json, curves.svg of the cross-validated tracks. run.json
    /// lists the files; those of an earlier evaluation in it are removed
    #[arg(long, value_name = "DIR", default_value = "out-eval")]
    pub out: PathBuf,
    /// Print scores as JSON instead of the table
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Folders and files whose results are scored.
    fn scored(&self) -> Vec<PathBuf> {
        [&self.results[..], &self.peers].concat()
    }
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    if args.mot {
        return many(&args);
    }
    let name = config_name(args.config.as_deref(), args.profile);
    let (config, folder) = read(name, &args.changes)?;
    let blueprint = config.clone().check(&folder)?;
    let task = Task::of(&args)?;
    if !args.results.is_empty() {
        // Results of others say nothing about being lost.
        let results = begin(&args, vec![])?;
        let record = Record::of(args.scored(), task.sequences.iter().map(Data::without_pictures).collect())?;
        compare(&args, &task.sequences, &task.others, &record, "")?;
        return results.finish();
    }
    one_pass::check(&task.sequences)?;
    let store = Store::shared(&args.out, &args.merge, args.shard)?;
    let described = args.changes.describe(name);
    let plan = match args.choose.is_empty() {
        true => None,
        false => Some(choose::Plan::of(&config, &folder, &args.choose, &task.sequences)?),
    };
    let data: Vec<Data> = task.sequences.iter().map(Data::with_pictures).collect::<Result<_>>()?;
    let entry = Entry::of(blueprint, &record::program()?)?;
    Settings::of(&entry)?.claim(&store.folder, &store.others)?;
    let record = Record::of(args.scored(), data.clone())?.running(&entry, &described, &task.seeds, &args.choose);
    match plan {
        Some(plan) => task.choose(&args, &plan, &data, &store, &record),
        None => task.track(&args, &kept::Runs::new(entry, &task.sequences, &data, &store), &record),
    }
}

/// What is to be scored: sequences, what other trackers did on them, and the seeds that foveate is run with.
struct Task {
    sequences: Vec<Sequence>,
    others: Vec<Evaluation>,
    seeds: Vec<u64>,
}

impl Task {
    fn of(args: &Args) -> Result<Self> {
        let sequences = find_sequences(&args.seqs)?;
        let score = |folder: &PathBuf| score_folder(&sequences, folder);
        let others: Vec<Vec<Evaluation>> = args.results.iter().chain(&args.peers).map(score).collect::<Result<_>>()?;
        let seeds = (0..args.seeds).map(|i| args.seed.wrapping_add(i)).collect();
        Ok(Self { sequences, others: others.concat(), seeds })
    }

    /// An evaluation of ours, and those of the others.
    fn beside(&self, ours: Evaluation) -> Vec<Evaluation> {
        std::iter::once(ours).chain(self.others.iter().cloned()).collect()
    }

    /// Settings are chosen on one half of the sequences, and judged on the other.
    fn choose(&self, args: &Args, plan: &choose::Plan, data: &[Data], store: &Store, record: &Record) -> Result<()> {
        let Self { sequences, seeds, .. } = self;
        let Some(tracks) = plan.run(sequences, data, seeds, store)? else {
            return undone(args);
        };
        let results = begin(args, plan.files(sequences, seeds))?;
        let (choice, cross) = plan.judge(sequences, seeds, &args.out, &tracks)?;
        let text = choose::keep(&choice, record.configuration(), seeds, &args.out)?;
        compare(args, sequences, &self.beside(cross), record, &(text + "\n"))?;
        results.finish()
    }

    /// The tracker is run, and scored beside the others; and so is what it says about being lost.
    fn track(&self, args: &Args, kept: &kept::Runs<'_>, record: &Record) -> Result<()> {
        let Self { sequences, others, seeds } = self;
        // In parts, runs are made side by side; else one after another, so that their times are those of a tracker alone.
        let in_parts = args.shard.is_some() || !args.merge.is_empty();
        let Some(made) = (if in_parts || args.side_by_side { kept.all(seeds)? } else { Some(vec![]) }) else {
            return undone(args);
        };
        let made = RefCell::new(made.into_iter());
        terminal::catch_interrupts();
        let runs: RefCell<Vec<Case>> = RefCell::new(vec![]);
        let run_tracker = |sequence: &Sequence, seed| {
            if terminal::stopping() {
                return Err(runs::stopped(&args.out));
            }
            let next = made.borrow_mut().next();
            let (run, judged) = next.map_or_else(|| kept.one(sequence, seed), Ok)?.apart();
            runs.borrow_mut().push(Case { sequence: sequence.clone(), seed, boxes: run.boxes.clone(), judged });
            Ok(run)
        };
        let out = args.out.join("foveate");
        let said = ["report.html", "confidence.txt", "confidence.json", "reliability.svg"].map(str::to_owned);
        let results = begin(args, [&said[..], &track_files("foveate", sequences, seeds)].concat())?;
        let ours = run_all("foveate", sequences, seeds, Some(&out), &run_tracker, &mut told)?;
        let all = self.beside(ours);
        let groups = compare(args, sequences, &all, record, "")?;
        let curves = curves::panels(&all.iter().map(Evaluation::drawn).collect::<Vec<_>>());
        let runs = runs.into_inner();
        let first: Vec<Case> = runs.iter().filter(|run| run.seed == args.seed).cloned().collect();
        let tracks: Vec<&[Judged]> = runs.iter().map(|run| run.judged.as_slice()).collect();
        let reliability = trusted(args, &ConfidenceScore::of(&tracks, kept.localisation_noise()))?;
        let [success, precision] = curves;
        let charts = [success, precision, ("Reliability of P(lost)", reliability)];
        let page = cases::page(&first, others, &charts, &groups, &record.html())?;
        files::write_inside(args.out.join("report.html"), page.as_bytes())?;
        results.finish()?;
        // What is finished begins anew the next time; parts are kept, to be merged.
        if in_parts { Ok(()) } else { kept.forget(seeds) }
    }
}

/// Begins the results, of which these are not written by every evaluation.
fn begin(args: &Args, more: Vec<String>) -> Result<InPlace> {
    let names = ["table.txt", "scores.json", "curves.svg"].map(str::to_owned);
    let read = [&args.results, &args.peers, &args.seqs, &args.truth, &args.merge].into_iter().flatten();
    let read = read.map(PathBuf::as_path).chain(args.config.as_deref().map(Path::new));
    InPlace::begin(&args.out, [&names[..], &more].concat(), &read.collect::<Vec<_>>())
}

/// Only a part of the runs was to be done, or it was asked to stop.
fn undone(args: &Args) -> Result<()> {
    if terminal::stopping() {
        return Err(runs::stopped(&args.out));
    }
    runs::part_is_done(&args.out);
    Ok(())
}

/// One run is done.
fn told(row: &Row) {
    let (name, score, seed) = (&row.sequence, &row.score, row.seed.unwrap_or_default());
    note!(
        "{name} (seed {seed}): AUC {:.3}, P@20 {:.3}, failure in {} of {}",
        score.auc,
        score.p20,
        score.failures,
        counted(score.frames, "frame")
    );
}

/// Keeps what the tracker's own probability of being lost is worth, and prints it. Answers its chart, SVG text.
fn trusted(args: &Args, score: &ConfidenceScore) -> Result<String> {
    let (out, text) = (&args.out, confidence::text(score));
    let json = serde_json::to_string_pretty(score).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write_inside(out.join("confidence.txt"), text.as_bytes())?;
    files::write_inside(out.join("confidence.json"), json.as_bytes())?;
    let chart = confidence_plot::plot(&[("foveate", score)]);
    files::write_inside(out.join("reliability.svg"), chart.as_bytes())?;
    if !args.json {
        say!("\nWhat it says about being lost (IoU below 0.1, or out of sight):\n{text}");
        say!("{}: confidence.txt, confidence.json, reliability.svg, report.html", out.display());
    }
    Ok(chart)
}

/// Trackers side by side, by sequence and by attribute: kept and printed, with what comes before it. Answers the part by
/// attribute as HTML.
fn compare(
    args: &Args,
    sequences: &[Sequence],
    evaluations: &[Evaluation],
    record: &Record,
    before: &str,
) -> Result<String> {
    let groups = by_attribute::groups(sequences, evaluations);
    let text = [table::text(evaluations), by_attribute::text(&groups, evaluations)].join("\n");
    let mut scores = table::json(evaluations);
    for (key, value) in by_attribute::json(sequences, &groups, evaluations) {
        scores[key] = value;
    }
    scores["run"] = record.json();
    draw(&args.out, evaluations)?;
    let cross = if before.is_empty() { "" } else { ", cross.txt, cross.json, candidates/" };
    report(args, before, text.trim_end(), &scores, &format!("table.txt, scores.json, curves.svg{cross}"))?;
    Ok(by_attribute::html(&groups, evaluations))
}

/// Scores tracks of many targets.
fn many(args: &Args) -> Result<()> {
    let sequences = mot::find_sequences(&args.truth)?;
    let scored = args.results.iter().map(|place| mot::score_results(&sequences, place));
    let evaluations: Vec<_> = scored.collect::<Result<_>>()?;
    let results = begin(args, vec![])?;
    let (text, mut scores) = (mot::table::text(&evaluations), mot::table::json(&evaluations));
    scores["run"] = Record::of(args.scored(), sequences.iter().map(Data::of_many).collect::<Result<_>>()?)?.json();
    report(args, "", text.trim_end(), &scores, "table.txt, scores.json")?;
    results.finish()
}

/// Keeps the scores, and prints them behind what comes before.
fn report(args: &Args, before: &str, text: &str, scores: &serde_json::Value, kept: &str) -> Result<()> {
    let scores = serde_json::to_string_pretty(scores).map_err(|e| Error::Invalid(e.to_string()))?;
    let out = &args.out;
    files::write_inside(out.join("table.txt"), format!("{text}\n").as_bytes())?;
    files::write_inside(out.join("scores.json"), scores.as_bytes())?;
    if args.json {
        say!("{scores}");
    } else {
        say!("{before}{text}\n\n{}: {kept}", out.display());
    }
    Ok(())
}

fn draw(out: &Path, evaluations: &[Evaluation]) -> Result<()> {
    let drawn: Vec<_> = evaluations.iter().map(Evaluation::drawn).collect();
    files::write_inside(out.join("curves.svg"), curves::plot(&drawn).as_bytes())
}
