//! One file a command: its arguments, and what it does.

pub mod completions;
pub mod configs;
pub mod configure;
pub mod convert;
pub mod demo;
pub mod eval;
pub mod look;
pub mod man;
mod results;
pub mod serve;
pub mod synth;
pub mod tiles;
pub mod track;
pub mod train;
pub mod trax;
pub mod videos;

use std::path::Path;

use foveate::Error;

/// An error of the library, where it knows no files, with the file that it is of.
fn of_file(path: &Path) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Invalid(what) if !what.starts_with(&*path.to_string_lossy()) => Error::malformed(path, what),
        error => error,
    }
}
