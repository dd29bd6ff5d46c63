//! Checks of output files before the work begins: whether they can be written, and that they replace no input.

use std::fs;
use std::path::{Path, PathBuf};

use foveate::files::folder_of;
use foveate::video::folder::{image_files, is_image};
use foveate::{Error, Result};

/// Refuses an output file that is a folder or that lies in a missing folder.
pub(crate) fn writable(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::malformed(path, "expected a file to write to, found a folder; give another name"));
    }
    let folder = folder_of(path);
    if folder.is_dir() {
        return Ok(());
    }
    Err(Error::malformed(path, format!("there is no folder {} to write it to; make it first", folder.display())))
}

/// Refuses an output file that is one of the `inputs` or would become a frame of one.
pub(crate) fn spare(path: &Path, inputs: &[&Path]) -> Result<()> {
    let whole = whole(path);
    if inputs.iter().any(|input| fs::canonicalize(input).ok() == whole && whole.is_some()) {
        return Err(Error::malformed(path, "it is read, and would be replaced; give another name"));
    }
    match frame_of(path, inputs) {
        Some(source) => {
            let problem =
                format!("it would become a frame of {}, which is read; give another folder", source.display());
            Err(Error::malformed(path, problem))
        }
        None => Ok(()),
    }
}

/// Returns the folder of images, among the `inputs`, to which the file would add a frame.
pub(super) fn frame_of<'a>(path: &Path, inputs: &[&'a Path]) -> Option<&'a Path> {
    let whole = whole(path).filter(|path| is_image(path))?;
    let holds = |input: &&&Path| {
        let frames = if input.is_dir() { image_files(input).unwrap_or_default() } else { vec![] };
        frames.first().is_some_and(|first| fs::canonicalize(folder_of(first)).ok().as_deref() == whole.parent())
    };
    inputs.iter().find(holds).copied()
}

/// Returns the path of an existing or future file, with links resolved.
fn whole(path: &Path) -> Option<PathBuf> {
    let new = || Some(fs::canonicalize(folder_of(path)).ok()?.join(path.file_name()?));
    fs::canonicalize(path).ok().or_else(new)
}
