//! Other people's panics, made into words.
//!
//! Decoders of pictures and video eat bytes that anybody may have made. Ours are memory-safe, but an
//! index out of range or an overflow in one of them must be an error of that file, not the end of the program.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local!(static QUIET: Cell<bool> = const { Cell::new(false) });

/// Whether [`catch`] turns a panic of this thread into an error now. The library does not change the panic hook. A
/// hook of the program can call this to suppress messages of panics that are reported as errors.
pub fn is_caught() -> bool {
    QUIET.get()
}

/// Runs `f`; a panic in it becomes its message. What `f` borrowed mutably must be thrown away after a panic.
pub fn catch<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    let was = QUIET.replace(true);
    let result = catch_unwind(AssertUnwindSafe(f));
    QUIET.set(was);
    result.map_err(|panic| match panic.downcast::<String>() {
        Ok(message) => *message,
        Err(panic) => panic.downcast::<&str>().map_or_else(|_| "panic".to_owned(), |message| (*message).to_owned()),
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_panic_becomes_its_message() {
        assert_eq!(super::catch(|| 7), Ok(7));
        assert_eq!(super::catch(|| -> u8 { panic!("no {}", 1) }), Err("no 1".to_owned()));
        assert_eq!(super::catch(|| -> u8 { panic!("plain") }), Err("plain".to_owned()));
    }
}
