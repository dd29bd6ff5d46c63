//! Codes and texts of errors, and the barrier that no panic passes.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};

use foveate::{Error, quiet};

/// The result of a function. After any code but FOVEATE_CODE_OK, foveate_last_error() has the text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub(crate) enum FoveateCode {
    /// The call succeeded.
    Ok = 0,
    /// An argument is null, not finite, out of range or of the wrong size. The tracker has not changed, except by a failed load.
    Invalid = 1,
    /// The handle is null, was freed, or belongs to the other kind of tracker.
    Handle = 2,
    /// No configuration has this name, or a setting is misspelled or out of range.
    Config = 3,
    /// A model file of the configuration cannot be read.
    File = 4,
    /// The picture or the targets exceed the memory limit.
    Memory = 5,
    /// The buffer is too small. The required size was written.
    Buffer = 6,
    /// A fault inside foveate. Free the tracker.
    Internal = 7,
}

/// A failed call.
#[derive(Debug)]
pub(crate) struct Failure {
    pub code: FoveateCode,
    pub text: String,
}

impl Failure {
    pub(crate) fn new(code: FoveateCode, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }
    pub(crate) fn invalid(text: impl Into<String>) -> Self {
        Self::new(FoveateCode::Invalid, text)
    }
    /// The failure for a null pointer in the argument of this name.
    pub(crate) fn null(argument: &str) -> Self {
        Self::invalid(format!("{argument} is a null pointer; give the address of a value"))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let code = match &error {
            Error::Invalid(_) => FoveateCode::Invalid,
            Error::Config(_) => FoveateCode::Config,
            Error::Io { .. } | Error::Malformed { .. } | Error::Frame { .. } => FoveateCode::File,
            Error::Memory(_) => FoveateCode::Memory,
            _ => FoveateCode::Internal,
        };
        Self::new(code, error.to_string())
    }
}

thread_local!(static LAST: RefCell<CString> = RefCell::default());

/// Returns the text of the last failed call of this thread. It is valid until the next failed call of the thread.
pub(crate) fn last() -> *const c_char {
    const NONE: &CStr = c"";
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(NONE.as_ptr())
}

/// Runs the work of a function: a failure or a panic becomes a code, and its text the last error of this thread.
pub(crate) fn enter(work: impl FnOnce() -> Result<(), Failure>) -> FoveateCode {
    let failure = match quiet::catch(work) {
        Ok(Ok(())) => return FoveateCode::Ok,
        Ok(Err(failure)) => failure,
        Err(panic) => {
            Failure::new(FoveateCode::Internal, format!("a fault inside foveate: {panic}; free this tracker"))
        }
    };
    let text = CString::new(failure.text.replace('\0', " ")).unwrap_or_default();
    // A thread that ends has no last error.
    let _ = LAST.try_with(|last| last.replace(text));
    failure.code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_and_failures_become_codes_with_texts() {
        let text = || LAST.with_borrow(|last| last.to_str().expect("it is UTF-8").to_owned());
        assert_eq!(enter(|| panic!("no {}", 1)), FoveateCode::Internal);
        assert!(text().contains("no 1"), "{}", text());
        assert_eq!(enter(|| Err(Error::Config("a\0b".into()).into())), FoveateCode::Config);
        assert_eq!(text(), "a b");
        assert_eq!(enter(|| Ok(())), FoveateCode::Ok);
    }
}
