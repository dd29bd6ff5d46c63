//! A file that appears when it is whole: written under a temporary name beside its place, renamed at the end.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::files::faults::{Operation, attempt};
use crate::files::{Part, write_some};
use crate::{Error, Result};

/// A text file in the making. Dropped before [`Sink::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Sink {
    path: PathBuf,
    file: Option<BufWriter<Target>>,
}

/// The destination of the writes.
#[derive(Debug)]
enum Target {
    Part(Part),
    Growing(Growing),
    Memory(Memory),
}

/// A file of lines under its final name.
#[derive(Debug)]
struct Growing {
    file: File,
    path: PathBuf,
    /// Bytes written, and those of them up to the end of the last line.
    written: u64,
    lines: u64,
}

impl Growing {
    /// Writes what waited when the last write failed. If that fails again, cuts the file off after its last whole line.
    fn end(mut self, waiting: &[u8]) -> io::Result<()> {
        self.file.set_len(self.written)?;
        self.file.seek(SeekFrom::Start(self.written))?;
        self.write_all(waiting).or_else(|_| self.file.set_len(self.lines))
    }
}

impl Write for Growing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = write_some(&mut self.file, &self.path, bytes)?;
        if let Some(end) = bytes[..count].iter().rposition(|byte| *byte == b'\n') {
            self.lines = self.written + end as u64 + 1;
        }
        self.written += count as u64;
        Ok(count)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Bytes in memory instead of a file, for systems without files. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<Vec<u8>>>);

impl Memory {
    /// The bytes written since the last call.
    pub fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Part(part) => part.write(bytes),
            Self::Growing(growing) => growing.write(bytes),
            Self::Memory(memory) => memory.write(bytes),
        }
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Target {
    fn finish(self, path: &Path) -> io::Result<()> {
        match self {
            Self::Part(part) => part.keep(),
            Self::Growing(growing) => {
                attempt(Operation::Sync, path)?;
                growing.file.sync_data()
            }
            Self::Memory(_) => Ok(()),
        }
    }
}

impl Sink {
    /// Creates a temporary file that becomes `path`. Fails if the folder is not writable.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        let part = Part::beside(&path).map_err(Error::io(&path, "cannot write"))?;
        Ok(Self { path, file: Some(BufWriter::new(Target::Part(part))) })
    }

    /// Creates a file under its final name that grows with every flush. For endless runs whose results are read
    /// meanwhile or after a kill. Fails if the folder is not writable.
    pub fn grow(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        let file = attempt(Operation::Open, &path).and_then(|()| File::create(&path));
        let file = file.map_err(Error::io(&path, "cannot write"))?;
        let growing = Growing { file, path: path.clone(), written: 0, lines: 0 };
        Ok(Self { file: Some(BufWriter::new(Target::Growing(growing))), path })
    }

    /// Writes to memory; `name` stands for the file in errors.
    pub fn memory(name: impl Into<PathBuf>, memory: Memory) -> Self {
        Self { path: name.into(), file: Some(BufWriter::new(Target::Memory(memory))) }
    }

    /// Adds to the file.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        match &mut self.file {
            Some(file) => file.write_all(bytes).map_err(Error::io(&self.path, "cannot write")),
            None => Err(Error::Invalid(format!("{}: already finished, nothing can be added", self.path.display()))),
        }
    }

    /// Passes new bytes to the operating system, so that they survive the end of this program.
    pub fn flush(&mut self) -> Result<()> {
        self.file.as_mut().map_or(Ok(()), BufWriter::flush).map_err(Error::io(&self.path, "cannot write"))
    }

    /// Gives the file its name. Finishing twice is finishing once.
    pub fn finish(&mut self) -> Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        // A part that is not whole is gone when it is dropped.
        let whole = file.into_inner().map_err(io::IntoInnerError::into_error);
        whole.and_then(|target| target.finish(&self.path)).map_err(Error::io(&self.path, "cannot write"))
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        // What waits to be written to a part would be written for nothing.
        if let Some(file) = self.file.take() {
            let (target, waiting) = file.into_parts();
            if let (Target::Growing(growing), Ok(bytes)) = (target, waiting) {
                // The error of the write before was reported.
                let _ = growing.end(&bytes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("the folder is there");
        entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "old").expect("a file");
        let mut sink = Sink::create(&path).expect("a sink");
        sink.write(b"new").expect("bytes");
        sink.flush().expect("flushed");
        assert_eq!(std::fs::read_to_string(&path).expect("still the old one"), "old");
        let other = names(folder.path()).into_iter().find(|name| name != "a.txt").expect("a temporary name");
        assert_eq!(std::fs::read_to_string(folder.path().join(other)).expect("what was flushed"), "new");
        sink.finish().expect("renamed");
        sink.finish().expect("again is nothing");
        assert!(sink.write(b"more").is_err());
        drop(sink);
        assert_eq!(std::fs::read_to_string(&path).expect("the new one"), "new");

        drop(Sink::create(folder.path().join("b.txt")).expect("a sink"));
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_file_that_grows_is_there_whatever_happens() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        let mut sink = Sink::grow(&path).expect("a sink");
        sink.write(b"one\n").expect("bytes");
        sink.flush().expect("flushed");
        assert_eq!(std::fs::read_to_string(&path).expect("what was flushed"), "one\n");
        drop(sink);
        assert_eq!(std::fs::read_to_string(&path).expect("still there"), "one\n");
        let mut sink = Sink::grow(&path).expect("a sink");
        sink.write(b"two\n").expect("bytes");
        sink.finish().expect("finished");
        assert_eq!(std::fs::read_to_string(&path).expect("the new one"), "two\n");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let error = Sink::create(folder.path().join("missing/boxes.txt")).expect_err("no such folder").to_string();
        assert!(error.contains("boxes.txt") && error.contains("cannot write"), "{error}");
        // The place is taken by a folder: the rename fails, and nothing half-made stays.
        let taken = folder.path().join("taken.txt");
        std::fs::create_dir_all(taken.join("inside")).expect("a folder");
        let mut sink = Sink::create(&taken).expect("a sink");
        sink.write(b"text").expect("bytes");
        assert!(sink.finish().is_err());
        assert_eq!(names(folder.path()), ["taken.txt"]);
    }
}
