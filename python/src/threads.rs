//! The threads that updates run on: rayon's own, as in the Rust library, unless a number of them was asked for. A process that was
//! forked has none of its parent's, and gets its own.

use std::sync::{Arc, Mutex, PoisonError};

use foveate::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

struct Pool {
    /// The process that ran first, whose calls are rayon's own threads' business.
    first: u32,
    process: u32,
    wanted: usize,
    pool: Option<Arc<ThreadPool>>,
}

static POOL: Mutex<Pool> = Mutex::new(Pool { first: 0, process: 0, wanted: 0, pool: None });

/// Threads that may be asked for, as of the program.
const MOST: usize = 1024;

/// Uses so many threads from now on, 0 for all processors.
pub(crate) fn set(wanted: usize) -> Result<()> {
    if wanted > MOST {
        return Err(Error::Invalid(format!("threads are 0, for all processors, to {MOST}; they are {wanted}")));
    }
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    forget(&mut pool);
    pool.wanted = wanted;
    Ok(())
}

/// Drops the pool, or leaves it alone where it is a parent's: its threads are not here to be ended.
fn forget(pool: &mut Pool) {
    let old = pool.pool.take();
    if pool.process != std::process::id() {
        std::mem::forget(old);
    }
}

/// Runs on the threads of this process.
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
