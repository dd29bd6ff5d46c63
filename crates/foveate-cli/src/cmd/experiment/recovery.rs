//! `foveate experiment recovery`: targets that vanish from real video and come back.

use std::path::{Path, PathBuf};

use foveate::config::Blueprint;
use foveate::eval::experiment::{digest, fingerprint};
use foveate::eval::recovery::{AFTER, Case, lines, text};
use foveate::eval::trust_fit::follow;
use foveate::eval::{Sequence, find_sequences};
use foveate::scene::hide::{Hide, WAYS};
use foveate::{Error, Result, files};
use serde_json::json;

use super::super::track::blueprint;
use super::super::videos::{Video, of_sequence};
use super::keep;
use crate::terminal;

/// Targets that vanish from real video and come back: how soon they are found, and whether anything else is taken for them.
///
/// From each sequence and seed three clips are cut: the target is covered by what is beside it; the camera looks away and
/// back; it looks away and then to another place. The cut depends on the seed alone. Finished sequences are kept in
/// DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
pub struct Args {
    /// Folder with data: its folder `tracking` holds the sequences [default: $FOVEATE_DATA or data]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Sequences in OTB layout, or folders that hold them, instead
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "data")]
    seqs: Vec<PathBuf>,
    /// The tracker: a configuration file, or the name of one that ships with the program
    #[arg(long, short, value_name = "FILE|NAME", default_value = "natural")]
    config: String,
    /// Clips of each sequence and way
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// The first clip's seed; it names the tracker's randomness, too
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    first_seed: u64,
    /// Fewest and most frames that the target is out of sight
    #[arg(long, value_name = "LEAST,MOST", default_value = "30,90", value_parser = range)]
    hidden: (usize, usize),
    /// Folder for table.txt, table.json and the finished runs
    #[arg(long, short, value_name = "DIR", default_value = "out/recovery")]
    out: PathBuf,
}

pub(in crate::cmd) fn range(text: &str) -> std::result::Result<(usize, usize), String> {
    let parsed = text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    parsed.filter(|(least, most)| (1..=100_000).contains(least) && (least..=&100_000).contains(&most)).ok_or_else(
        || format!("expected two numbers of frames such as 30,90, the first not above the second, got {text}"),
    )
}

pub fn run(args: Args) -> Result<()> {
    let data = args.data.clone().or_else(|| std::env::var_os("FOVEATE_DATA").map(PathBuf::from));
    let folders = match args.seqs.is_empty() {
        true => vec![data.unwrap_or_else(|| PathBuf::from("data")).join("tracking")],
        false => args.seqs.clone(),
    };
    let sequences = find_sequences(&folders)?;
    let blueprint = blueprint(&args.config)?;
    let store = args.out.join("runs");
    std::fs::create_dir_all(&store).map_err(Error::io(&store, "cannot create the folder for finished runs"))?;
    terminal::catch_interrupts();
    let bar = terminal::progress(Some(sequences.len()), "recovery");
    let program = format!("{} {}", fingerprint(&blueprint)?, blueprint.config().to_toml());
    let (mut cases, mut left_out) = (vec![], vec![]);
    for sequence in &sequences {
        let settings = format!("{:?} {} {} {:?}", args.hidden, args.seeds, args.first_seed, sequence.truth);
        let key = digest(&[env!("CARGO_PKG_VERSION").as_bytes(), program.as_bytes(), settings.as_bytes()]);
        let path = store.join(format!("{}-{key}.json", sequence.name));
        let kept = std::fs::read(&path).ok().and_then(|bytes| serde_json::from_slice::<Vec<Case>>(&bytes).ok());
        let found = match kept {
            Some(kept) => kept,
            None => {
                let found = cut(&args, &blueprint, sequence, &of_sequence(sequence)?)?;
                if terminal::stopping() {
                    say!("stopped at {}; the same command goes on from there", sequence.name);
                    std::process::exit(130);
                }
                files::write(&path, &serde_json::to_vec(&found).map_err(|e| Error::Invalid(e.to_string()))?)?;
                found
            }
        };
        if found.is_empty() {
            left_out.push(sequence.name.clone());
        }
        cases.extend(found);
        bar.inc(1);
    }
    bar.finish_and_clear();
    report(&args, &args.out, &cases, &left_out)
}

/// All clips of one sequence; none where it is too short.
fn cut(args: &Args, blueprint: &Blueprint, sequence: &Sequence, video: &Video<'_>) -> Result<Vec<Case>> {
    let mut cases = vec![];
    for seed in (0..args.seeds).map(|i| args.first_seed.wrapping_add(i)) {
        for way in WAYS {
            let Ok(hide) = Hide::choose(way, &video.truth, video.size, args.hidden, seed) else { continue };
            if terminal::stopping() {
                return Ok(cases);
            }
            let parts = (&mut blueprint.scout(), &mut blueprint.tracker(seed, way as u64)?);
            let track = follow(&video.truth, hide.until + AFTER, Some(&hide), &*video.picture, parts)?;
            cases.push(Case::of(&sequence.name, seed, hide, &track));
        }
    }
    Ok(cases)
}

fn report(args: &Args, out: &Path, cases: &[Case], left_out: &[String]) -> Result<()> {
    let last = args.first_seed.wrapping_add(args.seeds - 1);
    let (least, most) = args.hidden;
    let mut shown = format!(
        "Targets out of sight for {least} to {most} frames: {}, seeds {} to {last}\n\n{}",
        args.config,
        args.first_seed,
        text(cases)
    );
    if !left_out.is_empty() {
        shown += &format!("Too short to cut from: {}\n", left_out.join(", "));
    }
    let all = json!({
        "experiment": "recovery", "config": args.config, "hidden": args.hidden, "first_seed": args.first_seed,
        "seeds": args.seeds, "lines": lines(&cases.iter().collect::<Vec<_>>()), "cases": cases, "left_out": left_out,
    });
    keep(out, &shown, &all, false, &[])
}
