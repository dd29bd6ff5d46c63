//! The paper's experiments: its tables and figures beside those of foveate, with the program's own commands.
#![forbid(unsafe_code)]

mod autoencoder;
mod eval;
mod mcrbm;
mod parts;
mod reproduce;
mod train;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use foveate::Result;

/// The shipped classifier of digits.
const DIGITS: &str = "builtin:digits";

#[derive(Parser)]
#[command(
    name = "paper",
    version,
    about = "The experiments of the paper on foveate. All other commands are those of foveate",
    max_term_width = 100
)]
struct Cli {
    #[command(flatten)]
    common: foveate_cli::Common,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run the paper's experiments and show its tables and figures beside those of foveate, on one page
    Reproduce(reproduce::Args),
    /// Train a model
    Train(train::Args),
    /// A command of foveate
    #[command(external_subcommand)]
    #[expect(dead_code, reason = "foveate reads all arguments itself")]
    Program(Vec<OsString>),
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().collect();
    let cli = Cli::parse_from(&arguments);
    let run: Box<dyn FnOnce() -> Result<()> + Send> = match cli.command {
        Command::Reproduce(args) => Box::new(|| reproduce::run(args)),
        Command::Train(train::Args { what: train::What::Mcrbm(args) }) => Box::new(move || train::mcrbm::run(&args)),
        Command::Train(train::Args { what: train::What::Autoencoder(args) }) => {
            Box::new(move || train::autoencoder::run(&args))
        }
        Command::Train(_) | Command::Program(_) => return foveate_cli::main_with(parts::parts()),
    };
    foveate_cli::start(&arguments, std::env::current_exe().unwrap_or_default(), parts::parts());
    cli.common.run(run).into()
}
