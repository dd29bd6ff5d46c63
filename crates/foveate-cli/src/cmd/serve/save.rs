//! Folders for results.

use std::path::PathBuf;

use foveate::{Error, Result, files};

/// Creates a temporary folder for results, readable only by this user. Removes those of killed servers.
pub(super) fn scratch() -> Result<PathBuf> {
    let place = std::env::temp_dir();
    files::sweep(&place);
    let folder = files::temporary(&place.join("foveate-serve"));
    #[cfg_attr(not(unix), expect(unused_mut, reason = "the mode is set on Unix"))]
    let mut builder = std::fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(&folder).map_err(Error::io(&folder, "cannot make a folder for results"))?;
    Ok(folder)
}
