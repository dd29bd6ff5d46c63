//! `foveate bench`: how long things take on this machine.

use std::path::Path;
use std::time::Instant;

use clap::{Subcommand, ValueEnum};
use foveate::Result;
use foveate::config::Config;
use foveate::eval::line_up;
use foveate::identity::encoder::Precision;
use foveate::scene::synthetic::{Drawn, Occlusion};
use foveate::scene::{Digits, Frame, Scene};

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
    /// Many targets in 640 x 480 pixels, with a detection each, one thread: time a frame against their number
    Many(ManyArgs),
    /// Every policy over a long video: time a frame and memory, early and late
    Policies(PoliciesArgs),
}

#[derive(clap::Args, Debug)]
struct ManyArgs {
    /// Frames to time for each number of targets
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// A configuration file, or the name of one that ships with the program
    #[arg(long, value_name = "FILE|NAME", default_value = "many")]
    config: String,
}

#[derive(clap::Args, Debug)]
struct PoliciesArgs {
    /// Frames each policy runs for
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(20..))]
    frames: u32,
    /// Number of particles: few, so that the policy's own time shows
    #[arg(long, default_value_t = 50, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    particles: u32,
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
    match args.what {
        What::Frame(args) => frame(args),
        What::Many(args) => many(args),
        What::Policies(args) => policies(args),
    }
}

/// Targets walk about over a busy picture, most of them apart from each other.
fn many(args: ManyArgs) -> Result<()> {
    let blueprint = super::track::blueprint(&args.config)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| foveate::Error::Invalid(format!("cannot start a thread: {e}")))?;
    say!("targets   ms of CPU a frame (median)   frames/s   ms a target");
    for n in [1, 2, 5, 10, 20] {
        let mut many = blueprint.many(1)?;
        let ms = pool.install(|| foveate::bench::many(&mut many, n, args.frames as usize))?.median;
        say!("{n:7} {ms:28.3} {:10.0} {:13.3}", 1e3 / ms, ms / n as f64);
    }
    Ok(())
}

/// A digit goes to and fro for as long as it takes. The first tenth is left out: what a policy learns there it has to grow.
fn policies(args: PoliciesArgs) -> Result<()> {
    let config = Config::builtin("digits-partial").expect("it ships with the program")?;
    let config = Config { particles: args.particles as usize, ..config };
    let video = Occlusion { frames: 200, ..Occlusion::default() }.video(&Digits::drawn(1, 1))?;
    let frames: Vec<Frame> = video.clone().source().collect::<Result<_>>()?;
    say!("policy            us a frame: 2nd tenth, last tenth, ratio   memory grown since the 1st tenth");
    for policy in line_up::policies(&config.policy) {
        let name = line_up::policy_name(&policy);
        let mut tracker = Config { policy, ..config.clone() }.check(Path::new("."))?.tracker(1, 0)?;
        tracker.start(&frames[0], video.truth()[0])?;
        let (tenth, mut times, mut memory) = (args.frames as usize / 10, [0.0; 10], 0);
        for (block, time) in times.iter_mut().enumerate() {
            if block == 1 {
                memory = resident();
            }
            let began = Instant::now();
            for i in 0..tenth {
                let at = (block * tenth + i + 1) % (2 * frames.len() - 2);
                let frame = &frames[at.min(2 * frames.len() - 2 - at)];
                tracker.step(Scene { frame, detections: &[] });
            }
            *time = 1e6 * began.elapsed().as_secs_f64() / tenth as f64;
        }
        let grown = resident().saturating_sub(memory) / 1024;
        say!("{name:16} {:22.1} {:11.1} {:6.2} {grown:20} KiB", times[1], times[9], times[9] / times[1]);
    }
    Ok(())
}

/// Bytes of memory in use, where the system tells; 0 elsewhere.
fn resident() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    1024 * line.and_then(|line| line.split_whitespace().next()?.parse::<usize>().ok()).unwrap_or(0)
}

fn frame(args: FrameArgs) -> Result<()> {
    let (precision, name) = match args.precision {
        PrecisionArg::F32 => (Precision::F32, "f32"),
        PrecisionArg::Bf16 => (Precision::Bf16, "bf16"),
    };
    let time = foveate::bench::frame(args.particles as usize, precision, args.frames as usize)?;
    if args.json {
        let line = serde_json::json!({
            "what": "tracker frame", "precision": name, "n": args.particles, "ms": time.median, "best_ms": time.best,
        });
        say!("{line}");
    } else {
        say!(
            "a frame of {} particles ({name}) takes {:.3} ms of CPU, the median of {}; {:.3} ms at best",
            args.particles,
            time.median,
            args.frames,
            time.best
        );
    }
    Ok(())
}
