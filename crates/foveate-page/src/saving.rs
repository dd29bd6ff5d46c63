//! annotated.mp4, report.html and surface.png of a track: the track is computed again, as `foveate track` does.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_base::Result;
use foveate_base::sink::{Memory, Sink};
use foveate_core::geometry::BBox;
use foveate_core::{Seen, Tracker};
use foveate_report::{Film, Observer, Report, RunInfo, SurfacePicture};
use foveate_video::Frame;

use crate::host::Host;
use crate::player::Frames;
use crate::tracking::Tracking;

/// Maximum number of frames tracked per message.
const FRAMES: usize = 10;

/// A complete result.
#[derive(Clone, Debug)]
pub enum Made {
    /// In memory.
    Bytes(Arc<[u8]>),
    /// In a folder.
    File(PathBuf),
}

/// A file being written: its name, the observer that writes it, and its bytes if they are in memory.
type Output = (&'static str, Box<dyn Observer + Send>, Option<Memory>);

/// Results of a target that are being written, or are complete. If dropped, they are removed.
pub(crate) struct Saving {
    tracker: Tracker,
    frames: Box<dyn Frames>,
    outputs: Vec<Output>,
    given: BTreeMap<usize, BBox>,
    next: usize,
    last: usize,
    info: RunInfo,
    folder: Folder,
    /// Number of frames so far.
    pub count: usize,
    /// The files, once they are complete.
    pub files: Option<Vec<(&'static str, Made)>>,
}

/// A folder that is removed with its contents; `None` for memory.
struct Folder(Option<PathBuf>);

impl Drop for Folder {
    fn drop(&mut self) {
        if let Some(folder) = &self.0 {
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}

impl Saving {
    /// Starts writing the requested files.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(crate) fn begin<H: Host>(
        (film, report): (bool, bool),
        tracking: &Tracking,
        frames: Box<dyn Frames>,
        info: RunInfo,
        host: &H,
    ) -> Result<Self> {
        let folder = Folder(host.folder()?);
        let tracker = tracking.setup.blueprint.tracker(tracking.setup.seed)?;
        let mut outputs: Vec<Output> = vec![];
        if film {
            let name = "annotated.mp4";
            outputs.push(match &folder.0 {
                Some(folder) => (name, Box::new(Film::create(folder.join(name), &info)?), None),
                None => {
                    let memory = Memory::default();
                    (name, Box::new(Film::to(memory.clone(), name, &info)), Some(memory))
                }
            });
        }
        if report {
            let name = "report.html";
            let (sink, memory) = sink(name, folder.0.as_deref())?;
            outputs.push((name, Box::new(Report::to(sink, info.clone())), memory));
        }
        if report && SurfacePicture::shows(tracker.parts().gaze.policy().snapshot()) {
            let name = "surface.png";
            let (sink, memory) = sink(name, folder.0.as_deref())?;
            outputs.push((name, Box::new(SurfacePicture::to(sink, info.clone())), memory));
        }
        let (given, next, last) = (tracking.given().clone(), tracking.first(), tracking.last());
        Ok(Self { tracker, frames, outputs, given, next, last, info, folder, count: 0, files: None })
    }

    /// Tracks further frames; stops after the first one when `enough` returns true.
    ///
    /// # Errors
    /// The video breaks off, or a file cannot be written.
    pub(crate) fn go_on<H: Host>(&mut self, enough: impl Fn() -> bool) -> Result<()> {
        for done in 0..FRAMES {
            if self.files.is_some() || (done > 0 && enough()) {
                break;
            }
            match if self.next <= self.last { self.frames.frame(self.next)? } else { None } {
                Some(frame) => self.track::<H>(&frame)?,
                None => self.finish()?,
            }
        }
        Ok(())
    }

    fn track<H: Host>(&mut self, frame: &Frame) -> Result<()> {
        let Self { tracker, outputs, info, .. } = self;
        let began = H::now();
        let mut observers = outputs.iter_mut().map(|(_, observer, _)| observer);
        tracker.set_time(frame.time);
        let seen = match self.given.get(&self.next) {
            Some(bbox) => {
                tracker.init(&frame.image, *bbox)?;
                Seen::given(frame.image.shape(), bbox)
            }
            None => tracker.update(&frame.image)?,
        };
        info.clock.add(H::now() - began);
        observers.try_for_each(|observer| observer.observe(frame, &[seen]))?;
        self.next += 1;
        self.count += 1;
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        self.frames.remarks().sentences().into_iter().for_each(|sentence| self.info.warnings.add(sentence));
        let mut files = vec![];
        for (name, mut observer, memory) in self.outputs.drain(..) {
            observer.finish()?;
            let file = || self.folder.0.as_ref().map(|folder| folder.join(name)).filter(|path| path.is_file());
            let made = memory.map(|memory| memory.take()).filter(|bytes| !bytes.is_empty());
            let made = made.map(|bytes| Made::Bytes(bytes.into()));
            files.extend(made.or_else(|| file().map(Made::File)).map(|made| (name, made)));
        }
        self.files = Some(files);
        Ok(())
    }
}

fn sink(name: &str, folder: Option<&Path>) -> Result<(Sink, Option<Memory>)> {
    let Some(folder) = folder else {
        let memory = Memory::default();
        return Ok((Sink::memory(name, memory.clone()), Some(memory)));
    };
    Ok((Sink::create(folder.join(name))?, None))
}
