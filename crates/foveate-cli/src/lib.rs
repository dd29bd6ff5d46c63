//! The `foveate` command: follow one target or many through video, on a CPU.
//!
//! [`main_with`] is the whole program, with your own components beside those of the library. Programs that only track use the crate `foveate`.
#![forbid(unsafe_code)]
// Use `say!` instead: a closed standard output must not cause a panic.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
pub mod terminal;
mod cmd;
mod invocation;
pub mod runs;

/// The configuration of a run, by file or by name.
pub mod configure {
    pub use crate::cmd::configure::{Changes, read};
}
/// Training runs: glimpses, files, checkpoints, progress.
pub mod training {
    pub use crate::cmd::train::common::{Args, Glimpses, Recipe};
}
/// Videos with ground truth.
pub mod videos {
    pub use crate::cmd::videos::{Video, digest, of_sequence};
}
pub use invocation::{command, set as start};

/// Boxes in the files of other programs, as `foveate convert` writes them.
pub mod convert {
    pub use crate::cmd::convert::{Boxes, Format, write_yolo};
}

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use foveate::extend::Parts;

#[derive(Parser)]
#[command(name = "foveate", version, about = "Follow one target or many through video, on a CPU", max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct Common {
    /// Number of threads, 0 for all processors; results do not depend on it
    #[arg(long, global = true, default_value_t = 0, value_name = "N", hide_default_value = true, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
    /// Memory limit for pictures, targets and settings, such as 512M or 6G; exceeding it is an error. Default: a quarter of the machine's
    /// memory
    #[arg(long, global = true, value_name = "SIZE", value_parser = foveate::memory::parse)]
    max_memory: Option<u64>,
}

#[derive(Subcommand)]
enum Command {
    /// Try a learned, a fixed and a random gaze on a drawn digit, with small glimpses
    Demo(cmd::demo::Args),
    /// Follow a target through a video file or a folder of images
    Track(Box<cmd::track::Args>),
    /// Annotate a video: boxes of all frames from those of a few, and the frames to check first
    Annotate(Box<cmd::annotate::Args>),
    /// Measure motion in metres and seconds: positions, velocities, accelerations and fits, with errors
    Measure(Box<cmd::measure::MeasureArgs>),
    /// Show salient or moving regions of a frame, and the candidates found there
    Look(cmd::look::Args),
    /// Watch the tracker in a browser: draw a box, pause, step back, correct, save
    Serve(cmd::serve::Args),
    /// Draw a box in a browser and print the command line that tracks it
    Pick(cmd::serve::PickArgs),
    /// Cut a video into tiles at several resolutions, for trackers that read regions of large pictures
    Tiles(cmd::tiles::Args),
    /// Make synthetic scenes
    Synth(cmd::synth::Args),
    /// Train a model
    Train(cmd::train::Args),
    /// Score trackers on sequences with ground truth
    Eval(cmd::eval::Args),
    /// Convert boxes between OTB, VOT, GOT-10k, MOTChallenge, COCO, CVAT, Label Studio, VIAME and TrackMate
    Convert(cmd::convert::Args),
    /// Track for vot-toolkit and other clients of the TraX protocol, on standard input and output
    Trax(cmd::trax::Args),
    /// List the configurations that ship with the program, or print one
    Configs(cmd::configs::Args),
    /// Print completions for a shell
    Completions(cmd::completions::Args),
    /// Write manual pages
    Man(cmd::man::Args),
}

/// Limits the vector instructions to `FOVEATE_KERNELS=portable`, `avx2` or `avx512`, to compare their results.
fn kernels() -> foveate::Result<()> {
    let Some(name) = std::env::var_os("FOVEATE_KERNELS") else { return Ok(()) };
    let level = foveate::KernelLevel::ALL.into_iter().find(|(n, _)| name == **n);
    let wrong = |what: &str| Err(foveate::Error::Invalid(format!("FOVEATE_KERNELS={}: {what}", name.display())));
    match level {
        None => wrong("expected portable, avx2 or avx512"),
        Some((_, level)) if !level.at_most() => wrong("this processor has none of these instructions; leave it out"),
        Some(_) => Ok(()),
    }
}

/// Creates a pool of `number` threads; 0 means one per core.
fn threads(number: usize) -> foveate::Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(number);
    let pool = pool.spawn_handler(|worker| foveate::thread::started(|| worker.run())).build();
    pool.map_err(|error| foveate::Error::Memory(format!("{error}, or give a smaller --threads")))
}

impl Common {
    /// Runs a command with this number of threads and this memory limit, and reports its error on standard error. Returns the exit status:
    /// 0, 1 after an error, or that of the signal that stopped the command.
    pub fn run(self, command: impl FnOnce() -> foveate::Result<()> + Send) -> u8 {
        foveate::memory::set_limit(self.max_memory.unwrap_or(0));
        terminal::catch_file_limit();
        if let Err(error) = kernels() {
            note!("foveate: {error}");
            return 1;
        }
        // A decoder's panic is reported once, as an error of its file.
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !foveate::quiet::is_caught() {
                previous(info);
            }
        }));
        match threads(self.threads.into()).and_then(|pool| pool.install(command)) {
            Ok(()) => 0,
            Err(error) => {
                note!("foveate: {error}");
                // After a signal the status identifies it.
                if terminal::stopping() { terminal::stop_status() as u8 } else { 1 }
            }
        }
    }
}

/// The whole program, with `parts` that configurations may name beside those of the library: the `main` of a program of yours.
///
/// ```no_run
/// use foveate::extend::Parts;
///
/// fn main() -> std::process::ExitCode {
///     foveate_cli::main_with(Parts::new()) // .with_policy("my-policy", |settings: MySettings| Ok(MyPolicy::new(settings)))
/// }
/// ```
pub fn main_with(parts: Parts) -> ExitCode {
    let program = std::env::current_exe().unwrap_or_default();
    run(std::env::args_os().collect(), program, parts).into()
}

/// Runs the program with these arguments, its own name first; `program` is the file that has its code, for a package in another language.
/// Returns the exit status: 0, or 1 after an error, which is on standard error. Wrong arguments, `--help` and a second Ctrl-C end the
/// process.
pub fn main(arguments: Vec<OsString>, program: PathBuf) -> u8 {
    run(arguments, program, Parts::new())
}

fn run(arguments: Vec<OsString>, program: PathBuf, parts: Parts) -> u8 {
    if let Some(status) = foveate::video::sandbox::decode_if_asked(arguments.get(1..).unwrap_or(&[])) {
        return status;
    }
    invocation::set(&arguments, program, parts);
    let cli = Cli::parse_from(arguments);
    cli.common.run(|| match cli.command {
        Command::Demo(args) => cmd::demo::run(args),
        Command::Track(args) => cmd::track::run(*args),
        Command::Annotate(args) => cmd::annotate::run(*args),
        Command::Measure(args) => cmd::measure::run(*args),
        Command::Look(args) => cmd::look::run(args),
        Command::Serve(args) => cmd::serve::run(args),
        Command::Pick(args) => cmd::serve::run_pick(args),
        Command::Tiles(args) => cmd::tiles::run(args),
        Command::Synth(args) => cmd::synth::run(args),
        Command::Train(args) => cmd::train::run(args),
        Command::Eval(args) => cmd::eval::run(args),
        Command::Convert(args) => cmd::convert::run(args),
        Command::Trax(args) => cmd::trax::run(args),
        Command::Configs(args) => cmd::configs::run(args),
        Command::Completions(args) => cmd::completions::run(args, Cli::command()),
        Command::Man(args) => cmd::man::run(args, Cli::command()),
    })
}
