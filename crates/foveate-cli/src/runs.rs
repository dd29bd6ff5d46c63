//! Parallel runs of trackers on videos; each finished run is kept in its own file and never repeated.
//!
//! A run's file is named by a digest of everything that the run depends on: configuration, model, program, video, digits, seed. Experiments
//! can therefore share a store, several machines can fill it ([`Store::shard`]), it can be merged from several stores ([`Store::others`]),
//! and it can be killed at any time.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use foveate::config::Blueprint;
use foveate::lab::Digits;
use foveate::lab::eval::experiment;
use foveate::lab::eval::experiment::Run;
use foveate::text::counted;
use foveate::{Error, Result, files};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::terminal;

/// Interval between two progress lines if standard error is a file.
const REPORT: Duration = Duration::from_secs(30);

/// A checked configuration.
#[derive(Debug)]
pub struct Entry {
    /// The parts of the configuration.
    pub blueprint: Blueprint,
    /// A digest of its boxes on a small fixed video: [`experiment::fingerprint`].
    pub fingerprint: String,
    /// A digest of what its results depend on: configuration, model, program, and how it is run.
    pub key: String,
}

impl Entry {
    /// Creates the entry of a configuration; `how` distinguishes different ways to run it.
    pub fn of(blueprint: Blueprint, how: &str) -> Result<Self> {
        let (version, text) = (env!("CARGO_PKG_VERSION"), blueprint.config().to_toml());
        let fingerprint = experiment::fingerprint(&blueprint)?;
        let key = format!("{version} {fingerprint} {text} {how}");
        Ok(Self { blueprint, fingerprint, key })
    }
}

/// Does a job: returns its run, and the text of its file.
pub type Making<'a, J, R> = dyn Fn(&J) -> Result<(R, Vec<u8>)> + Sync + 'a;

/// The stored content of a finished run.
pub trait Finished: Serialize + DeserializeOwned + Clone + Send {
    /// Returns whether it can belong to a video with this number of frames: a check of a file's content.
    fn is_of(&self, frames: usize) -> bool;
}

impl Finished for Run {
    fn is_of(&self, frames: usize) -> bool {
        self.is_of(frames)
    }
}

/// Parses a shard of the runs as `--shard` gives it: `1/4` is (0, 4).
pub fn parse_shard(text: &str) -> std::result::Result<(u32, u32), String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i - 1, n)),
        _ => Err(format!("expected a shard and the number of shards, such as 1/4, got {text}")),
    }
}

/// Prints what to do with a shard of the runs.
pub fn part_is_done(out: &Path) {
    say!("{}: this shard is done. Combine all shards with the same command, without --shard, and with", out.display());
    say!("--merge DIR for the folder of each shard.");
}

/// Returns the error of a stopped command; finished runs are kept in `kept`.
pub fn stopped(kept: &Path) -> Error {
    Error::Invalid(format!("stopped; the same command continues with {}", kept.display()))
}

/// Returns a digest of these digits.
pub fn pixels(digits: &Digits) -> String {
    experiment::digest(&[&digits.images, &digits.labels])
}

/// Returns the text of a run's file.
pub fn text(run: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec(run).map_err(|e| Error::Invalid(e.to_string()))
}

/// The store of finished runs.
#[derive(Clone, Debug, Default)]
pub struct Store {
    /// The folder, with one file per run.
    pub folder: PathBuf,
    /// Folders of other stores, from which missing runs are copied.
    pub others: Vec<PathBuf>,
    /// Do only the `i`-th of `n` parts of the runs, `i` from 0.
    pub shard: Option<(u32, u32)>,
}

impl Store {
    /// Returns the store in the folder `runs` of `out`.
    pub fn of(out: &Path) -> Self {
        Self { folder: out.join("runs"), ..Self::default() }
    }

    /// Returns the store of `out`, which also takes runs from the folders `merge`, and does only a part of the runs.
    ///
    /// # Errors
    /// One of `merge` has no finished runs.
    pub fn shared(out: &Path, merge: &[PathBuf], shard: Option<(u32, u32)>) -> Result<Self> {
        let others: Vec<PathBuf> = merge.iter().map(|dir| dir.join("runs")).collect();
        match others.iter().find(|folder| !folder.is_dir()) {
            Some(absent) => {
                let absent = absent.display();
                Err(Error::Invalid(format!(
                    "{absent}: no finished runs here; --merge takes a folder that was given as --out"
                )))
            }
            None => Ok(Self { others, shard, ..Self::of(out) }),
        }
    }

    /// Returns the runs of all jobs, in their order. `key` names a job's file; if no store has it, the run is made and its text is written.
    /// Runs of another shard are missing, and so are the remaining runs if the program is stopped.
    pub fn finished<J: Sync, R: Finished>(
        &self,
        name: &str,
        jobs: &[J],
        frames: &(dyn Fn(&J) -> usize + Sync),
        key: &(dyn Fn(&J) -> String + Sync),
        make: &Making<'_, J, R>,
    ) -> Result<Vec<Option<R>>> {
        let folder = &self.folder;
        std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot create the folder for finished runs"))?;
        terminal::catch_interrupts();
        let progress = Progress::new(name, jobs.len());
        let resumed = AtomicUsize::new(0);
        let work = |job: &J| {
            let key = key(job);
            let path = self.path(&key);
            if let Some(run) = self.find(&path, frames(job))? {
                resumed.fetch_add(1, Ordering::Relaxed);
                progress.found();
                return Ok(Some(run));
            }
            let part = u32::from_str_radix(&key[..8], 16).expect("a digest is hexadecimal");
            if self.shard.is_some_and(|(i, n)| part % n != i) {
                progress.found();
                return Ok(None);
            }
            let (run, text) = make(job)?;
            put(&path, &text)?;
            progress.done();
            Ok(Some(run))
        };
        let runs = side_by_side(jobs, &work)?;
        progress.bar.finish_and_clear();
        if !terminal::stopping() {
            note!("{}, {} of them from {}", counted(jobs.len(), "run"), resumed.into_inner(), folder.display());
        }
        Ok(runs)
    }

    /// Returns one run with this number of frames: from the file named by `key`, or newly made and stored there.
    pub fn one<R: Finished>(&self, key: &str, frames: usize, make: impl FnOnce() -> Result<(R, Vec<u8>)>) -> Result<R> {
        let path = self.path(key);
        if let Some(run) = self.find(&path, frames)? {
            return Ok(run);
        }
        let (run, text) = make()?;
        put(&path, &text)?;
        Ok(run)
    }

    /// Removes the files with these keys, and their folder if it is then empty.
    pub fn forget(&self, keys: impl IntoIterator<Item = String>) -> Result<()> {
        for path in keys.into_iter().map(|key| self.path(&key)) {
            match std::fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&path, "cannot remove")(e)),
                _ => {}
            }
        }
        // The folder may hold other runs.
        let _ = std::fs::remove_dir(&self.folder);
        Ok(())
    }

    /// Returns the file of a run.
    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.json"))
    }

    /// Finds a finished run in this store or another one; copies it here from another one.
    fn find<R: Finished>(&self, path: &Path, frames: usize) -> Result<Option<R>> {
        if let Some(run) = read(path, frames) {
            return Ok(Some(run));
        }
        for other in &self.others {
            let from = other.join(path.file_name().unwrap_or_default());
            if let Some(run) = read(&from, frames) {
                files::write_inside(path, &files::read(&from, files::TEXT)?)?;
                return Ok(Some(run));
            }
        }
        Ok(None)
    }
}

/// Reads a finished run; `None` if the file is missing or damaged.
fn read<R: Finished>(path: &Path, frames: usize) -> Option<R> {
    let bytes = files::read(path, files::TEXT).ok()?;
    let run: R = serde_json::from_slice(unsealed(path, &bytes)?).ok()?;
    run.is_of(frames).then_some(run)
}

fn put(path: &Path, text: &[u8]) -> Result<()> {
    files::write_inside(path, &sealed(path, text))
}

/// Returns the text of a run followed by a checksum of the text and the run's name, so that neither can belong to another run.
fn sealed(path: &Path, text: &[u8]) -> Vec<u8> {
    let mut all = text.to_vec();
    all.extend(format!("\n{}\n", seal(path, text)).bytes());
    all
}

/// Returns the text if its checksum is right.
fn unsealed<'a>(path: &Path, bytes: &'a [u8]) -> Option<&'a [u8]> {
    let all = bytes.strip_suffix(b"\n")?;
    let (text, sum) = all.split_at(all.iter().rposition(|byte| *byte == b'\n')?);
    (seal(path, text).as_bytes() == &sum[1..]).then_some(text)
}

fn seal(path: &Path, text: &[u8]) -> String {
    let mut sum = Sha256::new();
    sum.update(path.file_name().unwrap_or_default().as_encoded_bytes());
    sum.update(text);
    sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Does all jobs, as many at a time as there are threads and each in a single thread. The results are in the order of the jobs, and are
/// missing if the program was stopped.
fn side_by_side<J: Sync, R: Finished>(
    jobs: &[J],
    work: &(dyn Fn(&J) -> Result<Option<R>> + Sync),
) -> Result<Vec<Option<R>>> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let runs = Mutex::new(vec![None; jobs.len()]);
    // The pool has one thread, so that a tracker's parallel work stays in its own job and times are those of one thread.
    let worker = || -> Result<()> {
        let pool = crate::threads(1)?;
        while !terminal::stopping() && !failed.load(Ordering::Relaxed) {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(i) else { break };
            let run = pool.install(|| work(job));
            failed.fetch_or(run.is_err(), Ordering::Relaxed);
            runs.lock().expect("no thread panics while it holds the list")[i] = run?;
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let more = 1..rayon::current_num_threads();
        // Use as many threads as the system provides; the current thread always works.
        let workers: Vec<_> =
            more.map_while(|_| std::thread::Builder::new().spawn_scoped(scope, worker).ok()).collect();
        worker()?;
        workers.into_iter().try_for_each(|w| w.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })?;
    Ok(runs.into_inner().expect("all threads have ended"))
}

/// Progress and remaining time: a bar on a terminal, otherwise a line at intervals.
struct Progress {
    name: String,
    bar: indicatif::ProgressBar,
    began: Instant,
    done: AtomicUsize,
    said: Mutex<Instant>,
}

impl Progress {
    fn new(name: &str, jobs: usize) -> Self {
        let (bar, now) = (terminal::progress(Some(jobs), name), Instant::now());
        Self { name: name.into(), bar, began: now, done: AtomicUsize::new(0), said: Mutex::new(now) }
    }
    /// Counts a job that needed no work.
    fn found(&self) {
        self.bar.inc(1);
    }
    fn done(&self) {
        self.bar.inc(1);
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let mut said = self.said.lock().expect("no thread panics while it holds the time");
        if self.bar.is_hidden() && said.elapsed() > REPORT {
            *said = Instant::now();
            let (at, all) = (self.bar.position(), self.bar.length().unwrap_or(0));
            let left = self.began.elapsed().as_secs_f64() / done as f64 * all.saturating_sub(at) as f64;
            note!("{}: {at} of {all} runs, {:.0} min left", self.name, left / 60.0);
        }
    }
}
