//! `foveate bench`: how long things take on this machine.

use clap::{Subcommand, ValueEnum};
use foveate::Result;
use foveate::identity::encoder::Precision;

/// Times the tracker on this machine.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand, Debug)]
enum What {
    /// One frame of the tracker: 640 x 480 pixels, 240 values a glimpse, 500 features, one thread
    Frame(FrameArgs),
}

#[derive(clap::Args, Debug)]
struct FrameArgs {
    /// Number of particles
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    particles: u32,
    /// Frames to time
    #[arg(long, default_value_t = 201, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// How the weights of the features are rounded; bf16 is what the tracker does unless told otherwise
    #[arg(long, value_enum, default_value_t = PrecisionArg::Bf16)]
    precision: PrecisionArg,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum PrecisionArg {
    /// Not at all
    F32,
    /// To 8 significant bits
    Bf16,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let What::Frame(args) = args.what;
    let (precision, name) = match args.precision {
        PrecisionArg::F32 => (Precision::F32, "f32"),
        PrecisionArg::Bf16 => (Precision::Bf16, "bf16"),
    };
    let time = foveate::bench::frame(args.particles as usize, precision, args.frames as usize)?;
    if args.json {
        let line = serde_json::json!({
            "what": "tracker frame", "precision": name, "n": args.particles, "ms": time.median, "best_ms": time.best,
        });
        println!("{line}");
    } else {
        println!(
            "a frame of {} particles ({name}) takes {:.3} ms of CPU, the median of {}; {:.3} ms at best",
            args.particles, time.median, args.frames, time.best
        );
    }
    Ok(())
}
