//! A file that appears when it is whole: written under a temporary name beside its place, renamed at the end.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use crate::files::temporary;
use crate::{Error, Result};

/// A text file in the making. Dropped before [`Sink::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Sink {
    path: PathBuf,
    temporary: PathBuf,
    out: Option<Out>,
}

#[derive(Debug)]
enum Out {
    File(BufWriter<File>),
    Memory(Memory),
}

/// Bytes in memory in the place of a file, for where there are no files. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<Vec<u8>>>);

impl Memory {
    /// What was written since this was called last.
    pub fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Memory(memory) => memory.write(bytes),
        }
    }
    fn flush(&mut self) -> std::io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Memory(_) => Ok(()),
        }
    }
}

impl Sink {
    /// Starts a file that will be `path`. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        let temporary = temporary(&path);
        let file = File::create(&temporary).map_err(Error::io(&path, "cannot write"))?;
        Ok(Self { path, temporary, out: Some(Out::File(BufWriter::new(file))) })
    }

    /// Starts a file that has its name from the beginning and grows with every flush: for runs without an end, whose results are to
    /// be read meanwhile, and after the program was killed. Fails where its folder cannot be written.
    pub fn grow(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        let file = File::create(&path).map_err(Error::io(&path, "cannot write"))?;
        Ok(Self { temporary: path.clone(), path, out: Some(Out::File(BufWriter::new(file))) })
    }

    /// Writes to memory; `name` stands for the file in errors.
    pub fn memory(name: impl Into<PathBuf>, memory: Memory) -> Self {
        let path = name.into();
        Self { temporary: path.clone(), path, out: Some(Out::Memory(memory)) }
    }

    /// Adds to the file.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        match &mut self.out {
            Some(out) => out.write_all(bytes).map_err(Error::io(&self.path, "cannot write")),
            None => Err(Error::Invalid(format!("{}: already finished, nothing can be added", self.path.display()))),
        }
    }

    /// Hands what was added to the operating system, so that it outlives this program.
    pub fn flush(&mut self) -> Result<()> {
        self.out.as_mut().map_or(Ok(()), Write::flush).map_err(Error::io(&self.path, "cannot write"))
    }

    /// Gives the file its name. Finishing twice is finishing once.
    pub fn finish(&mut self) -> Result<()> {
        let Some(mut out) = self.out.take() else { return Ok(()) };
        if self.temporary == self.path {
            return out.flush().map_err(Error::io(&self.path, "cannot write"));
        }
        let written = out.flush().and_then(|()| std::fs::rename(&self.temporary, &self.path));
        if written.is_err() {
            // The file is not whole: the reason below is worth more than a second one.
            let _ = std::fs::remove_file(&self.temporary);
        }
        written.map_err(Error::io(&self.path, "cannot write"))
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        if self.out.take().is_some() && self.temporary != self.path {
            let _ = std::fs::remove_file(&self.temporary);
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
        assert_eq!(std::fs::read_to_string(&sink.temporary).expect("what was flushed"), "new");
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
    fn memory_stands_for_a_file() {
        let memory = Memory::default();
        let mut sink = Sink::memory("a.txt", memory.clone());
        sink.write(b"one").expect("bytes");
        assert_eq!((memory.take(), memory.take()), (b"one".to_vec(), vec![]));
        sink.write(b"two").expect("bytes");
        sink.finish().expect("finished");
        assert!(sink.write(b"more").is_err());
        assert_eq!(memory.take(), b"two");
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
