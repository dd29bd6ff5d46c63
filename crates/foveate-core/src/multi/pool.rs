//! Room to look in, shared by all targets: as many rooms as threads, not as many as targets.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::target::Target;
use crate::engine::Buffers;

/// Rooms that nobody looks in, and whether looking is to stop.
#[derive(Default)]
pub(super) struct Pool {
    free: Mutex<Vec<Box<Buffers>>>,
    pub stop: Arc<AtomicBool>,
}

impl Pool {
    /// Whether somebody asked to stop: then what is done in this frame is of no more use.
    pub fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Target {
    /// Looks at a picture, in a room of the pool. What was there before does not count.
    pub fn looking<T>(&mut self, pool: &Pool, look: impl FnOnce(&mut Self) -> T) -> T {
        let rooms = || pool.free.lock().unwrap_or_else(PoisonError::into_inner);
        let mut room = rooms().pop().unwrap_or_default();
        self.engine.exchange(&mut room);
        let seen = look(self);
        self.engine.exchange(&mut room);
        self.engine.compact();
        rooms().push(room);
        seen
    }
}
