//! Files that are whole or not there: written under a temporary name beside the final one, then renamed.

pub mod faults;
mod part;

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::{Error, Result};
pub(crate) use part::write as write_some;
pub use part::{Part, create_dir, folder_of, put, rename, settle, sweep, sync_folder, temporary};

/// The most bytes of a model.
pub const MODEL: u64 = 1 << 30;
/// The most bytes of a picture's file.
pub const PICTURE: u64 = 1 << 28;
/// The most bytes of a text: boxes, settings, saved states.
pub const TEXT: u64 = 1 << 28;

/// Writes `bytes` to `path`. Afterwards the file has all of them or is unchanged. A link is kept and points to the
/// new file; a device or a fifo is written to.
///
/// # Errors
/// [`Error::Io`] with `path` if it cannot be written; no partial file is left.
pub fn write(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    whole(path.as_ref(), bytes, Part::beside)
}

/// As [`write()`], for a name that the program makes in a folder of results, in which others may write: a link, fifo or device of that name
/// is replaced.
///
/// # Errors
/// As [`write()`].
pub fn write_inside(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    whole(path.as_ref(), bytes, Part::inside)
}

fn whole(path: &Path, bytes: &[u8], begin: fn(&Path) -> std::io::Result<Part>) -> Result<()> {
    let written = begin(path).and_then(|mut part| part.write_all(bytes).and_then(|()| part.keep()));
    written.map_err(Error::io(path, "cannot write"))
}

/// The bytes of a regular file of at most `most` bytes: a device, a pipe or a folder is none, and is not waited for.
///
/// # Errors
/// [`Error::Io`] with the file if it cannot be read, [`Error::Malformed`] if it is of another kind or larger.
pub fn read(path: impl AsRef<Path>, most: u64) -> Result<Vec<u8>> {
    bytes(path.as_ref(), most)
}

fn bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let found = std::fs::metadata(path).map_err(Error::io(path, "cannot read"))?;
    if !found.is_file() {
        return Err(Error::malformed(path, "not a regular file; copy its content into one"));
    }
    let too_large = |size: u64| {
        Error::malformed(path, format!("it has {size} bytes, more than the {most} that such a file may have"))
    };
    if found.len() > most {
        return Err(too_large(found.len()));
    }
    // It may grow during the read, or have length 0, as files of /proc have.
    let mut bytes = Vec::with_capacity(found.len() as usize);
    let file = std::fs::File::open(path).map_err(Error::io(path, "cannot read"))?;
    std::io::Read::read_to_end(&mut std::io::Read::take(file, most + 1), &mut bytes)
        .map_err(Error::io(path, "cannot read"))?;
    if bytes.len() as u64 > most {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// The text of a regular file of at most `most` bytes, without the byte order mark that spreadsheets put first.
///
/// # Errors
/// As [`read`] and [`text`].
pub fn read_text(path: impl AsRef<Path>, most: u64) -> Result<String> {
    text(path.as_ref(), read(path.as_ref(), most)?)
}

/// The text of these bytes of a file, as [`read_text`] returns it; `path` is for the error.
///
/// # Errors
/// [`Error::Malformed`] with the line if they are not UTF-8.
pub fn text(path: &Path, mut bytes: Vec<u8>) -> Result<String> {
    if bytes.starts_with("\u{feff}".as_bytes()) {
        bytes.drain(.."\u{feff}".len());
    }
    String::from_utf8(bytes).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::malformed(path, format!("line {line}: not UTF-8 text"))
    })
}

/// The source of files: a folder, or [`Nowhere`] in a browser, which has no files.
pub trait Files {
    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::Io`] with the file if it cannot be read.
    fn read(&self, path: &Path) -> Result<Vec<u8>>;
}

/// Files whose names are relative to a folder.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Names relative to this folder.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }
    /// Names relative to the folder that the program runs in.
    pub fn here() -> Self {
        Self(PathBuf::new())
    }
    /// Names relative to the folder that a file is in.
    pub fn of(file: &Path) -> Self {
        Self(file.parent().map(PathBuf::from).unwrap_or_default())
    }
}

impl Files for Folder {
    fn read(&self, path: &Path) -> Result<Vec<u8>> {
        read(self.0.join(path), MODEL)
    }
}

/// No files. Only the models and configurations inside the library are available.
#[derive(Clone, Copy, Debug)]
pub struct Nowhere;

impl Files for Nowhere {
    fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let none = std::io::Error::new(std::io::ErrorKind::NotFound, "no folder was given to read files from");
        Err(Error::io(path, "cannot read")(none))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_a_stated_size_are_read() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.txt");
        std::fs::write(&path, b"12345").expect("a writable folder");
        assert_eq!(read(&path, 5).expect("small enough"), b"12345");
        assert!(read(&path, 4).expect_err("too large").to_string().contains("5 bytes, more than the 4"));
        std::fs::write(&path, b"a\nb\xff").expect("a writable folder");
        assert!(read_text(&path, 5).expect_err("no text").to_string().contains("line 2: not UTF-8"));
        std::fs::write(&path, "\u{feff}ab").expect("a writable folder");
        assert_eq!(read_text(&path, 5).expect("text"), "ab");
        assert!(read(dir.path(), 5).expect_err("a folder").to_string().contains("not a regular file"));
        #[cfg(unix)]
        assert!(read("/dev/zero", 5).expect_err("without end").to_string().contains("not a regular file"));
        assert!(read(dir.path().join("no"), 5).expect_err("missing").to_string().contains("cannot read"));
    }

    #[test]
    fn a_file_is_whole_or_not_there() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.bin");
        write(&path, b"one").expect("a writable folder");
        write(&path, b"two").expect("a writable folder");
        assert_eq!(std::fs::read(&path).expect("just written"), b"two");
        let missing = dir.path().join("no/such/folder.bin");
        assert!(write(&missing, b"x").expect_err("no folder").to_string().contains("folder.bin"));
        std::fs::create_dir(dir.path().join("taken")).expect("a writable folder");
        assert!(write(dir.path().join("taken"), b"x").is_err(), "a folder is not replaced");
        assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 2, "no temporary file stays");
    }
}
