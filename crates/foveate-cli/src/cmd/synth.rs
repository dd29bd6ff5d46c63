//! `foveate synth`: makes videos with known truth.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};
use foveate::scene::otb::write_otb;
use foveate::scene::synthetic::{Clutter, Corruption, Drawn, Ink, NOISE, Occlusion, Synthetic};
use foveate::scene::{Digits, Split};
use foveate::{Error, Result};

/// Digits drawn of each class where there is no MNIST.
const DRAWN: usize = 20;

/// Makes videos with known truth, as folders in OTB layout.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    kind: Kind,
}

#[derive(Subcommand, Debug)]
enum Kind {
    /// One digit moves among static ones (the paper's first experiment)
    Clutter(ClutterArgs),
    /// One digit on black passes behind bars, under noise (the paper's partial-information experiment)
    Partial(PartialArgs),
}

/// What all scenes can be told.
#[derive(clap::Args, Debug)]
struct Common {
    /// The digit that moves
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: u8,
    /// Same seed, same video
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Folder to make: img/0001.png ..., groundtruth_rect.txt (x,y,w,h, 1-based), label.txt, scene.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Length of the video
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Folder with MNIST's test files (t10k-*, plain or .gz); without it the digits are drawn by a pen
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

#[derive(clap::Args, Debug)]
struct PartialArgs {
    #[command(flatten)]
    common: Common,
    /// Share of the pixels hit by noise, 0 to 1
    #[arg(long, default_value_t = NOISE)]
    noise: f64,
    /// Invert the pixels that are hit instead of replacing them by black or white
    #[arg(long)]
    inverted: bool,
    /// Number of bars across the path
    #[arg(long, default_value_t = 2)]
    bars: usize,
}

#[derive(clap::Args, Debug)]
struct ClutterArgs {
    #[command(flatten)]
    common: Common,
    /// Hit 30 % of the black pixels with salt and pepper (half of the hits stay black), anew in every frame
    #[arg(long)]
    noise: bool,
    /// Number of static digits, taken from the nine other classes in turn
    #[arg(long, value_name = "N", default_value_t = 18)]
    distractors: usize,
    /// How digits cover what lies below them
    #[arg(long, value_enum, default_value_t = InkArg::Replace)]
    ink: InkArg,
    /// Draw the target between pixels instead of at whole ones
    #[arg(long)]
    subpixel: bool,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum InkArg {
    /// Ink replaces, black is transparent (the authors' way)
    Replace,
    /// The brighter of the two stays
    Brighter,
    /// The whole square of 28 x 28 replaces
    Opaque,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    match args.kind {
        Kind::Clutter(args) => {
            let Common { digit, seed, frames, .. } = args.common;
            let ink = match args.ink {
                InkArg::Replace => Ink::Replace,
                InkArg::Brighter => Ink::Brighter,
                InkArg::Opaque => Ink::Opaque,
            };
            let noise = if args.noise { NOISE } else { 0.0 };
            let (distractors, subpixel) = (args.distractors, args.subpixel);
            let settings = Clutter { digit, seed, frames, noise, distractors, ink, subpixel, ..Clutter::default() };
            make(&args.common, Synthetic::Clutter(settings))
        }
        Kind::Partial(args) => {
            let Common { digit, seed, frames, .. } = args.common;
            let corruption = if args.inverted { Corruption::Inverted } else { Corruption::Replaced };
            let (noise, bars) = (args.noise, args.bars);
            let settings = Occlusion { digit, seed, frames, noise, bars, corruption, ..Occlusion::default() };
            make(&args.common, Synthetic::Occlusion(settings))
        }
    }
}

fn make(args: &Common, settings: Synthetic) -> Result<()> {
    let (digits, from) = match &args.data {
        Some(dir) => (Digits::load(dir, Split::Test)?, "MNIST test digits"),
        None => (Digits::drawn(args.seed, DRAWN), "drawn digits"),
    };
    let video = settings.video(&digits)?;
    let scene = toml::to_string(&settings).map_err(|e| Error::Invalid(e.to_string()))?;
    let notes = [("label.txt", format!("{}\n", video.label())), ("scene.toml", format!("# {from}\n{scene}"))];
    let truth = video.truth().to_vec();
    let (frames, label) = (truth.len(), video.label());
    write_otb(&args.out, video.source(), &truth, &notes)?;
    println!("{}: {frames} frames of digit {label} ({from})", args.out.display());
    Ok(())
}
