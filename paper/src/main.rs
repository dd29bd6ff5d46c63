//! The experiments of the paper: its tables and figures beside those of foveate, with the program's own commands.
#![forbid(unsafe_code)]

mod eval;
mod reproduce;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

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
    /// Run the paper's experiments and put its tables and figures beside ours, on one page
    Reproduce(reproduce::Args),
    /// A command of foveate
    #[command(external_subcommand)]
    #[expect(dead_code, reason = "foveate reads all arguments itself")]
    Program(Vec<OsString>),
}

fn main() -> ExitCode {
    let (arguments, program): (Vec<_>, _) =
        (std::env::args_os().collect(), std::env::current_exe().unwrap_or_default());
    let cli = Cli::parse_from(&arguments);
    match cli.command {
        Command::Program(_) => foveate_cli::main(arguments, program),
        Command::Reproduce(args) => {
            foveate_cli::start(&arguments, program);
            cli.common.run(|| reproduce::run(args))
        }
    }
    .into()
}
