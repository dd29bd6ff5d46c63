//! The invocation of the program: its arguments, its file, and the components that it adds to those of the library.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use foveate::extend::Parts;
use foveate::video::{Sandbox, without_password};
use foveate_page::word;

struct Invocation {
    /// The arguments, starting with the program's own name.
    words: Vec<OsString>,
    program: PathBuf,
    parts: Parts,
}

static INVOCATION: OnceLock<Invocation> = OnceLock::new();

/// Sets the invocation, once per process: a second call changes nothing.
pub fn set(arguments: &[OsString], program: PathBuf, parts: Parts) {
    let _ = INVOCATION.set(Invocation { words: arguments.to_vec(), program, parts });
}

/// Returns the components that configurations may name beside those of the library.
pub(crate) fn parts() -> Parts {
    INVOCATION.get().map_or_else(Parts::new, |it| it.parts.clone())
}

/// Returns the arguments without the program's own name.
pub(crate) fn words() -> impl Iterator<Item = String> {
    let words = INVOCATION.get().map_or(&[][..], |it| it.words.get(1..).unwrap_or(&[]));
    words.iter().map(|word| word.to_string_lossy().into_owned())
}

/// Returns the arguments in one line for a shell, without passwords of streams.
pub(crate) fn arguments() -> String {
    words().map(|argument| word(&without_password(&argument))).collect::<Vec<_>>().join(" ")
}

/// Returns the command in one line for a shell: the program as it was called, and its arguments.
pub fn command() -> String {
    let name = INVOCATION.get().and_then(|it| it.words.first()).map(|name| word(&name.to_string_lossy()));
    format!("{} {}", name.unwrap_or_else(|| "foveate".into()), arguments())
}

/// Returns the program as a child that decodes: itself, or as a package of another language was called.
pub(crate) fn sandbox() -> Sandbox {
    let own = std::env::current_exe().unwrap_or_default();
    let name = INVOCATION.get().and_then(|it| it.words.first()).map(PathBuf::from).filter(|name| name.is_file());
    Sandbox(match name {
        _ if own == program() => vec![own.into()],
        Some(script) => vec![own.into(), script.into()],
        None => vec![own.into(), "-m".into(), "foveate".into()],
    })
}

/// Returns the file that has the program's code.
pub(crate) fn program() -> &'static Path {
    INVOCATION.get().map_or(Path::new("foveate"), |it| &it.program)
}
