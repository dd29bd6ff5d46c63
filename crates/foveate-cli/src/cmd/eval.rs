//! Implements `foveate eval`: scores trackers on sequences with ground truth, for one target (one-pass evaluation, as OTB does it) or many.

mod choose;
mod grid;
pub(crate) mod kept;
mod one_pass;
pub(crate) mod record;

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use foveate::config::{Blueprint, Config};
use foveate::files::Folder;
use foveate::lab::eval::catalogue::Half;
use foveate::lab::eval::confidence::{ConfidenceScore, Judged};
use foveate::lab::eval::{
    Case, Evaluation, Row, Sequence, by_attribute, cases, confidence, confidence_cross, confidence_plot, curves,
    find_sequences, mot, of_half, run_all, score_folder, table, track_files,
};
use foveate::text::{counted, visible};
use foveate::{Error, Result, files};

use self::record::{Data, Record, Settings};
use super::configure::{Changes, OTHER, Profile, config_name, read};
use super::results::InPlace;
use crate::runs::{self, Entry, Store};
use crate::terminal;

/// Score trackers on sequences with ground truth (one-pass evaluation, as OTB does it).
///
/// Without --results, run foveate on every sequence from the true box of frame 1 and score the tracks. Also score the loss detection:
/// calibration, false alarms, frames until a loss is detected, coverage of credible regions.
///
/// Compare foveate with every peer by attribute of the sequences (occlusion, fast motion, ...), by half and by kind of target. With
/// --choose, choose settings on one half of the sequences and test them on the other, both ways. In --config and --set, {other} stands for
/// the letter of the other half: --set box_regression.weights=boxes-{other}.json evaluates each half with the file trained on the other. A
/// file halves.txt beside the sequences lists half (a or b), name, kind and source video of each.
///
/// With --mot, score tracks of many targets: MOTA, IDF1, HOTA and their components, as TrackEval computes them: foveate eval --mot --truth
/// DIR --results DIR
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Sequences in the layout of OTB (groundtruth_rect.txt, img/ or video.mp4), VOT, GOT-10k or LaSOT (groundtruth.txt), or folders of sequences
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "mot")]
    pub seqs: Vec<PathBuf>,
    /// Use only the sequences of one half
    #[arg(long, value_parser = ["a", "b"], conflicts_with = "mot")]
    pub half: Option<String>,
    /// Score tracks of many targets in MOTChallenge's text format (frame,id,x,y,w,h,conf,...)
    #[arg(long, requires_all = ["truth", "results"], conflicts_with_all = ["seqs", "config", "policy", "set", "seed", "seeds"])]
    pub mot: bool,
    /// With --mot: sequences (gt/gt.txt, seqinfo.ini), folders of sequences, or files of true tracks. Rows with conf 0 do not count;
    /// classes are ignored
    #[arg(long, value_name = "DIR|FILE", num_args = 1.., requires = "mot")]
    pub truth: Vec<PathBuf>,
    /// Score these results instead of running foveate: a folder for each tracker, or a folder of such folders. Each has SEQUENCE.txt
    /// (x,y,w,h per frame, counted from 1) and, for frames per second, SEQUENCE_time.txt (seconds per frame), either directly or in seed-1,
    /// seed-2 ... The first tracker's curves are drawn thickest. With --mot: SEQUENCE.txt, data/SEQUENCE.txt or SEQUENCE/tracks.txt, or one
    /// file if there is one sequence
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["policy", "set"])]
    pub results: Vec<PathBuf>,
    /// Results of other trackers to compare with foveate's in the table and the curves: folders as for --results
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["results", "mot"])]
    pub peers: Vec<PathBuf>,
    /// Tracker to run: a configuration file, or the name of a shipped configuration (natural, digits, ...); default: natural
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "results")]
    pub config: Option<String>,
    /// Trade-off between speed and accuracy, if no configuration is given
    #[arg(long, value_enum, conflicts_with_all = ["config", "results", "mot"])]
    pub profile: Option<Profile>,
    #[command(flatten)]
    pub changes: Changes,
    /// Choose among values of a setting by mean AUC: choose on one half of the sequences and test on the other, both ways; also leave one
    /// source video out. Example: colour.mixing_weight=0.1,0.2. Repeat the option to try all combinations. Resumes after an interruption
    #[arg(long, value_name = "KEY=VALUE,...", conflicts_with_all = ["results", "mot"])]
    pub choose: Vec<String>,
    /// First random seed of the tracker
    #[arg(long, default_value_t = 1, conflicts_with = "results")]
    pub seed: u64,
    /// Number of seeds, counting up from --seed; the mean and the spread over seeds are reported
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000), conflicts_with = "results")]
    pub seeds: u64,
    /// Run sequences in parallel, each in one thread, instead of one after another in all threads. The boxes stay the same, but frames per
    /// second are those of a busy machine. Always on with --choose, --shard and --merge
    #[arg(long, conflicts_with_all = ["results", "mot"])]
    pub side_by_side: bool,
    /// Do only shard I of N of the runs and compute no scores, to distribute the runs over several machines; combine their folders with
    /// --merge. A run is one sequence with one seed (and one candidate of --choose) in one thread, stored in runs/ of --out
    #[arg(long, value_name = "I/N", value_parser = runs::parse_shard, conflicts_with_all = ["results", "mot"])]
    pub shard: Option<(u32, u32)>,
    /// Take finished runs from these other --out folders (or from this one), and do the missing runs. Repeatable
    #[arg(long, value_name = "DIR", conflicts_with_all = ["results", "mot"])]
    pub merge: Vec<PathBuf>,
    /// Output folder for table.txt, scores.json and curves.svg (not with --mot). If the tracker is run: also the tracks in foveate/,
    /// confidence.txt, confidence.json, reliability.svg, and report.html with pictures of the first seed's successes and failures. With
    /// --choose: cross.txt, cross.json, the tracks of each candidate in candidates/, and table.txt, scores.json, curves.svg of the
    /// cross-validated tracks. run.json lists the files; the files of an earlier evaluation are removed
    #[arg(long, value_name = "DIR", default_value = "out-eval")]
    pub out: PathBuf,
    /// Print scores as JSON instead of the table
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Returns the folders and files of results to score.
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
    let by_half = args.changes.set.iter().map(String::as_str).chain([name]).any(|text| text.contains(OTHER));
    let halves = if by_half { &Half::BOTH[..] } else { &Half::BOTH[..1] };
    let configs =
        halves.iter().map(|half| read(&name.replace(OTHER, half.other().name()), &args.changes.for_half(*half)));
    let configs: Vec<(Config, Folder)> = configs.collect::<Result<_>>()?;
    let blueprints: Vec<Blueprint> =
        configs.iter().map(|(config, folder)| config.clone().check(folder)).collect::<Result<_>>()?;
    let task = Task::of(&args)?;
    if !args.results.is_empty() {
        // Results of other trackers have no status or P(lost).
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
        false if by_half => {
            return Err(Error::Invalid(format!(
                "--choose chooses for both halves and takes no {OTHER}; leave one out"
            )));
        }
        false => Some(choose::Plan::of(&configs[0].0, &configs[0].1, &args.choose, &task.sequences)?),
    };
    let data: Vec<Data> = task.sequences.iter().map(Data::with_pictures).collect::<Result<_>>()?;
    let program = record::program()?;
    let entries: Vec<Entry> = blueprints.into_iter().map(|it| Entry::of(it, &program)).collect::<Result<_>>()?;
    Settings::of(&entries)?.claim(&store.folder, &store.others)?;
    let record = Record::of(args.scored(), data.clone())?.running(&entries, &described, &task.seeds, &args.choose);
    match plan {
        Some(plan) => task.choose(&args, &plan, &data, &store, &record),
        None => task.track(&args, &kept::Runs::new(entries, &task.sequences, &data, &store), &record),
    }
}

/// The evaluation's inputs: sequences, other trackers' results on them, and the seeds for foveate.
struct Task {
    sequences: Vec<Sequence>,
    others: Vec<Evaluation>,
    seeds: Vec<u64>,
}

impl Task {
    fn of(args: &Args) -> Result<Self> {
        let sequences = of_half(find_sequences(&args.seqs)?, args.half.as_deref())?;
        let score = |folder: &PathBuf| score_folder(&sequences, folder);
        let others: Vec<Vec<Evaluation>> = args.results.iter().chain(&args.peers).map(score).collect::<Result<_>>()?;
        let seeds = (0..args.seeds).map(|i| args.seed.wrapping_add(i)).collect();
        Ok(Self { sequences, others: others.concat(), seeds })
    }

    /// Returns our evaluation followed by those of the other trackers.
    fn beside(&self, ours: Evaluation) -> Vec<Evaluation> {
        std::iter::once(ours).chain(self.others.iter().cloned()).collect()
    }

    /// Chooses settings on one half of the sequences and tests them on the other.
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

    /// Runs the tracker, scores it beside the others, and scores its loss detection.
    fn track(&self, args: &Args, kept: &kept::Runs<'_>, record: &Record) -> Result<()> {
        let Self { sequences, others, seeds } = self;
        // With parts, runs are made in parallel; otherwise one after another, so that each time is that of a single tracker.
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
        let ours = run_all("foveate", sequences, seeds, Some(&out), &run_tracker, &mut print_row)?;
        let all = self.beside(ours);
        let groups = compare(args, sequences, &all, record, "")?;
        let curves = curves::panels(&all.iter().map(Evaluation::drawn).collect::<Vec<_>>());
        let runs = runs.into_inner();
        let first: Vec<Case> = runs.iter().filter(|run| run.seed == args.seed).cloned().collect();
        let score = |such: &dyn Fn(&Case) -> bool| {
            let tracks: Vec<&[Judged]> = runs.iter().filter(|run| such(run)).map(|run| run.judged.as_slice()).collect();
            ConfidenceScore::of(&tracks)
        };
        // The mean of kinds is no mean over frames.
        let grouped = by_attribute::groups(sequences, &all[..1]).into_iter().filter(|g| g.name != by_attribute::KINDS);
        let grouped = grouped.map(|g| (g.name, score(&|run| g.sequences.contains(&run.sequence.name))));
        let reliability = trusted(args, &score(&|_| true), &grouped.collect::<Vec<_>>())?;
        let [success, precision] = curves;
        let charts = [success, precision, ("Reliability of P(lost)", reliability)];
        let page = cases::page(&first, others, &charts, &groups, &record.html())?;
        files::write_inside(args.out.join("report.html"), page.as_bytes())?;
        results.finish()?;
        // The next evaluation starts from the beginning; parts are kept for merging.
        if in_parts { Ok(()) } else { kept.forget(seeds) }
    }
}

/// Starts the results; `more` names files that only some evaluations write.
fn begin(args: &Args, more: Vec<String>) -> Result<InPlace> {
    let names = ["table.txt", "scores.json", "curves.svg"].map(str::to_owned);
    let read = [&args.results, &args.peers, &args.seqs, &args.truth, &args.merge].into_iter().flatten();
    let read = read.map(PathBuf::as_path).chain(args.config.as_deref().map(Path::new));
    InPlace::begin(&args.out, [&names[..], &more].concat(), &read.collect::<Vec<_>>())
}

/// Reports that only a part of the runs was done, or that the run was stopped.
fn undone(args: &Args) -> Result<()> {
    if terminal::stopping() {
        return Err(runs::stopped(&args.out));
    }
    runs::part_is_done(&args.out);
    Ok(())
}

/// Prints one finished run.
fn print_row(row: &Row) {
    let (name, score, seed) = (visible(&row.sequence), &row.score, row.seed.unwrap_or_default());
    note!(
        "{name} (seed {seed}): AUC {:.3}, P@20 {:.3}, failure in {} of {}",
        score.auc,
        score.p20,
        score.failures,
        counted(score.frames, "frame")
    );
}

/// Writes and prints the scores of the tracker's P(lost), over all tracks and by group of sequences. Returns the chart as SVG text.
fn trusted(args: &Args, score: &ConfidenceScore, groups: &[(String, ConfidenceScore)]) -> Result<String> {
    let out = &args.out;
    let text = format!("{}\n{}", confidence::text(score), confidence_cross::text("attribute", groups));
    let json = serde_json::to_string_pretty(score).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write_inside(out.join("confidence.txt"), text.as_bytes())?;
    files::write_inside(out.join("confidence.json"), json.as_bytes())?;
    let chart = confidence_plot::plot(&[("foveate", score)]);
    files::write_inside(out.join("reliability.svg"), chart.as_bytes())?;
    if !args.json {
        say!("\nP(lost) against the truth (lost: IoU below 0.1, or out of sight):\n{text}");
        say!("{}: confidence.txt, confidence.json, reliability.svg, report.html", out.display());
    }
    Ok(chart)
}

/// Writes and prints the comparison of trackers by sequence and by attribute, after the text that precedes it. Returns the part by
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

/// Writes the scores and prints them after `before`.
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
