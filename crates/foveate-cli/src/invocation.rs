//! How the program was called: by itself, or from another language's package.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use foveate::video::without_password;

static INVOCATION: OnceLock<(Vec<OsString>, PathBuf)> = OnceLock::new();

/// Says how the program was called. A second call in one process changes nothing.
pub fn set(arguments: &[OsString], program: PathBuf) {
    let _ = INVOCATION.set((arguments.to_vec(), program));
}

/// The arguments, without the program's own name.
pub fn words() -> impl Iterator<Item = String> {
    let words = INVOCATION.get().map_or(&[][..], |(words, _)| words.get(1..).unwrap_or(&[]));
    words.iter().map(|word| word.to_string_lossy().into_owned())
}

/// The arguments in one line, without passwords of streams.
pub fn arguments() -> String {
    words().map(|word| without_password(&word).into_owned()).collect::<Vec<_>>().join(" ")
}

/// The command in one line: the program as it was called, and its arguments.
pub fn command() -> String {
    let name = INVOCATION.get().and_then(|(words, _)| words.first()).map(|word| word.to_string_lossy().into_owned());
    format!("{} {}", name.unwrap_or_else(|| "foveate".into()), arguments())
}

/// The file that has the program's code.
pub fn program() -> &'static Path {
    INVOCATION.get().map_or(Path::new("foveate"), |(_, program)| program)
}
