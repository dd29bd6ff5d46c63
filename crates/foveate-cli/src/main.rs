//! The `foveate` command.

use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod cmd;

/// Follow an object through video, and recognise it, by learning where to look.
#[derive(Parser)]
#[command(name = "foveate", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Synth(cmd::synth::Args),
    Eval(cmd::eval::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Synth(args) => cmd::synth::run(args),
        Command::Eval(args) => cmd::eval::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("foveate: {error}");
            ExitCode::FAILURE
        }
    }
}
