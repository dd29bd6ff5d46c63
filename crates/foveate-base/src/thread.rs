//! Threads that the system may refuse.

use std::sync::{OnceLock, mpsc};
use std::thread::{Builder, JoinHandle};

use crate::memory::{listed, shown};
use crate::{Error, Result};

/// Address space of a new thread before its work begins: a stack of 2 MiB, guard pages, a signal stack, and the
/// mappings of its first allocations.
const ROOM: u64 = 3 << 20;

/// Starts a thread. `std::thread::spawn` panics if the system grants none, for example in a container with few
/// processes or little memory. If a thread gets a stack but no signal stack, it panics and ends the process. So with
/// limited address space (`ulimit -v`) this function checks for both first, and the next thread waits until this one
/// has started.
///
/// # Errors
/// [`Error::Memory`] with the purpose of the thread, `what`, such as "reading frames ahead".
pub fn start<T: Send + 'static>(what: &str, work: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>> {
    let Some(limit) = address_space() else {
        return Builder::new().spawn(work).map_err(|error| refused(what, &error));
    };
    has_room(limit, taken()).map_err(|problem| refused(what, &problem))?;
    let (began, begins) = mpsc::sync_channel(1);
    let begun = move || {
        let _ = began.send(());
        work()
    };
    let thread = Builder::new().spawn(begun).map_err(|error| refused(what, &error))?;
    let _ = begins.recv();
    Ok(thread)
}

/// The same for a thread of a pool, for rayon's `spawn_handler`.
///
/// # Errors
/// Those of [`start`].
pub fn started(work: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    start("working", work).map(drop).map_err(std::io::Error::other)
}

/// The error of a thread that was not given.
fn refused(what: &str, problem: &dyn std::fmt::Display) -> Error {
    Error::Memory(format!("{what}: cannot start a thread: {problem}; allow this process more threads or more memory"))
}

fn has_room(limit: u64, taken: Option<u64>) -> std::result::Result<(), String> {
    match taken {
        Some(taken) if limit.saturating_sub(taken) < ROOM => Err(format!(
            "it takes {} of address space, and {} of the {} that this process may have are taken",
            shown(ROOM),
            shown(taken),
            shown(limit)
        )),
        _ => Ok(()),
    }
}

/// The limit of this process's address space in bytes; `None` if there is no limit or it is unknown.
fn address_space() -> Option<u64> {
    static LIMIT: OnceLock<Option<u64>> = OnceLock::new();
    *LIMIT.get_or_init(|| limit_in(&std::fs::read_to_string("/proc/self/limits").ok()?))
}

fn limit_in(limits: &str) -> Option<u64> {
    limits.lines().find_map(|line| line.strip_prefix("Max address space"))?.split_whitespace().next()?.parse().ok()
}

/// Bytes of address space that this process has.
fn taken() -> Option<u64> {
    listed("VmSize:", &std::fs::read_to_string("/proc/self/status").ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_returns_its_result() {
        assert_eq!(start("counting", || 7).expect("a thread").join().expect("no panic"), 7);
    }

    #[test]
    fn a_refused_thread_is_an_error_with_its_purpose() {
        let said = refused("reading frames ahead", &std::io::ErrorKind::WouldBlock).to_string();
        assert!(
            said.starts_with("reading frames ahead: cannot start a thread: ") && said.contains("more threads"),
            "{said}"
        );
    }

    #[test]
    fn a_thread_has_room_or_is_refused_with_figures() {
        assert!(has_room(50 << 20, Some(47 << 20)).is_ok() && has_room(1, None).is_ok());
        let said = has_room(50 << 20, Some((47 << 20) + 1)).expect_err("too little");
        assert_eq!(
            said,
            "it takes 3 MiB of address space, and 47 MiB of the 50 MiB that this process may have are taken"
        );
        assert!(has_room(0, Some(u64::MAX)).is_err());
    }

    #[test]
    fn limits_are_read_as_linux_writes_them() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                      Max cpu time              unlimited            unlimited            seconds   \n\
                      Max address space         49152000             unlimited            bytes     \n";
        assert_eq!(limit_in(limits), Some(49_152_000));
        assert_eq!(limit_in(&limits.replace("49152000 ", "unlimited")), None);
        assert_eq!(listed("VmSize:", "Name:\tfoveate\nVmPeak:\t  9000 kB\nVmSize:\t    8192 kB\n"), Some(8 << 20));
        assert_eq!((limit_in(""), listed("VmSize:", "VmSize:")), (None, None));
        if cfg!(target_os = "linux") {
            assert!(taken().is_some_and(|bytes| bytes > 1 << 20));
        }
    }
}
