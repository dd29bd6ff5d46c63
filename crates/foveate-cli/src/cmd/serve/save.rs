//! Folders for results.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use foveate::{Error, Result};

/// Creates a temporary folder for results, readable only by this user.
pub(super) fn scratch() -> Result<PathBuf> {
    static NUMBER: AtomicUsize = AtomicUsize::new(0);
    let builder = || {
        let mut builder = std::fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        builder
    };
    loop {
        let number = NUMBER.fetch_add(1, Ordering::SeqCst);
        let folder = std::env::temp_dir().join(format!("foveate-serve-{}-{number}", std::process::id()));
        match builder().create(&folder) {
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists && number < 10_000 => {}
            made => {
                return made.map(|()| folder.clone()).map_err(Error::io(folder, "cannot make a folder for results"));
            }
        }
    }
}
