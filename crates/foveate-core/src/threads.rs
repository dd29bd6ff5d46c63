//! Threads, if there are any: with the feature `threads`. The results never depend on them.

#[cfg(feature = "threads")]
use {foveate_base::thread::started, rayon::prelude::*};

/// Threads that work is shared by.
#[cfg(feature = "threads")]
pub(crate) fn count() -> usize {
    rayon::current_num_threads()
}

/// Threads that work is shared by, 1 where there are none.
pub(crate) fn several() -> usize {
    #[cfg(feature = "threads")]
    return count();
    #[cfg(not(feature = "threads"))]
    1
}

/// Runs `f` with so many threads, or with those of the caller where the system gives no more.
pub(crate) fn with<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    #[cfg(feature = "threads")]
    return match rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .spawn_handler(|worker| started(|| worker.run()))
        .build()
    {
        Ok(pool) => pool.install(f),
        Err(_) => f(),
    };
    #[cfg(not(feature = "threads"))]
    return (f(), threads).0;
}

/// Runs `f` on every item and its index; in parallel, if there are several items and threads.
pub(crate) fn each<T: Send>(items: &mut [T], f: impl Fn(usize, &mut T) + Send + Sync) {
    #[cfg(feature = "threads")]
    if items.len() > 1 && count() > 1 {
        return items.par_iter_mut().enumerate().for_each(|(i, item)| f(i, item));
    }
    items.iter_mut().enumerate().for_each(|(i, item)| f(i, item));
}
