//! `foveate experiment partial`: the paper's partial-information experiment (section 6.2, table 3).

use clap::ValueEnum;
use foveate::Result;
use foveate::scene::synthetic::{Corruption, Occlusion, Synthetic};

use super::{Common, Scenes, Settings, compare};

/// What the paper prints, below the table.
const PEERS: &str = "\
The paper (its own videos, whose number and length are not printed), mean px: Bayesian optimisation 5.76, Hedge with all
looks 3.00, EXP3 32.39.";

/// A digit on black that passes behind bars, under noise: policies of partial information beside the others.
///
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
pub struct Args {
    /// Share of the pixels hit by noise, in every frame
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, value_parser = share)]
    noise: f64,
    /// What becomes of the pixels that are hit
    #[arg(long, value_enum, default_value_t = Hit::Replaced)]
    hit: Hit,
    /// Number of bars across the path
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=100))]
    bars: u8,
    /// Side of the target in pixels: beyond 28 the digit is enlarged, and so is the canvas
    #[arg(long, value_name = "PX", default_value_t = 28, value_parser = clap::value_parser!(u16).range(28..=280))]
    side: u16,
    /// Side of a black square that hides the target's middle from frame 2 on, in 28ths of its side
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=28))]
    patch: u8,
    #[command(flatten)]
    common: Common,
}

#[derive(ValueEnum, Clone, Copy)]
enum Hit {
    /// Black or white take their place
    Replaced,
    /// They become 255 less what they were
    Inverted,
}

fn share(text: &str) -> std::result::Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| format!("expected a share from 0 to 1, got {text}"))
}

pub fn run(args: Args) -> Result<()> {
    let (frames, side) = (args.common.videos.frames(), usize::from(args.side));
    let settings = Occlusion {
        frames,
        side,
        width: 200 + 2 * (side - 28),
        height: 200 + 2 * (side - 28),
        bars: usize::from(args.bars),
        patch: usize::from(args.patch),
        noise: args.noise,
        corruption: match args.hit {
            Hit::Replaced => Corruption::Replaced,
            Hit::Inverted => Corruption::Inverted,
        },
        ..Occlusion::default()
    };
    let each: Settings =
        Box::new(move |digit, seed| Synthetic::Occlusion(Occlusion { digit, seed, ..settings.clone() }));
    let scenes = Scenes {
        name: "partial",
        title: "A digit behind bars, under noise".into(),
        peers: PEERS,
        kinds: vec![(args.noise, each)],
    };
    compare(&args.common, &["digits-partial", "printed", "authors"], &scenes)
}
