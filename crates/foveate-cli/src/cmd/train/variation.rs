//! Implements `foveate train variation`: how features of targets vary along tracks with ground truth.

use std::path::PathBuf;

use foveate::identity::retina::Foveal;
use foveate::lab::eval::{find_sequences, of_half};
use foveate::lab::training::variation::covariance;
use foveate::{Error, Result, files};

use crate::cmd::configure::{self, Changes};
use crate::cmd::results::{spare, writable};

/// Estimate how features of a target vary along its track, from sequences with ground truth.
///
/// Write the covariance of the oriented encoder's features (gradients, grey, colour) in the true boxes about their mean over each track,
/// for `[variation] covariance = "FILE"` of a configuration: features with high variance carry less information on the target's position.
/// The same sequences give the same file.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Sequences in OTB layout, or folders of sequences
    #[arg(long, value_name = "DIR", num_args = 1.., required = true)]
    seqs: Vec<PathBuf>,
    /// Use only the sequences of one half (as in foveate eval --choose), to test on the other
    #[arg(long, value_parser = ["a", "b"])]
    half: Option<String>,
    /// Take the retina from this configuration: a file, or the name of a shipped configuration
    #[arg(long, value_name = "FILE|NAME", default_value = "natural")]
    config: String,
    #[command(flatten)]
    changes: Changes,
    /// Use every N-th frame of a sequence
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=1000))]
    every: u64,
    /// Output file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<()> {
    writable(&args.out)?;
    spare(&args.out, &[args.config.as_ref()])?;
    let (config, _) = configure::read(&args.config, &args.changes)?;
    let Some(foveate::config::RetinaConfig::Foveal(retina)) = config.retina else {
        return Err(Error::Config(format!("{}: it has no [retina]; the oriented encoder needs one", args.config)));
    };
    let sequences = of_half(find_sequences(&args.seqs)?, args.half.as_deref())?;
    let every = usize::try_from(args.every).expect("at most 1000");
    let learned = covariance(&sequences, &Foveal::new(retina)?, every)?;
    let command = format!("foveate {}", crate::invocation::arguments());
    files::write(&args.out, learned.covariance.to_json(&command, &learned.sha256).as_bytes())?;
    say!("sequences: {}, of each every frame in {every}\nwrote {}", learned.tracks, args.out.display());
    Ok(())
}
