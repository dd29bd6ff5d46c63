//! `foveate train confidence`: fits P(lost) on tracks with truth, and says how well it is calibrated on what it has not seen.

use std::path::PathBuf;

use clap::ValueEnum;
use foveate::control::{CUE_NAMES, Confidence};
use foveate::eval::trust::{self, Judged, TrustScore};
use foveate::eval::trust_fit::{Judgement, fit, follow, leave_one_out};
use foveate::eval::{find_sequences, trust_plot};
use foveate::scene::hide::{Hide, WAYS, Way};
use foveate::scene::synthetic::{Clutter, NOISE, Occlusion, Synthetic};
use foveate::scene::{Digits, Split};
use foveate::{Error, Result, files};
use serde::Serialize;

use super::super::track::blueprint;
use super::super::videos::{Video, of_scene, of_sequence};
use crate::terminal;

/// Fit the probability of being lost, on sequences or drawn scenes with truth.
///
/// The tracker runs on each video as it is, and with its target made to vanish and come back (`--hidden` times each way).
/// Printed are the figures of the table in force, and those of tables that have not seen the video they are judged on
/// (leave one video out). The new table, fitted on all, is written as the section `[confidence]` of a configuration, to be
/// put there in place of the old one.
#[derive(clap::Args)]
pub struct Args {
    /// The tracker: a configuration file, or the name of one that ships with the program
    #[arg(long, value_name = "FILE|NAME", default_value = "natural")]
    config: String,
    /// Sequences in OTB layout, or folders that hold them
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "scene")]
    seqs: Vec<PathBuf>,
    /// Each sequence from its end to its beginning, too: the same target with another first frame
    #[arg(long, conflicts_with = "scene")]
    backwards: bool,
    /// Drawn scenes instead: ten digits, 300 frames, 30 % noise
    #[arg(long, value_enum, conflicts_with = "seqs")]
    scene: Option<SceneName>,
    /// Side of the digit in the partial scene, pixels
    #[arg(long, default_value_t = 28)]
    side: usize,
    /// Folder with MNIST's test files, for scenes; without it the digits are drawn by a pen
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Seeds of the tracker, counting up from --seed
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// The first seed
    #[arg(long, default_value_t = 101)]
    seed: u64,
    /// Clips with a hidden target for each video, seed and way
    #[arg(long, value_name = "N", default_value_t = 1)]
    hidden: u64,
    /// The section to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the cues of every frame as CSV
    #[arg(long, value_name = "FILE")]
    cues: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum SceneName {
    /// A digit among static ones
    Clutter,
    /// A digit on black that passes behind bars
    Partial,
}

#[derive(Serialize)]
struct Section<'a> {
    confidence: &'a Confidence,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    terminal::catch_interrupts();
    let blueprint = blueprint(&args.config)?;
    let mut tracks: Vec<Judgement> = vec![];
    let digits = match &args.data {
        Some(dir) => Digits::load(dir, Split::Test)?,
        None => Digits::drawn(1, 20),
    };
    let mut each = |video: &Video<'_>, ways: &[Way]| -> Result<()> {
        for seed in (0..args.seeds).map(|i| args.seed.wrapping_add(i)) {
            let clips = ways.iter().flat_map(|way| (0..args.hidden).map(move |k| (*way, seed.wrapping_mul(1000) + k)));
            // Videos too short to hide anything in are tracked as they are.
            let hidden =
                clips.filter_map(|(way, seed)| Hide::choose(way, &video.truth, video.size, (30, 90), seed).ok());
            for hide in std::iter::once(None).chain(hidden.map(Some)) {
                if terminal::stopping() {
                    return Err(Error::Invalid("stopped; nothing was written".into()));
                }
                let frames = follow(
                    &video.truth,
                    video.truth.len(),
                    hide.as_ref(),
                    &*video.picture,
                    (&mut blueprint.scout(), &mut blueprint.tracker(seed, 0)?),
                )?;
                tracks.push(Judgement { video: video.name.clone(), hidden: hide.is_some(), frames });
            }
        }
        Ok(())
    };
    match args.scene {
        None => {
            let sequences = find_sequences(&args.seqs)?;
            let bar = terminal::progress(Some(sequences.len()), "confidence");
            for sequence in &sequences {
                let video = of_sequence(sequence)?;
                each(&video, &WAYS)?;
                if args.backwards {
                    each(&video.backwards(), &WAYS)?;
                }
                bar.inc(1);
            }
            bar.finish_and_clear();
        }
        // The camera of the scenes stands still.
        Some(name) => {
            let bar = terminal::progress(Some(10), "confidence");
            for digit in 0..10 {
                let scene = match name {
                    SceneName::Clutter => {
                        Synthetic::Clutter(Clutter { digit, seed: args.seed, noise: NOISE, ..Clutter::default() })
                    }
                    SceneName::Partial => {
                        let side = args.side;
                        Synthetic::Occlusion(Occlusion { digit, side, seed: args.seed, ..Occlusion::default() })
                    }
                };
                each(&of_scene(&scene, &digits)?, &[Way::Behind])?;
                bar.inc(1);
            }
            bar.finish_and_clear();
        }
    }
    let confidence = &blueprint.config().confidence;
    let slices = |tracks: &[Vec<Judged>]| TrustScore::of(&tracks.iter().map(Vec::as_slice).collect::<Vec<_>>(), 0.0);
    let now: Vec<Vec<Judged>> = tracks.iter().map(|t| t.frames.clone()).collect();
    say!("The table in force:\n{}", trust::text(&slices(&now)));
    if let Some(path) = &args.cues {
        files::write(path, csv(&tracks).as_bytes())?;
    }
    let unseen: Vec<Vec<Judged>> = leave_one_out(&tracks, confidence)?.into_iter().map(|(track, _)| track).collect();
    say!("New tables, each on the video it has not seen (boxes and searches are those of the table in force):");
    say!("{}", trust::text(&slices(&unseen)));
    let (plain, hidden): (Vec<usize>, Vec<usize>) = (0..tracks.len()).partition(|i| !tracks[*i].hidden);
    for (name, such) in [("as they are", plain), ("with their targets hidden", hidden)] {
        let of: Vec<Vec<Judged>> = such.iter().map(|i| unseen[*i].clone()).collect();
        say!("Of these, videos {name}:\n{}", trust::text(&slices(&of)));
    }
    let table = fit(&tracks.iter().collect::<Vec<_>>(), confidence)?;
    let text = toml::to_string(&Section { confidence: &table }).map_err(|e| Error::Invalid(e.to_string()))?;
    let command: Vec<String> = std::env::args().skip(1).collect();
    files::write(&args.out, format!("# foveate {}\n{text}", command.join(" ")).as_bytes())?;
    let plot = args.out.with_extension("svg");
    let scores = [("in force", slices(&now)), ("new, on unseen videos", slices(&unseen))];
    files::write(&plot, trust_plot::plot(&scores.each_ref().map(|(name, score)| (*name, score))).as_bytes())?;
    say!("{text}\nwrote {} and {}", args.out.display(), plot.display());
    Ok(())
}

fn csv(tracks: &[Judgement]) -> String {
    let mut text = format!("track,video,hidden,visible,p_lost,out,iou,{}\n", CUE_NAMES.join(","));
    for (i, track) in tracks.iter().enumerate() {
        for j in &track.frames {
            let [hidden, visible, out] = [track.hidden, j.off.is_some(), j.standing.is_out()].map(u8::from);
            text += &format!("{i},{},{hidden},{visible},{},{out},{}", track.video, j.p_lost, j.iou);
            j.cues.iter().for_each(|c| text += &format!(",{c}"));
            text.push('\n');
        }
    }
    text
}
