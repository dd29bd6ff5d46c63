//! The beginning of a run without an end.

use crate::Observer;
use foveate_base::Result;
use foveate_core::Seen;
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
}

impl<O: Observer> Observer for Limited<O> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        if self.left == 0 {
            return Ok(());
        }
        self.left -= 1;
        self.observer.observe(frame, targets)
    }
    fn finish(&mut self) -> Result<()> {
        self.observer.finish()
    }
}
