//! Errors. Each states four parts: the place, the expected value, the value found, and the remedy.
//!
//! Errors happen at the border only: before the first frame (configuration, models), or in a source.
//! Inside the library a broken promise is a panic that names the promise.

use std::path::{Path, PathBuf};

use crate::text::visible;

/// An error and its remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{}: {doing}: {source}", shown(path))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The failed action, for example "cannot read".
        doing: &'static str,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// A file exists but has another content than expected.
    #[error("{}: {problem}", shown(path))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The expected content, the content found, and the remedy.
        problem: String,
    },
    /// One frame of a source could not be decoded; earlier frames are good.
    #[error("{}, frame {frame}: {problem}", shown(path))]
    Frame {
        /// The video or image file.
        path: PathBuf,
        /// Index of the frame in the source, counted from 1.
        frame: usize,
        /// The expected content, the content found, and the remedy.
        problem: String,
    },
    /// A setting is misspelled, missing or out of range.
    #[error("{0}")]
    Config(String),
    /// More memory would be needed than [`crate::memory::limit`] allows.
    #[error("{0}")]
    Memory(String),
    /// The work was interrupted.
    #[error("asked to stop before it was done")]
    Stopped,
    /// Two parts do not fit each other, or a value given by a caller is out of range.
    #[error("{0}")]
    Invalid(String),
}

/// The path with its control characters escaped.
fn shown(path: &Path) -> String {
    visible(&path.to_string_lossy()).into_owned()
}

impl Error {
    /// An [`Error::Io`], for `map_err`.
    pub fn io(path: impl Into<PathBuf>, doing: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, doing, source }
    }

    /// An [`Error::Malformed`].
    pub fn malformed(path: impl Into<PathBuf>, problem: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), problem: problem.into() }
    }
}

/// Fails if the setting `key` is not a number from `least` to `most`.
///
/// # Errors
/// [`Error::Config`] with the key, the range and the value.
pub fn within(key: &str, value: f64, least: f64, most: f64) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::Config(format!("{key} is a number from {least} to {most}; it is {value}")))
}

/// Short for a result that fails with [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
