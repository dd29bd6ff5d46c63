//! The beginning of a run without an end.

use crate::{MultiObserver, Observer};
use foveate_base::Result;
use foveate_core::Seen;
use foveate_core::geometry::BBox;
use foveate_video::Frame;

/// Shows an observer the first frames of a run and no more: what it keeps, in memory or on disk, stays bounded.
#[derive(Debug)]
pub struct Limited<O> {
    observer: O,
    left: usize,
}

impl<O> Limited<O> {
    /// The first `frames` of a run.
    pub fn new(observer: O, frames: usize) -> Self {
        Self { observer, left: frames }
    }

    fn wants(&mut self) -> bool {
        let wants = self.left > 0;
        self.left = self.left.saturating_sub(1);
        wants
    }
}

impl<O: Observer> Observer for Limited<O> {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        if self.wants() { self.observer.start(frame, bbox) } else { Ok(()) }
    }
    fn observe(&mut self, frame: &Frame, seen: &Seen<'_>) -> Result<()> {
        if self.wants() { self.observer.observe(frame, seen) } else { Ok(()) }
    }
    fn finish(&mut self) -> Result<()> {
        self.observer.finish()
    }
}

impl<O: MultiObserver> MultiObserver for Limited<O> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        if self.wants() { self.observer.observe(frame, targets) } else { Ok(()) }
    }
    fn finish(&mut self) -> Result<()> {
        self.observer.finish()
    }
}
