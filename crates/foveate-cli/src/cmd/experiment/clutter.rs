//! `foveate experiment clutter`: the paper's first experiment (section 6.1, table 1).

use clap::ValueEnum;
use foveate::Result;
use foveate::eval::experiment::CLUTTER_PEERS;
use foveate::scene::synthetic::{Clutter, NOISE, Synthetic};

use super::{Common, Scenes, Settings, compare};

/// A digit among static ones: every configuration and policy beside the fixed centre, on the same videos.
///
/// Configurations are digits and its variants, and authors, unless told otherwise. Finished runs are kept in DIR/runs:
/// the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
pub struct Args {
    /// Without salt and pepper, with it (density 0.3), or both
    #[arg(long, value_enum, default_value_t = Noise::Both)]
    noise: Noise,
    #[command(flatten)]
    common: Common,
}

#[derive(ValueEnum, Clone, Copy)]
pub enum Noise {
    Clean,
    Noisy,
    Both,
}

impl Noise {
    pub fn densities(self) -> &'static [f64] {
        match self {
            Self::Clean => &[0.0],
            Self::Noisy => &[NOISE],
            Self::Both => &[0.0, NOISE],
        }
    }
}

pub fn run(args: Args) -> Result<()> {
    let frames = args.common.videos.frames();
    let kind = |&noise: &f64| -> (f64, Settings) {
        let settings =
            move |digit, seed| Synthetic::Clutter(Clutter { digit, seed, noise, frames, ..Clutter::default() });
        (noise, Box::new(settings))
    };
    let scenes = Scenes {
        name: "clutter",
        title: "A digit among static ones".into(),
        peers: CLUTTER_PEERS,
        kinds: args.noise.densities().iter().map(kind).collect(),
    };
    compare(&args.common, &["digits", "digits-hedge", "digits-rbm", "authors"], &scenes)
}
