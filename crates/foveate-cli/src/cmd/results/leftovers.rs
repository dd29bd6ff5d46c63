//! Names of the temporary folders of runs, and removal of those that killed runs left behind.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// A temporary folder without writes for this long belongs to a dead run.
const ABANDONED: Duration = Duration::from_secs(7 * 24 * 3600);

/// Returns `.NAME.PID.KIND`: a temporary folder of this process beside NAME.
pub(super) fn hidden(name: &OsStr, kind: &str) -> OsString {
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(format!(".{}.{kind}", std::process::id()));
    hidden
}

/// Returns `NAME.live-PID`, which no other run removes.
pub(super) fn growing(name: &OsStr) -> OsString {
    let mut growing = name.to_owned();
    growing.push(format!(".live-{}", std::process::id()));
    growing
}

/// Returns `NAME.unplaced-PID`.
pub(super) fn rescued(name: &OsStr) -> OsString {
    let mut rescued = name.to_owned();
    rescued.push(format!(".unplaced-{}", std::process::id()));
    rescued
}

/// Removes the temporary folders of killed runs to `NAME`, and restores an earlier run that one of them had moved away.
pub(super) fn sweep(folder: &Path, name: &OsStr, out: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())) {
        let path = entry.path();
        match abandoned(&entry.file_name(), name, &path) {
            Some("old") if !out.exists() && fs::rename(&path, out).is_ok() => (),
            // A folder that cannot be removed does no harm.
            Some(_) => drop(fs::remove_dir_all(&path)),
            None => (),
        }
    }
}

/// Returns the kind of a temporary folder if it belongs to a dead run to `name`.
fn abandoned(found: &OsStr, name: &OsStr, path: &Path) -> Option<&'static str> {
    let rest = found.as_encoded_bytes().strip_prefix(b".")?.strip_prefix(name.as_encoded_bytes())?;
    let rest = std::str::from_utf8(rest.strip_prefix(b".")?).ok()?;
    let (process, kind) = rest.split_once('.')?;
    let kind = ["tmp", "old"].into_iter().find(|k| *k == kind)?;
    let process: u32 = process.parse().ok()?;
    // Process ids are reused: a folder with our id is left over, because this process has made none yet.
    (process == std::process::id() || !is_running(process) || untouched(path)).then_some(kind)
}

#[cfg(any(target_os = "linux", target_os = "macos"))]
fn is_running(process: u32) -> bool {
    use rustix::process::{Pid, test_kill_process};
    let pid = i32::try_from(process).ok().and_then(Pid::from_raw);
    pid.is_some_and(|pid| test_kill_process(pid) != Err(rustix::io::Errno::SRCH))
}

/// Process ids cannot be checked here; only the folder's age decides.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn is_running(_: u32) -> bool {
    true
}

/// Returns whether a folder has had no writes for a long time.
fn untouched(folder: &Path) -> bool {
    let time = |path: &Path| fs::metadata(path).and_then(|m| m.modified()).ok();
    let inside = fs::read_dir(folder).into_iter().flatten().flatten().filter_map(|entry| time(&entry.path()));
    let last = inside.chain(time(folder)).max();
    last.and_then(|last| SystemTime::now().duration_since(last).ok()).is_some_and(|age| age > ABANDONED)
}
