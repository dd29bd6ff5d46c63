//! Shared parts of trackers of one target and of many: input of pictures, and pickles.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate::extend::SavedState;
use foveate::{Error, Image, MultiTracker, Result, Tracker};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use serde_json::Value;

use crate::errors::OrRaise;
use crate::making::Making;
use crate::pictures::{Picture, Pixels};
use crate::threads;

/// A tracker that a pickle can restore.
pub(crate) trait Follows: Send + Sized {
    /// Creates a tracker without a target.
    fn made(making: &Making) -> Result<Self>;
    /// Returns the whole state.
    fn save(&self) -> SavedState;
    /// Restores a saved state.
    fn load(&mut self, saved: &SavedState) -> Result<()>;
    /// Observes a picture without tracking in it.
    fn skip(&mut self, image: &Image);
}

impl Follows for Tracker {
    fn made(making: &Making) -> Result<Self> {
        making.blueprint.tracker(making.seed)
    }
    fn save(&self) -> SavedState {
        Tracker::save(self)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        Tracker::load(self, saved)
    }
    fn skip(&mut self, image: &Image) {
        Tracker::skip(self, image).expect("a picture in memory can be read");
    }
}

impl Follows for MultiTracker {
    fn made(making: &Making) -> Result<Self> {
        making.blueprint.multi_tracker(making.seed)
    }
    fn save(&self) -> SavedState {
        MultiTracker::save(self)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        MultiTracker::load(self, saved)
    }
    fn skip(&mut self, image: &Image) {
        MultiTracker::skip(self, image);
    }
}

/// The state changed by an update.
pub(crate) struct Working<T> {
    pub tracker: T,
    /// The current picture, in planes; after an update a pickle needs it to continue bit for bit.
    pub image: Option<Image>,
    /// The buffer for the next picture: swapped after the tracker has accepted the picture, so that a refused picture is discarded.
    spare: Option<Image>,
}

/// A tracker that one call at a time uses, with its configuration.
pub(crate) struct Held<T> {
    pub making: Making,
    working: Mutex<Working<T>>,
}

/// The contents of a pickle: the configuration's text and folder, seed, channels, the saved state, and the last picture (width, height,
/// planes and bytes).
pub(crate) type Pickle = (String, PathBuf, u64, String, Vec<u8>, Option<(usize, usize, usize, Vec<u8>)>);

impl<T: Follows> Held<T> {
    /// Creates a tracker without a target.
    pub(crate) fn new(making: Making) -> Result<Self> {
        let tracker = T::made(&making)?;
        Ok(Self { making, working: Mutex::new(Working { tracker, image: None, spare: None }) })
    }

    /// Locks the tracker. Release the interpreter's lock first: another thread may hold the tracker.
    pub(crate) fn working(&self) -> MutexGuard<'_, Working<T>> {
        self.working.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Passes a picture to the tracker, without the interpreter's lock.
    pub(crate) fn show<R: Send>(
        &self,
        image: &Bound<'_, PyAny>,
        act: impl FnOnce(&mut T, &Image) -> Result<R> + Send,
    ) -> PyResult<R> {
        let py = image.py();
        let picture = Picture::new(image, self.making.channels)?;
        let pixels: Pixels<'_> = picture.pixels();
        let work = || {
            let Working { tracker, image, spare } = &mut *self.working();
            let result = act(tracker, pixels.read(spare)?)?;
            std::mem::swap(image, spare);
            Ok(result)
        };
        py.detach(|| threads::run(work).and_then(|result| result)).or_raise(py)
    }

    /// Returns the whole state as JSON in UTF-8, with the order of a colour picture's bytes.
    pub(crate) fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let text = py.detach(|| {
            let mut saved: Value = self.working().tracker.save().read().expect("any JSON");
            saved["channels"] = self.making.channels.name.into();
            saved.to_string()
        });
        Ok(PyBytes::new(py, text.as_bytes()))
    }

    /// Restores a saved state. Refuses a state with another order of a colour picture's bytes, because its models are of other colours.
    pub(crate) fn load(&self, py: Python<'_>, saved: &[u8]) -> PyResult<()> {
        let ours = self.making.channels;
        let take_up = || {
            let saved = parse(saved)?;
            match saved["channels"].as_str().filter(|name| !ours.has_order_of(name)) {
                Some(theirs) => Err(Error::Invalid(format!(
                    "the saved state cannot be used: it was saved with channels=\"{theirs}\", this tracker has channels=\"{}\"; make the \
                     tracker with channels=\"{theirs}\"",
                    ours.name
                ))),
                None => self.working().tracker.load(&SavedState::new(&saved)),
            }
        };
        py.detach(take_up).or_raise(py)
    }

    /// Returns the value of `__reduce__`: the function of this name restores the tracker.
    pub(crate) fn pickled<'py>(
        &self,
        py: Python<'py>,
        restore: &str,
        saved: Bound<'py, PyBytes>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let Making { folder, seed, channels, .. } = &self.making;
        let image = py.detach(|| self.working().image.clone());
        let image = image.map(|i| (i.width(), i.height(), i.planes(), PyBytes::new(py, i.bytes())));
        let folder = folder.to_string_lossy().into_owned();
        let state = (self.making.text(), folder, *seed, channels.name, saved, image).into_pyobject(py)?;
        PyTuple::new(py, [py.import("foveate._foveate")?.getattr(restore)?, state.into_any()])
    }

    /// Restores a tracker from its pickle.
    pub(crate) fn restored(py: Python<'_>, (text, folder, seed, channels, saved, image): Pickle) -> PyResult<Self> {
        let this = Self::new(Making::again(py, &text, folder, seed, &channels)?).or_raise(py)?;
        let restore = || {
            let working = &mut *this.working();
            working.tracker.load(&SavedState::new(&parse(&saved)?))?;
            if let Some((width, height, planes, bytes)) = image {
                let image = Image::new(width, height, planes, bytes)?;
                working.tracker.skip(&image);
                working.image = Some(image);
            }
            Ok(())
        };
        py.detach(restore).or_raise(py)?;
        Ok(this)
    }
}

/// Parses saved JSON.
pub(crate) fn parse(saved: &[u8]) -> Result<Value> {
    serde_json::from_slice(saved)
        .map_err(|e| Error::Invalid(format!("the saved state cannot be used: expected what save() gave, JSON: {e}")))
}
