//! The folder of a run's results: they appear whole, all at once, and only where there are some.
//!
//! A run writes into a folder of its own beside the one asked for. At the end the two change places in one step, where the
//! folder holds nothing but an earlier run; where it holds other files too, the results are moved in one by one. `run.json`
//! lists the files that a run made: no other file is ever replaced or removed, but those that the new run writes. It says how the
//! run ended, too: what was tracked until then is kept of a run that was stopped or broke off.

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

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Ended {
    /// It did all that it was asked for.
    Finished,
    /// It was asked to stop.
    Stopped,
    /// The video broke off, or a file could not be written.
    Error,
}

/// What a run left in its folder.
#[derive(Serialize, Deserialize)]
struct Manifest {
    program: String,
    /// False while the files of a new run are moved in: then those of two runs may lie here.
    complete: bool,
    #[serde(default)]
    ended: Option<Ended>,
    /// How many frames it tracked in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
    /// In how many frames of the source the decoder reported damage.
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

/// Whether a folder holds a run that did all that it was asked for.
pub(super) fn is_finished(folder: &Path) -> bool {
    manifest(folder).is_some_and(|run| run.complete && run.ended.is_none_or(|ended| ended == Ended::Finished))
}

/// The results of a run in the making. Dropped before [`Results::keep`], they leave nothing behind.
pub(super) struct Results {
    /// Where they are to be, as it was asked for and as it is.
    asked: PathBuf,
    out: PathBuf,
    /// Where they are written.
    part: PathBuf,
    /// Folders that had to be made for it, the outermost first.
    made: Vec<PathBuf>,
    names: Vec<String>,
    ended: (Ended, usize),
    damaged: u64,
    kept: bool,
}

impl Results {
    /// Begins results that will be `names` in the folder `out`, which stays as it is until they are kept. Fails where the
    /// folder cannot be made or written, a result could not get its name, or one of the `inputs` would be replaced or removed.
    pub(super) fn begin(out: &Path, names: &[&str], inputs: &[&Path]) -> Result<Self> {
        Self::begin_in(out, names, inputs, |name| hidden(name, "tmp"))
    }

    /// [`Results::begin`] of a run without an end: meanwhile its files are in a folder that anybody may read, `OUT.live-PID`, and
    /// stay there where the run is killed.
    pub(super) fn begin_live(out: &Path, names: &[&str], inputs: &[&Path]) -> Result<Self> {
        Self::begin_in(out, names, inputs, growing)
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
        // Beside the folder; in it, where that is not allowed.
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
            ended: (Ended::Error, 0),
            damaged: 0,
            kept: false,
        })
    }

    /// Where to write.
    pub(super) fn folder(&self) -> &Path {
        &self.part
    }

    /// Puts the results of a run that ended so, after so many frames, in their place; answers their paths. Where one is missing, or they
    /// cannot be moved, the folder stays as it was and they are kept beside it, under a name that the error tells. So it is where some
    /// were lost, as the error `lost` says, and the folder holds a finished run.
    pub(super) fn keep(mut self, ended: Ended, frames: usize, lost: Result<()>) -> Result<Vec<PathBuf>> {
        self.ended = (ended, frames);
        let missing = self.names.iter().find(|name| !self.part.join(name).is_file());
        let placed = match (missing, &lost) {
            (Some(name), _) => Err(Error::malformed(self.asked.join(name), "it was not written")),
            (None, Err(error)) if is_finished(&self.out) => {
                // The disk may be full; the files are there with or without their list.
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
                "{error}; {} was left as it was, what was written of this run lies in {}",
                self.asked.display(),
                at.display()
            )));
        }
        lost.map(|()| self.names.iter().map(|name| self.asked.join(name)).collect())
    }

    /// In how many frames of the source the decoder reported damage.
    pub(super) fn set_damaged(&mut self, frames: u64) {
        self.damaged = frames;
    }

    /// An error that names a file of the folder in the making, by the name that it was to have.
    pub(super) fn with_final_path(&self, error: &Error) -> Error {
        let (part, asked) = (self.part.to_string_lossy(), self.asked.to_string_lossy());
        Error::Invalid(error.to_string().replace(&*part, &asked))
    }

    /// Leaves out results that could not be written. False where none is left.
    pub(super) fn leave_out(&mut self, lost: &[&str]) -> bool {
        self.names.retain(|name| !lost.contains(&&**name));
        lost.iter().for_each(|name| drop(fs::remove_file(self.part.join(name))));
        !self.names.is_empty()
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
                // The results are in place; an earlier run that cannot be removed now is removed by the next one.
                let _ = fs::remove_dir_all(old);
                return Ok(());
            }
        }
        self.put_one_by_one()
    }

    /// Beside files that are none of ours. The manifest lists the files of both runs meanwhile, so that the next run knows
    /// them whatever happens.
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
        // One that cannot be removed stays, and is the user's from now on.
        left.into_iter().for_each(|name| drop(fs::remove_file(self.out.join(name))));
        self.list(&self.out, &self.names, true)?;
        let _ = fs::remove_dir_all(&self.part);
        Ok(())
    }
}

impl Drop for Results {
    fn drop(&mut self) {
        if !self.kept {
            let _ = fs::remove_dir_all(&self.part);
            // Those that hold something by now stay.
            self.made.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
        }
    }
}

/// The folder that a folder is in, and its name, links followed.
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

/// A folder whose run.json is none of ours.
fn not_ours(folder: &Path) -> Error {
    let problem = "expected the list of files that a run of foveate writes, found something else; give another --out";
    Error::malformed(folder.join(MANIFEST), problem)
}

/// What an earlier run left in a folder.
fn manifest(folder: &Path) -> Option<Manifest> {
    let text = fs::read_to_string(folder.join(MANIFEST)).ok()?;
    serde_json::from_str::<Manifest>(&text).ok().filter(|manifest| manifest.program.starts_with("foveate "))
}

/// The files that an earlier run in a folder made. A name that is a path, or no file, is none of them.
fn listed(folder: &Path) -> Vec<String> {
    let files = manifest(folder).map_or(vec![], |manifest| manifest.files);
    let plain = |name: &String| Path::new(name).file_name() == Some(OsStr::new(name));
    files
        .into_iter()
        .filter(|name| plain(name) && folder.join(name).symlink_metadata().is_ok_and(|m| m.is_file()))
        .collect()
}

/// Whether a folder holds an earlier run and nothing else.
fn is_ours_alone(folder: &Path) -> bool {
    let ours = listed(folder);
    let Ok(mut entries) = fs::read_dir(folder) else { return false };
    entries.all(|entry| {
        let name = entry.map(|e| e.file_name()).unwrap_or_default();
        name == MANIFEST || ours.iter().any(|file| name == **file)
    })
}

/// Whether the program runs in a folder: then it must not be moved away.
fn holds_this_process(folder: &Path) -> bool {
    let here = std::env::current_dir().and_then(fs::canonicalize);
    here.is_ok_and(|here| here.starts_with(folder))
}

/// Puts one folder in the place of another; answers where the other one is now. `None`: nothing has changed.
fn swap(new: &Path, old: &Path) -> Option<PathBuf> {
    if exchange(new, old) {
        return Some(new.to_owned());
    }
    // A run that is killed between these two is put back by the next one: see `sweep`.
    let away = old.with_file_name(hidden(old.file_name()?, "old"));
    files::rename(old, &away).ok()?;
    if files::rename(new, old).is_err() {
        let _ = fs::rename(&away, old);
        return None;
    }
    Some(away)
}

/// Two folders change their places in one step, where the system can.
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

/// Moves a file to another folder, which may be of another file system.
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
