//! Results of a track as files: the track is run once more, as `foveate track` does it.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use foveate::geometry::BBox;
use foveate::report::SurfacePicture;
use foveate::report::interactive::Setup;
use foveate::report::run::{SingleRun, Span, follow};
use foveate::{Error, Result};

use super::video::Video;
use crate::cmd::track::outputs::{Outputs, run_info};
use crate::cmd::track::spared::Lost;

/// A track as it is to be saved.
pub struct Wanted {
    pub video: Video,
    pub setup: Setup,
    /// Boxes given by hand, by frame from 0; the first one begins the track.
    pub given: Vec<(usize, BBox)>,
    /// The last frame, from 0.
    pub last: usize,
    pub command: String,
    pub film: bool,
    pub report: bool,
}

/// The names of files that are whole, or why there are none.
pub type Written = std::result::Result<Vec<&'static str>, String>;

/// Files that are being written, or are there. Dropped, they are removed.
pub struct Saved {
    folder: PathBuf,
    count: Arc<AtomicUsize>,
    stop: Arc<AtomicBool>,
    done: Arc<Mutex<Option<Written>>>,
}

impl Saved {
    /// Begins to write.
    pub fn begin(wanted: Wanted, pool: &Arc<rayon::ThreadPool>) -> Result<Self> {
        let saved = Self { folder: scratch()?, count: Arc::default(), stop: Arc::default(), done: Arc::default() };
        let (folder, count, stop, done) =
            (saved.folder.clone(), Arc::clone(&saved.count), Arc::clone(&saved.stop), Arc::clone(&saved.done));
        let pool = Arc::clone(pool);
        let work = move || {
            let write = || pool.install(|| write(&wanted, &folder, &count, &stop));
            let written = std::panic::catch_unwind(std::panic::AssertUnwindSafe(write));
            let written = written.unwrap_or_else(|_| Err(Error::Invalid("an error of the program; try again".into())));
            *done.lock().unwrap_or_else(PoisonError::into_inner) = Some(written.map_err(|e| e.to_string()));
            if stop.load(Ordering::SeqCst) {
                let _ = std::fs::remove_dir_all(&folder);
            }
        };
        foveate::thread::start("writing what was tracked", work)?;
        Ok(saved)
    }

    /// Frames so far; and the files, once they are whole, or why there are none.
    pub fn progress(&self) -> (usize, Option<Written>) {
        (self.count.load(Ordering::SeqCst), self.done.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    /// A file, its length and its media type; `None` where there is none of that name.
    pub fn file(&self, name: &str) -> Option<(File, u64, &'static str)> {
        let Some(Ok(files)) = self.progress().1 else { return None };
        let name = files.into_iter().find(|file| *file == name)?;
        let kind = match name.rsplit('.').next() {
            Some("csv") => "text/csv; charset=utf-8",
            Some("mp4") => "video/mp4",
            Some("png") => "image/png",
            // A page of its own must not run where our page runs.
            Some("html") => "application/octet-stream",
            _ => "text/plain; charset=utf-8",
        };
        let file = File::open(self.folder.join(name)).ok()?;
        let length = file.metadata().ok()?.len();
        Some((file, length, kind))
    }
}

impl Drop for Saved {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A folder for us alone among the temporary ones.
fn scratch() -> Result<PathBuf> {
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

fn write(wanted: &Wanted, folder: &Path, count: &AtomicUsize, stop: &AtomicBool) -> Result<Vec<&'static str>> {
    let Wanted { video, setup, given, last, .. } = wanted;
    let Some(((first, bbox), again)) = given.split_first() else {
        return Err(Error::Invalid("there is no track yet; start one".into()));
    };
    let mut tracker = setup.blueprint.tracker(setup.seed)?;
    let shown = video.place.shown.display().to_string();
    let mut info = run_info(&shown, &video.info, &setup.config, &setup.blueprint, setup.seed);
    info.command = wanted.command.clone();
    info.truth = video.truth();
    let surface = wanted.report && SurfacePicture::shows(tracker.parts().gaze.policy().snapshot());
    let (film, report) = (wanted.film, wanted.report);
    let outputs = Outputs { video: film, report, surface, trace: false, regret: false, endless: false };
    let lost = Lost::default();
    let mut observers = outputs.observers(folder, &info, &lost)?;
    let (halt, clock) = (|| stop.load(Ordering::SeqCst), info.clock.clone());
    let mut progress = |_: &foveate::video::Frame| {
        count.fetch_add(1, Ordering::SeqCst);
    };
    let span = Span {
        from: *first,
        until: *last,
        stop: &halt,
        clock,
        warnings: info.warnings.clone(),
        endless: false,
        progress: Some(&mut progress),
    };
    let run = SingleRun { init: Some(*bbox), again, span };
    // Frames before the first are not shown to the tracker, as in the page.
    let mut source =
        foveate::video::select(video.source()?, foveate::video::Selection { from: *first, ..Default::default() });
    follow(&mut *source, &mut tracker, &mut observers, run).1?;
    drop(observers);
    lost.check()?;
    Ok(outputs.names().into_iter().filter(|name| folder.join(name).is_file()).collect())
}
