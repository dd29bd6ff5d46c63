//! Scratch buffers, shared by all targets: as many as there are threads, not targets.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::engine::Buffers;

/// The free buffers, and the flag that stops the tracker.
#[derive(Default)]
pub(super) struct BufferPool {
    free: Mutex<Vec<Buffers>>,
    pub stop: Arc<AtomicBool>,
}

impl BufferPool {
    /// Takes buffers out of the pool; `put` returns them.
    pub(super) fn take(&self) -> Buffers {
        self.free().pop().unwrap_or_default()
    }
    pub(super) fn put(&self, room: Buffers) {
        self.free().push(room);
    }
    fn free(&self) -> MutexGuard<'_, Vec<Buffers>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Returns whether another thread has stopped the tracker: the rest of this frame is then skipped.
    pub(super) fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
