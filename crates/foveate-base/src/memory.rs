//! The memory limit of this process for files, streams and settings.
//!
//! Code that allocates according to a file or a setting first calls [`check`]. A picture that claims 16384 × 16384
//! pixels, a million particles or ten thousand targets then give an error instead of an out-of-memory kill. The limit
//! holds for the whole process and never changes a result. It applies to an estimate of the largest parts: pictures
//! in all their copies, particles, targets. The check also reserves the memory for a moment, because a
//! later failed allocation would abort the program.

use std::hint::black_box;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result};

/// 0 until it is first set or read.
static LIMIT: AtomicU64 = AtomicU64::new(0);

/// The default if the machine's memory is unknown.
const UNKNOWN: u64 = 4 << 30;
/// The limit of small machines.
const LEAST: u64 = 1 << 30;

/// The advice in errors about a low limit. A front end with another option replaces it.
pub const ADVICE: &str = "allow more with --max-memory (in the library: memory::set_limit)";

/// Bytes that a pixel of a picture takes in a whole run, in all copies together: the decoded picture, those in the queue, that of the
/// frame before, box means and sums of colours, the film and its encoder, which has most. docs/robustness.md has the measurements.
pub const PIXEL: u64 = 80;

/// Resizes a buffer for so many values. It only grows, because removed and added values would be filled with zeros
/// again. It grows by half more than needed, so that a region of varying size does not allocate every few frames.
pub fn grow<T: Clone + Default>(room: &mut Vec<T>, count: usize) {
    if room.len() < count {
        room.resize(count + count / 2, T::default());
    }
}

/// The limit in bytes: the one set, or a quarter of the machine's memory, at least 1 GiB.
pub fn limit() -> u64 {
    match LIMIT.load(Ordering::Relaxed) {
        0 => {
            let limit = (machine().unwrap_or(UNKNOWN) / 4).max(LEAST);
            LIMIT.store(limit, Ordering::Relaxed);
            limit
        }
        limit => limit,
    }
}

/// Sets the limit of this process, bytes; 0 takes that of the machine again.
pub fn set_limit(bytes: u64) {
    LIMIT.store(bytes, Ordering::Relaxed);
}

/// Bytes of text such as `512M`, `6G`, `1.5G`.
///
/// # Errors
/// The expectation, in words.
pub fn parse(text: &str) -> std::result::Result<u64, String> {
    let wrong = || format!("expected a size such as 512M or 6G, of 16M at least, got \"{}\"", text.escape_debug());
    let (number, unit) = match text.strip_suffix(['G', 'g']) {
        Some(number) => (number, 1u64 << 30),
        None => (text.strip_suffix(['M', 'm']).ok_or_else(wrong)?, 1 << 20),
    };
    let bytes = number.parse::<f64>().map_err(|_| wrong())? * unit as f64;
    if (f64::from(1 << 24)..1e15).contains(&bytes) { Ok(bytes as u64) } else { Err(wrong()) }
}

/// Bytes a pixel while decoding: the picture twice, in three planes.
const DECODED: u64 = 6;

/// Fails if `bytes` exceed the limit or the memory that the system grants at once. `what` names the purpose in the
/// error.
///
/// # Errors
/// [`Error::Memory`] with the purpose, the bytes, the limit and the remedy.
pub fn check(what: impl std::fmt::Display, bytes: u64) -> Result<()> {
    allowed(&what, bytes)?;
    given(&what, bytes)
}

/// Fails if the system does not grant `bytes` at once: a process may have less than the machine (`ulimit -v`). The
/// memory is not written.
fn given(what: &impl std::fmt::Display, bytes: u64) -> Result<()> {
    let mut room = Vec::<u8>::new();
    let taken = usize::try_from(bytes).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
    // Otherwise the compiler may remove the unused allocation.
    black_box(&room);
    if taken {
        return Ok(());
    }
    let shown = shown(bytes);
    Err(Error::Memory(format!(
        "{what} would take about {shown} of memory, which the system does not give; make it smaller, or allow this process more"
    )))
}

fn allowed(what: &impl std::fmt::Display, bytes: u64) -> Result<()> {
    if bytes <= limit() {
        return Ok(());
    }
    Err(Error::Memory(format!(
        "{what} would take about {} of memory, more than the {} allowed; make it smaller, or {ADVICE}",
        shown(bytes),
        shown(limit())
    )))
}

/// Fails if a run on pictures of this size exceeds the limit, or decoding one exceeds the memory of the system. The
/// size comes from an untrusted header.
///
/// # Errors
/// As [`check`].
pub fn check_picture(width: usize, height: usize) -> Result<()> {
    let (what, run) = (format_args!("a picture of {width} x {height} pixels"), of_picture(width, height));
    allowed(&what, run)?;
    given(&what, run / PIXEL * DECODED)
}

/// The memory of a run on pictures of this size, bytes.
pub fn of_picture(width: usize, height: usize) -> u64 {
    (width as u64).saturating_mul(height as u64).saturating_mul(PIXEL)
}

/// Bytes for people.
pub fn shown(bytes: u64) -> String {
    let (mib, gib) = (bytes as f64 / f64::from(1 << 20), bytes as f64 / f64::from(1 << 30));
    if gib >= 1.0 { format!("{gib:.1} GiB") } else { format!("{mib:.0} MiB") }
}

/// The memory of the machine, or of the process's control group (container).
fn machine() -> Option<u64> {
    let total = listed("MemTotal:", &std::fs::read_to_string("/proc/meminfo").ok()?)?;
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let groups = group.iter().filter_map(|path| std::fs::read_to_string(path).ok()?.trim().parse().ok());
    groups.chain([total]).min()
}

/// Bytes of a line that Linux lists so many kB in, by its first word.
pub(crate) fn listed(name: &str, text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exceeding_the_limit_is_reported_with_figures() {
        assert!(limit() >= LEAST);
        set_limit(200 << 20);
        assert!(check("a little", 200 << 20).is_ok() && check_picture(1920, 1080).is_ok());
        let said = check_picture(16384, 16384).expect_err("too much").to_string();
        for part in ["16384 x 16384", "20.0 GiB", "200 MiB", "--max-memory"] {
            assert!(said.contains(part), "{said}");
        }
        assert!(check_picture(usize::MAX, usize::MAX).is_err());
        set_limit(0);
        assert!(limit() >= LEAST);
    }

    #[test]
    fn sizes_are_read() {
        assert_eq!(parse("512M"), Ok(512 << 20));
        assert_eq!(parse("1.5G"), Ok(3 << 29));
        for bad in ["", "12", "M", "-1G", "1e99G", "nanG", "1M", "infG", "5T"] {
            assert!(parse(bad).expect_err("no size").contains("512M"), "{bad}");
        }
    }
}
