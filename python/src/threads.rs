//! The threads of updates: rayon's own, as in the Rust library, unless a number of threads was set. A forked process has no threads of its
//! parent, and gets its own.

use std::sync::{Arc, Mutex, PoisonError};

use foveate::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

struct Pool {
    /// The first process, whose calls use rayon's own threads.
    first: u32,
    process: u32,
    wanted: usize,
    pool: Option<Arc<ThreadPool>>,
}

static POOL: Mutex<Pool> = Mutex::new(Pool { first: 0, process: 0, wanted: 0, pool: None });

/// Maximum number of threads, as for the program.
const MOST: usize = 1024;

/// Sets the number of threads from now on, 0 for all processors.
pub(crate) fn set(wanted: usize) -> Result<()> {
    if wanted > MOST {
        return Err(Error::Invalid(format!("threads are 0, for all processors, to {MOST}; they are {wanted}")));
    }
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    forget(&mut pool);
    pool.wanted = wanted;
    Ok(())
}

/// Drops the pool, or leaks it if it belongs to a parent process, because its threads do not exist here.
fn forget(pool: &mut Pool) {
    let old = pool.pool.take();
    if pool.process != std::process::id() {
        std::mem::forget(old);
    }
}

/// Runs work on the threads of this process.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = {
        let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        if pool.first == 0 {
            pool.first = std::process::id();
        }
        if pool.wanted == 0 && pool.first == std::process::id() {
            drop(pool);
            return Ok(work());
        }
        if pool.process != std::process::id() {
            forget(&mut pool);
            pool.process = std::process::id();
        }
        match &pool.pool {
            Some(made) => made.clone(),
            None => {
                let made = ThreadPoolBuilder::new().num_threads(pool.wanted);
                let made = made.spawn_handler(|worker| foveate::thread::started(|| worker.run())).build();
                let made = Arc::new(made.map_err(|e| Error::Invalid(format!("cannot start threads: {e}")))?);
                pool.pool = Some(made.clone());
                made
            }
        }
    };
    Ok(pool.install(work))
}
