//! One file per command: its arguments and its implementation.

pub(crate) mod annotate;
pub(crate) mod completions;
pub(crate) mod configs;
pub(crate) mod configure;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod eval;
pub(crate) mod look;
pub(crate) mod man;
pub(crate) mod measure;
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

/// Returns a function that adds the file to an error of the library that does not name it.
fn of_file(path: &Path) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Invalid(what) if !what.starts_with(&*path.to_string_lossy()) => Error::malformed(path, what),
        error => error,
    }
}
