//! One file a command: its arguments, and what it does.

pub(crate) mod completions;
pub(crate) mod configs;
pub(crate) mod configure;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod eval;
pub(crate) mod look;
pub(crate) mod man;
mod results;
pub(crate) mod serve;
pub(crate) mod synth;
pub(crate) mod tiles;
pub(crate) mod track;
pub(crate) mod train;
pub(crate) mod trax;
pub(crate) mod videos;

use std::path::Path;

use foveate::Error;

/// An error of the library, where it knows no files, with the file that it is of.
fn of_file(path: &Path) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Invalid(what) if !what.starts_with(&*path.to_string_lossy()) => Error::malformed(path, what),
        error => error,
    }
}
