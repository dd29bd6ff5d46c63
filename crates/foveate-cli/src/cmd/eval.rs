//! `foveate eval`: scores trackers on sequences with truth (one-pass evaluation, as OTB does it).

use std::path::{Path, PathBuf};

use foveate::eval::{Evaluation, Row, Sequence, TrackRun, curves, find_sequences, run_all, score_folder, table};
use foveate::observe::{Clock, Observer};
use foveate::run::{Follow, follow};
use foveate::scene::open;
use foveate::{Error, Result, files};

/// Scores trackers on sequences whose true boxes are known (one-pass evaluation, as OTB does it).
///
/// Without --results, foveate itself is run on every sequence, from the true box of frame 1, and scored.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Sequences in OTB layout (groundtruth_rect.txt, img/), or folders that hold them
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    pub seqs: Vec<PathBuf>,
    /// Score these results instead: one folder for each tracker, with SEQUENCE.txt (x,y,w,h a frame, counted from 1) and,
    /// for frames per second, SEQUENCE_time.txt (seconds a frame)
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub results: Vec<PathBuf>,
    /// The tracker to run: a configuration file, or the name of one that ships with the program (natural, digits, ...); natural if left out
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "results")]
    pub config: Option<String>,
    /// First seed of the tracker to run
    #[arg(long, default_value_t = 1, conflicts_with = "results")]
    pub seed: u64,
    /// Number of seeds to run, counting up from --seed; mean and spread over them are reported
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000), conflicts_with = "results")]
    pub seeds: u64,
    /// Folder for table.txt, scores.json, curves.svg, and the tracks in foveate/ where the tracker is run
    #[arg(long, value_name = "DIR", default_value = "out-eval")]
    pub out: PathBuf,
    /// Print scores as JSON instead of the table
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let blueprint = super::track::blueprint(args.config.as_deref().unwrap_or("natural"))?;
    evaluate(&args, &|sequence, seed| {
        let mut tracker = blueprint.tracker(seed, 0)?;
        let plan = Follow {
            init: Some(sequence.init()?),
            again: &[],
            from: 0,
            until: sequence.truth.len() - 1,
            stop: &|| false,
            clock: Clock::default(),
            progress: &mut |_| {},
        };
        let nobody: &mut Vec<Box<dyn Observer>> = &mut vec![];
        let (outcome, result) = follow(&mut *open(&sequence.images)?, &mut tracker, nobody, plan);
        result.map(|()| TrackRun { boxes: outcome.boxes, seconds: outcome.seconds })
    })
}

/// Scores; `run_tracker` follows one sequence with one seed.
fn evaluate(args: &Args, run_tracker: &dyn Fn(&Sequence, u64) -> Result<TrackRun>) -> Result<()> {
    let sequences = find_sequences(&args.seqs)?;
    let evaluations = if args.results.is_empty() {
        let seeds: Vec<u64> = (0..args.seeds).map(|i| args.seed.wrapping_add(i)).collect();
        let mut told = |row: &Row| {
            let (name, score) = (&row.sequence, &row.score);
            let seed = row.seed.unwrap_or_default();
            eprintln!(
                "{name} (seed {seed}): AUC {:.3}, P@20 {:.3}, {} lost of {}",
                score.auc, score.p20, score.lost, score.frames
            );
        };
        vec![run_all("foveate", &sequences, &seeds, Some(&args.out.join("foveate")), run_tracker, &mut told)?]
    } else {
        args.results.iter().map(|folder| score_folder(&sequences, folder)).collect::<Result<_>>()?
    };
    let scores = serde_json::to_string_pretty(&table::json(&evaluations)).map_err(|e| Error::Invalid(e.to_string()))?;
    let text = table::text(&evaluations);
    save(&args.out, &evaluations, &text, &scores)?;
    if args.json {
        println!("{scores}");
    } else {
        println!("{text}\n{}: table.txt, scores.json, curves.svg", args.out.display());
    }
    Ok(())
}

fn save(out: &Path, evaluations: &[Evaluation], text: &str, scores: &str) -> Result<()> {
    std::fs::create_dir_all(out).map_err(Error::io(out, "cannot create"))?;
    let means: Vec<_> = evaluations.iter().map(|e| (e.tracker.as_str(), e.curves())).collect();
    let named: Vec<_> = means.iter().map(|(name, curves)| (*name, curves)).collect();
    files::write(out.join("table.txt"), text.as_bytes())?;
    files::write(out.join("scores.json"), scores.as_bytes())?;
    files::write(out.join("curves.svg"), curves::plot(&named).as_bytes())
}
