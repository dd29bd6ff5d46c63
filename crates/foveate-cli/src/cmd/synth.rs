//! `foveate synth`: makes videos with known truth.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};
use foveate::scene::otb::write_otb;
use foveate::scene::synthetic::{Clutter, Ink, NOISE};
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
}

#[derive(clap::Args, Debug)]
struct ClutterArgs {
    /// The digit that moves
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: u8,
    /// Same seed, same video
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Folder to make: img/0001.png ..., groundtruth_rect.txt (x,y,w,h, 1-based), label.txt, scene.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Hit 30 % of the black pixels with salt and pepper (half of the hits stay black), anew in every frame
    #[arg(long)]
    noise: bool,
    /// Length of the video
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Number of static digits, taken from the nine other classes in turn
    #[arg(long, value_name = "N", default_value_t = 18)]
    distractors: usize,
    /// How digits cover what lies below them
    #[arg(long, value_enum, default_value_t = InkArg::Replace)]
    ink: InkArg,
    /// Draw the target between pixels instead of at whole ones
    #[arg(long)]
    subpixel: bool,
    /// Folder with MNIST's test files (t10k-*, plain or .gz); without it the digits are drawn by a pen
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
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
    let Kind::Clutter(args) = args.kind;
    let settings = Clutter {
        digit: args.digit,
        seed: args.seed,
        frames: args.frames,
        noise: if args.noise { NOISE } else { 0.0 },
        distractors: args.distractors,
        ink: match args.ink {
            InkArg::Replace => Ink::Replace,
            InkArg::Brighter => Ink::Brighter,
            InkArg::Opaque => Ink::Opaque,
        },
        subpixel: args.subpixel,
        ..Clutter::default()
    };
    let (digits, from) = match &args.data {
        Some(dir) => (Digits::load(dir, Split::Test)?, "MNIST test digits"),
        None => (Digits::drawn(args.seed, DRAWN), "drawn digits"),
    };
    let video = settings.video(&digits)?;
    let scene = toml::to_string(&settings).map_err(|e| Error::Invalid(e.to_string()))?;
    let notes = [("label.txt", format!("{}\n", video.label())), ("scene.toml", format!("# {from}\n{scene}"))];
    write_otb(&args.out, video.clone().source(), video.truth(), &notes)?;
    println!("{}: {} frames of digit {} ({from})", args.out.display(), video.len(), video.label());
    Ok(())
}
