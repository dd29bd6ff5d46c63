//! Threads, where there are any: with the feature `threads`. The results never depend on them.

/// Threads that work is shared by.
#[cfg(feature = "threads")]
pub(crate) fn count() -> usize {
    rayon::current_num_threads()
}

/// Runs `f` with so many threads.
pub(crate) fn with<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    #[cfg(feature = "threads")]
    return rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads").install(f);
    #[cfg(not(feature = "threads"))]
    return (f(), threads).0;
}
