//! A temporary file with a random name that replaces another file once it is complete.

use std::collections::HashSet;
use std::fs::File;
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher, RandomState};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use super::faults::{Operation, attempt};

/// Files that a process of another system or user left are litter from this age on: a process that is not visible here, in another
/// container, writes more often.
const ABANDONED: Duration = Duration::from_secs(60);
/// The same where it is not known which processes run.
const LONG_ABANDONED: Duration = Duration::from_secs(24 * 3600);
/// Bytes of a final name that go into a temporary one.
const SHOWN: usize = 80;

/// The most links that lead from one to the next, as Linux has it.
const LINKS: usize = 40;

/// A file under a temporary name. Dropped before [`Part::keep`], it is gone.
///
/// For a name that the user gave ([`Part::beside`]), a link is kept and its target is written; a device or a fifo is
/// written to, not replaced. In a folder of results ([`Part::inside`]), which others may write to, both are replaced.
#[derive(Debug)]
pub struct Part {
    path: PathBuf,
    file: Option<File>,
    /// The final name; `None` if an existing device or fifo is written to.
    to: Option<PathBuf>,
}

/// A unique, random name in the folder of `path` for its temporary file: `.NAME.PROCESS-RANDOM.tmp`.
pub fn temporary(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let random = RandomState::new().hash_one((count, SystemTime::now())) as u32;
    let mut name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    name.truncate(name.floor_char_boundary(SHOWN));
    path.with_file_name(format!(".{name}.{}-{:08x}{random:08x}.tmp", std::process::id(), system()))
}

/// This boot of the system, its numbers of processes, and this user: of a process of the same three it is known whether it runs.
fn system() -> u32 {
    static SYSTEM: LazyLock<u32> = LazyLock::new(|| {
        let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id");
        let processes = std::fs::read_link("/proc/self/ns/pid");
        match (boot, processes, user()) {
            (Ok(boot), Ok(processes), Some(user)) => {
                BuildHasherDefault::<DefaultHasher>::default().hash_one((boot, processes, user)) as u32
            }
            _ => RandomState::new().hash_one(0) as u32,
        }
    });
    *SYSTEM
}

#[cfg(unix)]
fn user() -> Option<u32> {
    std::fs::metadata("/proc/self").ok().map(|about| std::os::unix::fs::MetadataExt::uid(&about))
}

#[cfg(not(unix))]
fn user() -> Option<u32> {
    None
}

impl Part {
    /// Creates an empty file in the folder of `path`; never reuses an existing file. For a fifo it waits for a
    /// reader.
    ///
    /// # Errors
    /// Fails if the folder cannot be written.
    pub fn beside(path: &Path) -> io::Result<Self> {
        let no_file = std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir());
        // Standard output may be a file, which has more than this.
        if no_file || path.starts_with("/dev") {
            attempt(Operation::Open, path)?;
            let file = File::options().append(true).open(path)?;
            return Ok(Self { path: path.to_owned(), file: Some(file), to: None });
        }
        Self::inside(&followed(path))
    }

    /// The same for a name that the program makes in a folder of results: a link, fifo or device of that name is replaced.
    ///
    /// # Errors
    /// Fails if the folder cannot be written.
    pub fn inside(path: &Path) -> io::Result<Self> {
        let part = temporary(path);
        sweep(folder_of(&part));
        attempt(Operation::Open, path)?;
        let file = File::options().write(true).create_new(true).open(&part)?;
        Ok(Self { path: part, file: Some(file), to: Some(path.to_owned()) })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Syncs the file to disk and renames it to its final name.
    ///
    /// # Errors
    /// Fails if either fails: the file of that name is then unchanged, and this one is removed.
    pub fn keep(mut self) -> io::Result<()> {
        let Some(path) = &self.to else { return Ok(()) };
        attempt(Operation::Sync, path)?;
        if let Some(file) = &self.file {
            file.sync_data()?;
        }
        rename(&self.path, path)?;
        self.file = None;
        sync_folder(path);
        Ok(())
    }
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(file) = &mut self.file else { return Err(io::ErrorKind::InvalidInput.into()) };
        write(file, &self.path, bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if self.file.take().is_some() && self.to.is_some() {
            // It is not whole; a later run removes the rest.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// The target of a name after all links; it need not exist.
fn followed(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        let Ok(to) = std::fs::read_link(&path) else { break };
        path = folder_of(&path).join(to);
    }
    path
}

/// Writes some of `bytes`; half of them if a test configured a failure.
pub(crate) fn write(file: &mut File, path: &Path, bytes: &[u8]) -> io::Result<usize> {
    if let Err(error) = attempt(Operation::Write, path) {
        file.write_all(&bytes[..bytes.len() / 2])?;
        return Err(error);
    }
    file.write(bytes)
}

/// Renames a file or folder.
///
/// # Errors
/// As [`std::fs::rename`].
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    attempt(Operation::Rename, to)?;
    std::fs::rename(from, to)
}

/// Creates a folder that must not exist, and removes temporary folders of killed processes beside it.
///
/// # Errors
/// As [`std::fs::create_dir`].
pub fn create_dir(path: &Path) -> io::Result<()> {
    sweep(folder_of(path));
    attempt(Operation::Open, path)?;
    std::fs::create_dir(path)
}

/// Syncs the folder of `path`, if the system supports it. Without this, a loss of power may undo a rename.
pub fn sync_folder(path: &Path) {
    if cfg!(unix) {
        // Some file systems cannot, and some folders may be written but not read.
        let _ = File::open(folder_of(path)).and_then(|folder| folder.sync_all());
    }
}

/// The folder of a file; the current one if the path has none.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a file in a temporary folder that is renamed later, once it is complete: see [`settle`].
///
/// # Errors
/// As [`std::fs::write`].
pub fn put(path: &Path, bytes: &[u8]) -> io::Result<()> {
    attempt(Operation::Open, path)?;
    let mut file = File::create(path)?;
    let mut left = bytes;
    while !left.is_empty() {
        left = &left[write(&mut file, path, left)?..];
    }
    Ok(())
}

/// Syncs all files below a folder at once. For thousands of files this takes half the time of one sync each.
///
/// # Errors
/// Fails if it cannot be read, or a file not be written.
pub fn settle(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => settle(&entry.path())?,
            false => {
                attempt(Operation::Sync, &entry.path())?;
                File::open(entry.path())?.sync_data()?;
            }
        }
    }
    Ok(())
}

/// Removes the temporary files and folders that killed processes left in a folder; once for each folder.
pub fn sweep(folder: &Path) {
    static SWEPT: Mutex<Option<HashSet<PathBuf>>> = Mutex::new(None);
    let mut swept = SWEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if !swept.get_or_insert_default().insert(folder.to_owned()) {
        return;
    }
    drop(swept);
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let (name, path) = (entry.file_name(), entry.path());
        let Some((process, system)) = name.to_str().and_then(writer) else { continue };
        let is_left = || match is_running(process) {
            Some(running) => !running && (system == self::system() || is_old(&path, ABANDONED)),
            None => process != std::process::id() && is_old(&path, LONG_ABANDONED),
        };
        // Files that cannot be removed do no harm; links and devices were not made here.
        let _ = match entry.file_type() {
            Ok(kind) if kind.is_file() && is_left() => std::fs::remove_file(path),
            Ok(kind) if kind.is_dir() && is_left() => std::fs::remove_dir_all(path),
            _ => continue,
        };
    }
}

/// The process and its system that a temporary name has.
fn writer(name: &str) -> Option<(u32, u32)> {
    let (_, rest) = name.strip_prefix('.')?.strip_suffix(".tmp")?.rsplit_once('.')?;
    let (process, random) = rest.split_once('-')?;
    let system = u32::from_str_radix(random.get(..8)?, 16).ok()?;
    let is_ours = random.len() == 16 && random.bytes().all(|b| b.is_ascii_hexdigit());
    is_ours.then(|| Some((process.parse().ok()?, system)))?
}

/// `None` if that is unknown.
fn is_running(process: u32) -> Option<bool> {
    (cfg!(unix) && Path::new("/proc/self").exists()).then(|| Path::new("/proc").join(process.to_string()).exists())
}

/// Whether nothing was written to it for so long; of a folder, nor to anything in it.
fn is_old(path: &Path, least: Duration) -> bool {
    let Ok(about) = std::fs::symlink_metadata(path) else { return false };
    let age = about.modified().ok().and_then(|time| SystemTime::now().duration_since(time).ok());
    let mut inside = if about.is_dir() { std::fs::read_dir(path).ok() } else { None }.into_iter().flatten().flatten();
    age.is_some_and(|age| age > least) && inside.all(|entry| is_old(&entry.path(), least))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_temporary_file_is_exclusive_and_leftovers_are_removed() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.txt");
        // No process has the largest number; one file is old, one is new, one is of this process, one is the user's.
        let litter = |process: u32| dir.path().join(format!(".b.txt.{process}-0123456789abcdef.tmp"));
        let (dead, ours, mine) = (u32::MAX - 1, std::process::id(), dir.path().join(".notes.tmp"));
        let fresh = dir.path().join(format!(".c.txt.{dead}-0123456789abcdef.tmp"));
        for file in [&litter(dead), &litter(ours), &mine, &fresh] {
            let file = File::create(file).expect("writable");
            file.set_modified(SystemTime::now() - 2 * LONG_ABANDONED).expect("a time");
        }
        File::options().write(true).open(&fresh).expect("there").set_modified(SystemTime::now()).expect("a time");
        let killed = dir.path().join(format!(".d.txt.{dead}-{:08x}01234567.tmp", system()));
        File::create(&killed).expect("writable");
        let mut part = Part::beside(&path).expect("writable");
        assert!(
            !killed.exists() || !cfg!(unix) || !Path::new("/proc/self").exists(),
            "it is known to be dead, however new"
        );
        assert!(!litter(dead).exists() && litter(ours).exists() && mine.exists() && fresh.exists());
        part.write_all(b"text").expect("written");
        let other = Part::beside(&path).expect("writable");
        assert_ne!(part.path(), other.path());
        assert!(!path.exists());
        part.keep().expect("renamed");
        assert_eq!(std::fs::read(&path).expect("there"), b"text");
        let gone = other.path().to_owned();
        drop(other);
        assert!(!gone.exists());
        let long = dir.path().join("é".repeat(120));
        Part::beside(&long).expect("a long name").keep().expect("renamed");
    }

    #[cfg(unix)]
    #[test]
    fn folders_that_killed_processes_left_go_too() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let made = |name: &str, process: u32, random: &str, age: Duration| {
            let folder = dir.path().join(format!(".{name}.{process}-{random}.tmp"));
            let (inner, then) = (folder.join("000001/0"), SystemTime::now() - 2 * ABANDONED);
            std::fs::create_dir_all(&inner).expect("writable");
            let file = File::create(inner.join("0_0.png")).expect("writable");
            file.set_modified(SystemTime::now() - age).expect("a time");
            for folder in [&inner, &folder.join("000001"), &folder] {
                File::open(folder).expect("there").set_modified(then).expect("a time");
            }
            folder
        };
        let (dead, random, old) = (u32::MAX - 1, "0123456789abcdef", 2 * ABANDONED);
        let left = made("a", dead, random, old);
        // Of one that is being written to, one of this process, and one of another kind.
        let others = [
            made("b", dead, random, Duration::ZERO),
            made("c", std::process::id(), random, old),
            made("d", dead, "mine", old),
        ];
        create_dir(&dir.path().join("new")).expect("made");
        assert!(!left.exists() && others.iter().all(|folder| folder.exists()));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_kept_and_its_target_written() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (folder, link) = (dir.path().join("b"), dir.path().join("a.txt"));
        let (there, other) = (folder.join("there"), folder.join("other"));
        std::fs::create_dir(&folder).expect("writable");
        std::fs::write(&there, "old").expect("writable");
        std::os::unix::fs::symlink("b/other", &link).expect("a link");
        std::os::unix::fs::symlink(&there, &other).expect("a link");
        for text in ["new", "newer"] {
            let mut part = Part::beside(&link).expect("writable");
            part.write_all(text.as_bytes()).expect("written");
            part.keep().expect("renamed");
            assert_eq!(std::fs::read_to_string(&there).expect("there"), text);
            // The second time it leads to a file that does not exist yet.
            std::fs::remove_file(&there).expect("there");
        }
        assert!(link.is_symlink() && other.is_symlink());
        assert_eq!(std::fs::read_dir(&folder).expect("readable").count(), 1, "nothing else stays");
    }

    /// In a folder of results no link redirects a write.
    #[cfg(unix)]
    #[test]
    fn a_link_among_results_is_replaced_and_not_followed() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (precious, link) = (dir.path().join("precious"), dir.path().join("table.txt"));
        std::fs::write(&precious, "mine").expect("writable");
        std::os::unix::fs::symlink(&precious, &link).expect("a link");
        crate::files::write_inside(&link, b"ours").expect("writable");
        assert!(!link.is_symlink());
        assert_eq!(std::fs::read_to_string(&link).expect("there"), "ours");
        assert_eq!(std::fs::read_to_string(&precious).expect("there"), "mine");
    }

    #[cfg(unix)]
    #[test]
    fn a_fifo_is_written_to_and_stays() {
        use std::os::unix::fs::FileTypeExt;
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("fifo");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo").success());
        for kept in [true, false] {
            let reader = std::thread::spawn({
                let path = path.clone();
                move || std::fs::read(path)
            });
            let mut part = Part::beside(&path).expect("writable");
            part.write_all(b"text").expect("written");
            if kept {
                part.keep().expect("there is nothing to rename");
            } else {
                drop(part);
            }
            assert_eq!(reader.join().expect("a thread").expect("readable"), b"text");
            assert!(std::fs::metadata(&path).expect("there").file_type().is_fifo());
        }
    }
}
