//! Failures of the file system on request, for tests: the one seam that every operation of ours on a file to be written goes through.
//!
//! In builds with debug assertions, `FOVEATE_FAULT=write:3` makes the third write of the process fail half-way, like
//! a full disk. The other operations are `open`, `sync` and `rename`. `write:3+` fails the third and all later ones,
//! `write@film.mp4:1` the first on a file of that name. `FOVEATE_FAULT_LOG` is a file that gets a line for each
//! failure. Release builds ignore both.

#[cfg(not(debug_assertions))]
use std::{io, path::Path};

/// An operation on a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// A file or folder is made.
    Open,
    /// Bytes are written.
    Write,
    /// Synchronises written data with the disk.
    Sync,
    /// Renames a file or folder to its final name.
    Rename,
}

/// Call this before the operation. Returns the failure that a test configured, if any.
///
/// # Errors
/// [`std::io::ErrorKind::StorageFull`], on request only.
#[cfg(not(debug_assertions))]
pub fn attempt(_: Operation, _: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(debug_assertions)]
pub use asked::attempt;

#[cfg(debug_assertions)]
mod asked {
    use super::Operation;
    use std::io::{self, Write};
    use std::path::Path;
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicUsize, Ordering};

    struct Asked {
        operation: Operation,
        /// A part of the file's name.
        name: String,
        at: usize,
        and_on: bool,
        log: Option<std::ffi::OsString>,
    }

    fn asked() -> Option<Asked> {
        let text = std::env::var("FOVEATE_FAULT").ok()?;
        let (what, at) = text.split_once(':')?;
        let (what, name) = what.split_once('@').unwrap_or((what, ""));
        let all = [
            ("open", Operation::Open),
            ("write", Operation::Write),
            ("sync", Operation::Sync),
            ("rename", Operation::Rename),
        ];
        let operation = all.into_iter().find(|(n, _)| *n == what)?.1;
        let at_least = at.strip_suffix('+');
        let n = at_least.unwrap_or(at).parse().ok()?;
        let name = name.to_owned();
        Some(Asked { operation, name, at: n, and_on: at_least.is_some(), log: std::env::var_os("FOVEATE_FAULT_LOG") })
    }

    /// Call this before the operation. Returns the failure that a test configured, if any.
    ///
    /// # Errors
    /// [`io::ErrorKind::StorageFull`], on request only.
    pub fn attempt(operation: Operation, path: &Path) -> io::Result<()> {
        static ASKED: OnceLock<Option<Asked>> = OnceLock::new();
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let named = |asked: &&Asked| path.file_name().is_some_and(|name| name.to_string_lossy().contains(&asked.name));
        let asked = ASKED.get_or_init(asked).as_ref().filter(|asked| asked.operation == operation);
        let Some(asked) = asked.filter(named) else { return Ok(()) };
        let n = COUNT.fetch_add(1, Ordering::SeqCst) + 1;
        if n != asked.at && !(asked.and_on && n > asked.at) {
            return Ok(());
        }
        if let Some(log) = &asked.log {
            let mut log = std::fs::OpenOptions::new().create(true).append(true).open(log)?;
            writeln!(log, "{operation:?} {n} {}", path.display())?;
        }
        Err(io::Error::new(io::ErrorKind::StorageFull, "failed on request"))
    }
}
