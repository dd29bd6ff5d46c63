//! Implements `paper train`: the first layers that the paper mentions and no shipped configuration uses.

use std::ffi::OsString;

use clap::Subcommand;

pub(crate) mod autoencoder;
pub(crate) mod mcrbm;

/// Train a model.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub what: What,
}

#[derive(Subcommand)]
pub(crate) enum What {
    Mcrbm(Box<mcrbm::Args>),
    Autoencoder(Box<autoencoder::Args>),
    /// Train a model with `foveate train`
    #[command(external_subcommand)]
    #[expect(dead_code, reason = "foveate reads all arguments itself")]
    Program(Vec<OsString>),
}
