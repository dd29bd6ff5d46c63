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
    Train(cmd::train::TrainArgs),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Train(args) => cmd::train::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("foveate: {error}");
            ExitCode::FAILURE
        }
    }
}
