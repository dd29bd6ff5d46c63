//! What tests share: requirements (programs, data and processors that a machine may lack), and damage to files.
//!
//! A test that has a requirement begins with [`need!`]. Where it is missing, the test returns and is recorded as skipped: a line
//! `test: reason` on standard error, and in the file that the environment variable `FOVEATE_SKIPPED` names, if it is set.
//! With `FOVEATE_STRICT=1` the test fails instead.
#![forbid(unsafe_code)]

mod digits;
pub mod fall;
mod random;

pub use digits::write_digits;
pub use random::{draws, noise};

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Takes the value of a requirement, a `Result<T, String>`, or returns from the test and records it as skipped.
///
/// ```
/// use foveate_testing::{data, need};
///
/// fn test() {
///     let clips = need!(data("clips"));
///     assert!(clips.is_dir());
/// }
/// ```
#[macro_export]
macro_rules! need {
    ($requirement:expr) => {
        match $requirement {
            Ok(value) => value,
            Err(missing) => return $crate::skip(&missing),
        }
    };
}

/// A multiply-add that rounds once where the processor's base has no instruction for it: that of some C libraries for Windows rounds twice.
///
/// # Errors
/// A text for [`need!`].
pub fn fused_multiply_add() -> Result<(), &'static str> {
    let (half, little) = (std::hint::black_box(1.0 + 2f32.powi(-12)), std::hint::black_box(2f32.powi(-80)));
    let once = half.mul_add(half, little) > 1.0 + 2f32.powi(-11);
    once.then_some(()).ok_or("C library whose fmaf rounds once")
}

/// Records that this test, or a part of it, does not run because `missing` is missing.
///
/// # Panics
/// With `FOVEATE_STRICT=1`.
pub fn skip(missing: &str) {
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    let strict = std::env::var_os("FOVEATE_STRICT").is_some_and(|value| value == "1");
    assert!(!strict, "{test} needs {missing} (FOVEATE_STRICT=1)");
    eprintln!("skipped: {test}: no {missing}");
    if let Some(path) = std::env::var_os("FOVEATE_SKIPPED") {
        let line = format!("{test}: no {missing}\n");
        let written =
            File::options().create(true).append(true).open(path).and_then(|mut it| it.write_all(line.as_bytes()));
        written.expect("FOVEATE_SKIPPED names a writable file");
    }
}

/// A file or folder of the test data: below the folder that `FOVEATE_DATA` names, or `data` beside `crates`.
///
/// # Errors
/// Fails if it does not exist.
pub fn data(path: &str) -> Result<PathBuf, String> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    let found = std::env::var_os("FOVEATE_DATA").map_or_else(beside, PathBuf::from).join(path);
    if found.exists() { Ok(found) } else { Err(format!("data: {path} (FOVEATE_DATA)")) }
}

/// The program ffmpeg.
///
/// # Errors
/// Fails if it is not installed.
pub fn ffmpeg() -> Result<(), String> {
    program("ffmpeg", "-version")
}

/// The program node.
///
/// # Errors
/// Fails if it is not installed.
pub fn node() -> Result<(), String> {
    program("node", "--version")
}

/// A program, which the argument `version` makes print its version.
///
/// # Errors
/// Fails if it is not installed.
pub fn program(name: &str, version: &str) -> Result<(), String> {
    let status = Command::new(name).arg(version).stdout(Stdio::null()).stderr(Stdio::null()).status();
    if status.is_ok_and(|status| status.success()) { Ok(()) } else { Err(format!("program {name}")) }
}

/// Damages a file in one to three places: bytes are changed, removed, repeated or cut off, or one of `words` replaces some. The same seed
/// gives the same bytes.
pub fn damaged(good: &[u8], words: &[&str], seed: u64) -> Vec<u8> {
    // SplitMix64.
    let mut state = seed;
    let mut below = |n: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    };
    let mut bytes = good.to_vec();
    for _ in 0..1 + below(3) {
        let at = below(bytes.len());
        let end = (at + 1 + below(19)).min(bytes.len());
        match below(5 + words.len().min(1)) {
            0 => bytes[at] = below(256) as u8,
            1 if end - at < bytes.len() => drop(bytes.drain(at..end)),
            2 => bytes.extend_from_within(at..end),
            3 => bytes.truncate(at + 1),
            5 => drop(bytes.splice(at..end.min(at + 3), words[below(words.len())].bytes())),
            _ => bytes[at] = b"0123456789.-e[]{}\",="[below(20)],
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_requirement_that_is_met_gives_its_value() {
        let reached = std::cell::Cell::new(0);
        let test = |requirement: Result<u32, String>| reached.set(need!(requirement));
        test(Ok(3));
        assert_eq!(reached.get(), 3);
    }

    #[test]
    fn data_that_do_not_exist_are_named() {
        assert!(data("no/such").is_err_and(|missing| missing.contains("no/such")));
    }
}
