//! An output that fails ends, and the run goes on: a full disk or a film too large for its format costs that file alone.

use std::cell::RefCell;
use std::rc::Rc;

use foveate::Seen;
use foveate::geometry::BBox;
use foveate::report::{MultiObserver, Observer};
use foveate::video::Frame;
use foveate::{Error, Result};

/// The files that could not be written, and why. Clones share one list.
#[derive(Clone, Default)]
pub struct Lost(Rc<RefCell<Vec<(&'static str, String)>>>);

impl Lost {
    /// The names of the files.
    pub fn names(&self) -> Vec<&'static str> {
        self.0.borrow().iter().map(|(name, _)| *name).collect()
    }

    /// Fails where there are some, naming them.
    pub fn check(&self) -> Result<()> {
        match &self.0.borrow()[..] {
            [] => Ok(()),
            lost => {
                let all: Vec<_> = lost.iter().map(|(name, why)| format!("{name} was not written: {why}")).collect();
                Err(Error::Invalid(all.join("; ")))
            }
        }
    }

    /// The same observer, but that its first failure ends it alone; `files` are those that it writes.
    pub fn spare<O>(&self, files: &'static [&'static str], observer: O) -> Spared<O> {
        Spared { observer: Some(observer), files, lost: self.clone() }
    }
}

/// An observer until it fails.
pub struct Spared<O> {
    observer: Option<O>,
    files: &'static [&'static str],
    lost: Lost,
}

impl<O> Spared<O> {
    fn told(&mut self, tell: impl FnOnce(&mut O) -> Result<()>) -> Result<()> {
        if let Some(Err(error)) = self.observer.as_mut().map(tell) {
            self.observer = None;
            let why = error.to_string();
            self.lost.0.borrow_mut().extend(self.files.iter().map(|name| (*name, why.clone())));
        }
        Ok(())
    }
}

impl<O: Observer> Observer for Spared<O> {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.told(|observer| observer.start(frame, bbox))
    }
    fn observe(&mut self, frame: &Frame, seen: &Seen<'_>) -> Result<()> {
        self.told(|observer| observer.observe(frame, seen))
    }
    fn finish(&mut self) -> Result<()> {
        self.told(Observer::finish)
    }
}

impl<O: MultiObserver> MultiObserver for Spared<O> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.told(|observer| observer.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.told(MultiObserver::finish)
    }
}
