//! The output folder of a run: all results appear together at the end, or none do.
//!
//! A run writes into a new folder beside the output folder. If the output folder holds only an earlier run, the two folders are swapped in
//! one step at the end; if it holds other files, the results are moved in one by one. `run.json` lists the files that a run made. No other
//! file is replaced or removed, except those with the names of new results. `run.json` also states how the run ended. If a run is stopped
//! or fails, the results up to that point are kept.

mod in_place;
mod inputs;
mod leftovers;

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use foveate::{Error, Result, files};
pub(super) use in_place::InPlace;
use inputs::frame_of;
pub(super) use inputs::{spare, writable};
use leftovers::{growing, hidden, rescued, sweep};
use serde::{Deserialize, Serialize};

/// Lists the files of a run.
const MANIFEST: &str = "run.json";
/// Most bytes of it: a run of thousands of sequences lists about a megabyte.
const MOST_MANIFEST: u64 = 16 << 20;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Ended {
    /// All requested work was done.
    Finished,
    /// The run was stopped by a signal.
    Stopped,
    /// The video broke off, or a file could not be written.
    Error,
}

/// The contents of `run.json`.
#[derive(Serialize, Deserialize)]
struct Manifest {
    program: String,
    /// False while the files of a new run are moved in; the folder may then hold files of two runs.
    complete: bool,
    #[serde(default)]
    ended: Option<Ended>,
    /// Number of tracked frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
    /// Number of source frames in which the decoder reported damage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    damaged: Option<u64>,
    files: Vec<String>,
}

impl Manifest {
    fn of(complete: bool, ended: Ended, frames: Option<usize>, files: &[String]) -> Self {
        let program = concat!("foveate ", env!("CARGO_PKG_VERSION")).to_owned();
        Self { program, complete, ended: Some(ended), frames, damaged: None, files: files.to_vec() }
    }

    fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write_inside(folder.join(MANIFEST), (text + "\n").as_bytes())
    }
}

/// Returns whether a folder holds a finished run.
pub(super) fn is_finished(folder: &Path) -> bool {
    manifest(folder).is_some_and(|run| run.complete && run.ended.is_none_or(|ended| ended == Ended::Finished))
}

/// Adds files to those of the run in a folder, so that the next run there replaces or removes them.
pub(super) fn add(folder: &Path, names: &[&str]) -> Result<()> {
    let Some(mut run) = manifest(folder).filter(|run| run.complete) else { return Ok(()) };
    run.files.extend(names.iter().map(|name| (*name).to_owned()));
    run.files.sort();
    run.files.dedup();
    run.write(folder)
}

/// The results of a run in progress. If dropped before [`Results::keep`], they are removed.
pub(super) struct Results {
    /// The output folder, as requested and with links resolved.
    asked: PathBuf,
    out: PathBuf,
    /// The folder to which results are written until they are kept.
    part: PathBuf,
    /// Parent folders that were created for the results, outermost first.
    made: Vec<PathBuf>,
    names: Vec<String>,
    /// Whether the files grow under their final names.
    live: bool,
    ended: (Ended, usize),
    damaged: u64,
    kept: bool,
}

impl Results {
    /// Starts results with these `names` for the folder `out`, which stays unchanged until they are kept. Fails if the folder cannot be
    /// created or written, a result cannot be named, or one of the `inputs` would be replaced or removed.
    pub(super) fn begin(out: &Path, names: &[&str], inputs: &[&Path]) -> Result<Self> {
        Self::begin_in(out, names, inputs, |name| hidden(name, "tmp"))
    }

    /// Starts results as [`Results::begin`] does, for an endless source. Until the end the files are in the readable folder `OUT.live-PID`,
    /// and stay there if the run is killed.
    pub(super) fn begin_live(out: &Path, names: &[&str], inputs: &[&Path]) -> Result<Self> {
        let mut results = Self::begin_in(out, names, inputs, growing)?;
        results.live = true;
        Ok(results)
    }

    fn begin_in(out: &Path, names: &[&str], inputs: &[&Path], part: impl Fn(&OsStr) -> OsString) -> Result<Self> {
        let asked = out.to_owned();
        let (parent, name) = place(out)?;
        let out = parent.join(&name);
        check(&asked, &out, names, inputs)?;
        let made: Vec<PathBuf> = parent.ancestors().take_while(|folder| !folder.exists()).map(PathBuf::from).collect();
        fs::create_dir_all(&parent).map_err(Error::io(&asked, "cannot make the folder for results"))?;
        let part = part(&name);
        sweep(&parent, &name, &out);
        sweep(&out, &name, &out);
        files::sweep(&out);
        // The folder lies beside the output folder, or inside it if that is not permitted.
        let part = match files::create_dir(&parent.join(&part)) {
            Ok(()) => parent.join(&part),
            Err(_) if out.is_dir() => {
                files::create_dir(&out.join(&part))
                    .map_err(Error::io(&asked, "cannot write to the folder for results"))?;
                out.join(&part)
            }
            Err(e) => return Err(Error::io(&asked, "cannot make the folder for results")(e)),
        };
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        Ok(Self {
            asked,
            out,
            part,
            made: made.into_iter().rev().collect(),
            names,
            live: false,
            ended: (Ended::Error, 0),
            damaged: 0,
            kept: false,
        })
    }

    /// Returns the folder to write to.
    pub(super) fn folder(&self) -> &Path {
        &self.part
    }

    /// Moves the results of a run with this ending and number of frames into place. Returns their paths. If a result is missing or cannot
    /// be moved, the folder stays unchanged, and the results are kept beside it under a name that the error states. The same happens if
    /// some results were `lost` and the folder holds a finished run.
    pub(super) fn keep(mut self, ended: Ended, frames: usize, lost: Option<&Error>) -> Result<Vec<PathBuf>> {
        self.ended = (ended, frames);
        let missing = self.names.iter().find(|name| !self.part.join(name).is_file());
        let placed = match (missing, lost) {
            (Some(name), _) => Err(Error::malformed(self.asked.join(name), "it was not written")),
            (None, Some(error)) if is_finished(&self.out) => {
                // The disk may be full; the files are kept with or without their list.
                let _ = self.list(&self.part, &self.names, true);
                Err(Error::Invalid(format!("{error}; run it again when the cause is gone, or give another --out")))
            }
            (None, _) => self.list(&self.part, &self.names, true).and_then(|()| self.put()),
        };
        self.kept = true;
        if let Err(error) = placed {
            let error = self.with_final_path(&error);
            let rescue = self.part.with_file_name(rescued(self.out.file_name().unwrap_or_default()));
            let at = if files::rename(&self.part, &rescue).is_ok() { &rescue } else { &self.part };
            return Err(Error::Invalid(format!(
                "{error}; {} is unchanged, the files of this run are in {}",
                self.asked.display(),
                at.display()
            )));
        }
        Ok(self.names.iter().map(|name| self.asked.join(name)).collect())
    }

    /// Sets the number of source frames in which the decoder reported damage.
    pub(super) fn set_damaged(&mut self, frames: u64) {
        self.damaged = frames;
    }

    /// Replaces the path of a file in the temporary folder by its final path in an error.
    pub(super) fn with_final_path(&self, error: &Error) -> Error {
        let (part, asked) = (self.part.to_string_lossy(), self.asked.to_string_lossy());
        Error::Invalid(error.to_string().replace(&*part, &asked))
    }

    /// Leaves out results that could not be written to their end. Keeps and returns those of a live run that have a beginning.
    pub(super) fn leave_out<'a>(&mut self, failed: &[&'a str]) -> Vec<&'a str> {
        let begun = |name: &str| fs::metadata(self.part.join(name)).is_ok_and(|file| file.len() > 0);
        let (cut, lost): (Vec<&str>, Vec<&str>) = failed.iter().partition(|name| self.live && begun(name));
        self.names.retain(|name| !lost.contains(&&**name));
        lost.iter().for_each(|name| drop(fs::remove_file(self.part.join(name))));
        cut
    }

    /// Returns whether no result is left.
    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    fn list(&self, folder: &Path, names: &[String], complete: bool) -> Result<()> {
        let (ended, frames) = self.ended;
        let damaged = Some(self.damaged).filter(|n| *n > 0);
        Manifest { damaged, ..Manifest::of(complete, ended, Some(frames), names) }.write(folder)
    }

    fn put(&self) -> Result<()> {
        if !self.out.exists() && files::rename(&self.part, &self.out).is_ok() {
            files::sync_folder(&self.out);
            return Ok(());
        }
        if self.part.parent() == self.out.parent() && is_ours_alone(&self.out) && !holds_this_process(&self.out) {
            if let Ok(of) = fs::metadata(&self.out) {
                let _ = fs::set_permissions(&self.part, of.permissions());
            }
            if let Some(old) = swap(&self.part, &self.out) {
                files::sync_folder(&self.out);
                // The results are in place. If the earlier run cannot be removed now, the next run removes it.
                let _ = fs::remove_dir_all(old);
                return Ok(());
            }
        }
        self.put_one_by_one()
    }

    /// Moves the results in beside files that do not belong to a run. Meanwhile the manifest lists the files of both runs, so that the next
    /// run recognises them after an interruption.
    fn put_one_by_one(&self) -> Result<()> {
        fs::create_dir_all(&self.out).map_err(Error::io(&self.asked, "cannot make the folder for results"))?;
        let earlier = listed(&self.out);
        let left: Vec<&String> = earlier.iter().filter(|name| !self.names.contains(name)).collect();
        let both: Vec<String> = self.names.iter().chain(left.iter().copied()).cloned().collect();
        self.list(&self.out, &both, false)?;
        for name in &self.names {
            let to = self.out.join(name);
            moved(&self.part.join(name), &to).map_err(Error::io(self.asked.join(name), "cannot write"))?;
        }
        // A file that cannot be removed stays and no longer belongs to a run.
        left.into_iter().for_each(|name| drop(fs::remove_file(self.out.join(name))));
        self.list(&self.out, &self.names, true)?;
        let _ = fs::remove_dir_all(&self.part);
        Ok(())
    }
}

impl Drop for Results {
    fn drop(&mut self) {
        // A fault of the program ends an endless run, too: its files stay.
        let stays = self.kept || (self.live && std::thread::panicking());
        if !stays {
            let _ = fs::remove_dir_all(&self.part);
            // Folders that are no longer empty stay.
            self.made.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
        }
    }
}

/// Returns the parent folder and the name of a folder, with links resolved.
fn place(out: &Path) -> Result<(PathBuf, OsString)> {
    let cannot = "cannot find the folder for results";
    let whole = match fs::symlink_metadata(out) {
        Ok(_) => fs::canonicalize(out).map_err(Error::io(out, cannot))?,
        Err(_) => std::path::absolute(out).map_err(Error::io(out, cannot))?,
    };
    let nowhere =
        || Error::Invalid(format!("{}: expected a folder for results, with a name; give another --out", out.display()));
    let name = whole.file_name().ok_or_else(nowhere)?.to_owned();
    let parent = whole.parent().ok_or_else(nowhere)?;
    Ok((fs::canonicalize(parent).unwrap_or_else(|_| parent.to_owned()), name))
}

fn check(asked: &Path, out: &Path, names: &[&str], inputs: &[&Path]) -> Result<()> {
    if out.exists() && !out.is_dir() {
        return Err(Error::malformed(asked, "expected a folder for results, found a file; give another --out"));
    }
    if let Some(name) = names.iter().chain([&MANIFEST]).find(|name| out.join(name).is_dir()) {
        let problem = "expected a file of an earlier run or nothing, found a folder; give another --out";
        return Err(Error::malformed(asked.join(name), problem));
    }
    if fs::metadata(out).is_ok_and(|of| of.permissions().readonly()) {
        return Err(Error::malformed(
            asked,
            "the folder is write-protected; give another --out, or allow writing to it",
        ));
    }
    if out.join(MANIFEST).exists() && manifest(out).is_none() {
        return Err(not_ours(asked));
    }
    if let Some((name, source)) = names.iter().find_map(|name| Some((name, frame_of(&out.join(name), inputs)?))) {
        let problem = format!("it would become a frame of {}; give another --out", source.display());
        return Err(Error::malformed(asked.join(name), problem));
    }
    let earlier = listed(out);
    for input in inputs {
        let inside = fs::canonicalize(input).ok().filter(|path| path.is_file() && path.parent() == Some(out));
        let Some(name) = inside.as_deref().and_then(Path::file_name).map(OsStr::to_string_lossy) else { continue };
        if names.contains(&&*name) || earlier.iter().any(|e| *e == *name) {
            let problem = format!("it is read, and would be replaced or removed as a result in {}", asked.display());
            return Err(Error::malformed(*input, problem + "; give another --out"));
        }
    }
    Ok(())
}

/// Returns the error for a folder with a foreign run.json.
fn not_ours(folder: &Path) -> Error {
    let problem = "expected the list of files that a run of foveate writes, found something else; give another --out";
    Error::malformed(folder.join(MANIFEST), problem)
}

/// Reads the manifest of the earlier run in a folder.
fn manifest(folder: &Path) -> Option<Manifest> {
    let text = files::read_text(folder.join(MANIFEST), MOST_MANIFEST).ok()?;
    serde_json::from_str::<Manifest>(&text).ok().filter(|manifest| manifest.program.starts_with("foveate "))
}

/// Returns the files of the earlier run in a folder. Skips names that are paths or not files.
fn listed(folder: &Path) -> Vec<String> {
    let files = manifest(folder).map_or(vec![], |manifest| manifest.files);
    let plain = |name: &String| Path::new(name).file_name() == Some(OsStr::new(name));
    files
        .into_iter()
        .filter(|name| plain(name) && folder.join(name).symlink_metadata().is_ok_and(|m| m.is_file()))
        .collect()
}

/// Returns whether a folder holds an earlier run and nothing else.
fn is_ours_alone(folder: &Path) -> bool {
    let ours = listed(folder);
    let Ok(mut entries) = fs::read_dir(folder) else { return false };
    entries.all(|entry| {
        let name = entry.map(|e| e.file_name()).unwrap_or_default();
        name == MANIFEST || ours.iter().any(|file| name == **file)
    })
}

/// Returns whether the process runs in a folder, which therefore must not be moved.
fn holds_this_process(folder: &Path) -> bool {
    let here = std::env::current_dir().and_then(fs::canonicalize);
    here.is_ok_and(|here| here.starts_with(folder))
}

/// Replaces one folder by another. Returns the new path of the replaced folder, or `None` if nothing has changed.
fn swap(new: &Path, old: &Path) -> Option<PathBuf> {
    if exchange(new, old) {
        return Some(new.to_owned());
    }
    // If the process is killed between these two steps, the next run restores the earlier run: see `sweep`.
    let away = old.with_file_name(hidden(old.file_name()?, "old"));
    files::rename(old, &away).ok()?;
    if files::rename(new, old).is_err() {
        let _ = fs::rename(&away, old);
        return None;
    }
    Some(away)
}

/// Swaps two folders in one step, if the system supports it.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn exchange(a: &Path, b: &Path) -> bool {
    use foveate::files::faults::{Operation, attempt};
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    attempt(Operation::Rename, b).is_ok() && renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE).is_ok()
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn exchange(_: &Path, _: &Path) -> bool {
    false
}

/// Moves a file to another folder, possibly on another file system.
fn moved(from: &Path, to: &Path) -> std::io::Result<()> {
    if files::rename(from, to).is_ok() {
        return Ok(());
    }
    let mut part = files::Part::inside(to)?;
    std::io::copy(&mut fs::File::open(from)?, &mut part)?;
    part.keep()
}

#[cfg(test)]
mod tests;
