//! Threads that the system may refuse.

use std::thread::{Builder, JoinHandle};

use crate::{Error, Result};

/// Starts a thread. `std::thread::spawn` panics where the system gives none, as in a container with few processes or little memory.
///
/// # Errors
/// [`Error::Memory`], which says what the thread is for: `what`, as in "reading frames ahead".
pub fn start<T: Send + 'static>(what: &str, work: impl FnOnce() -> T + Send + 'static) -> Result<JoinHandle<T>> {
    Builder::new().spawn(work).map_err(|error| refused(what, &error))
}

/// The error of a thread that was not given.
fn refused(what: &str, error: &std::io::Error) -> Error {
    Error::Memory(format!("{what}: cannot start a thread: {error}; allow this process more threads or more memory"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_gives_what_it_made() {
        assert_eq!(start("counting", || 7).expect("a thread").join().expect("no panic"), 7);
    }

    #[test]
    fn a_refused_thread_is_an_error_that_says_for_what() {
        let said = refused("reading frames ahead", &std::io::ErrorKind::WouldBlock.into()).to_string();
        assert!(
            said.starts_with("reading frames ahead: cannot start a thread: ") && said.contains("more threads"),
            "{said}"
        );
    }
}
