//! Room to look in, shared by all targets: as many rooms as threads, not as many as targets.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::engine::Buffers;

/// Rooms that nobody looks in, and whether looking is to stop.
#[derive(Default)]
pub(super) struct Pool {
    free: Mutex<Vec<Buffers>>,
    pub stop: Arc<AtomicBool>,
}

impl Pool {
    /// A room, and to give it back.
    pub(super) fn take(&self) -> Buffers {
        self.free().pop().unwrap_or_default()
    }
    pub(super) fn put(&self, room: Buffers) {
        self.free().push(room);
    }
    fn free(&self) -> MutexGuard<'_, Vec<Buffers>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Whether somebody asked to stop: then what is done in this frame is of no more use.
    pub(super) fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
