//! Handles: keys of a table of live trackers. No key is used twice, so that a freed handle is found to be one.

use std::collections::BTreeMap;
use std::ptr::without_provenance_mut;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate::config::{Blueprint, Config};
use foveate::extend::SavedState;
use foveate::files::Folder;
use foveate::{Image, MultiTracker, Result as FoveateResult, Tracker};

use crate::errors::{Failure, FoveateCode};

/// A tracker, and the planes of the last picture, which the next one reuses.
pub(crate) struct Working<T> {
    pub tracker: T,
    pub image: Option<Image>,
}

/// The live trackers of one kind.
pub(crate) struct Table<T>(Mutex<BTreeMap<usize, Arc<Mutex<Working<T>>>>>);

/// A kind of tracker.
pub(crate) trait Follows: Sized + 'static {
    /// Returns the live trackers.
    fn table() -> &'static Table<Self>;
    /// Creates a tracker without a target.
    fn made(blueprint: &Blueprint) -> FoveateResult<Self>;
    /// Observes a picture without tracking.
    fn skip(&mut self, image: &Image) -> FoveateResult<()>;
    /// Returns the whole state.
    fn save(&self) -> SavedState;
    /// Restores a saved state.
    fn load(&mut self, saved: &SavedState) -> FoveateResult<()>;
}

impl Follows for Tracker {
    fn table() -> &'static Table<Self> {
        static LIVE: Table<Tracker> = Table(Mutex::new(BTreeMap::new()));
        &LIVE
    }
    fn made(blueprint: &Blueprint) -> FoveateResult<Self> {
        blueprint.tracker(blueprint.config().seed)
    }
    fn skip(&mut self, image: &Image) -> FoveateResult<()> {
        Tracker::skip(self, image)
    }
    fn save(&self) -> SavedState {
        Tracker::save(self)
    }
    fn load(&mut self, saved: &SavedState) -> FoveateResult<()> {
        Tracker::load(self, saved)
    }
}

impl Follows for MultiTracker {
    fn table() -> &'static Table<Self> {
        static LIVE: Table<MultiTracker> = Table(Mutex::new(BTreeMap::new()));
        &LIVE
    }
    fn made(blueprint: &Blueprint) -> FoveateResult<Self> {
        blueprint.multi_tracker(blueprint.config().seed)
    }
    fn skip(&mut self, image: &Image) -> FoveateResult<()> {
        MultiTracker::skip(self, image);
        Ok(())
    }
    fn save(&self) -> SavedState {
        MultiTracker::save(self)
    }
    fn load(&mut self, saved: &SavedState) -> FoveateResult<()> {
        MultiTracker::load(self, saved)
    }
}

/// Creates a tracker without a target, and returns its handle. `H` is the C type of the handle.
pub(crate) fn create<T: Follows, H>(configuration: &str) -> Result<*mut H, Failure> {
    /// The next key. Keys of both kinds differ, so that a handle is never one of the other kind.
    static NEXT: AtomicUsize = AtomicUsize::new(16);
    let working =
        Working { tracker: T::made(&Config::named_or_parsed(configuration)?.check(&Folder::here())?)?, image: None };
    let key = NEXT.fetch_add(16, Ordering::Relaxed);
    live::<T>().insert(key, Arc::new(Mutex::new(working)));
    Ok(without_provenance_mut(key))
}

/// Calls `act` with the tracker of a handle. Calls of several threads with one handle run one after the other.
pub(crate) fn with<T: Follows, H, R>(
    handle: *const H,
    act: impl FnOnce(&mut Working<T>) -> Result<R, Failure>,
) -> Result<R, Failure> {
    let found = live::<T>().get(&handle.addr()).cloned().ok_or_else(|| missing(handle))?;
    let broken = |_| Failure::new(FoveateCode::Internal, "an earlier call failed inside foveate; free this tracker");
    let mut working = found.lock().map_err(broken)?;
    act(&mut working)
}

/// Frees the tracker of a handle, after a call that uses it on another thread.
pub(crate) fn free<T: Follows, H>(handle: *const H) -> Result<(), Failure> {
    let removed = live::<T>().remove(&handle.addr());
    removed.map(drop).ok_or_else(|| missing(handle))
}

fn live<T: Follows>() -> MutexGuard<'static, BTreeMap<usize, Arc<Mutex<Working<T>>>>> {
    T::table().0.lock().unwrap_or_else(PoisonError::into_inner)
}

fn missing<H>(handle: *const H) -> Failure {
    let text = match handle.is_null() {
        true => "the tracker is a null pointer; create one with foveate_tracker_new or foveate_multi_new",
        false => {
            "no such tracker: it was freed, or is of the other kind; create one with foveate_tracker_new or foveate_multi_new"
        }
    };
    Failure::new(FoveateCode::Handle, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tracker_that_panicked_can_only_be_freed() {
        let handle: *mut u8 = create::<Tracker, _>("fast").expect("it ships");
        let act = |_: &mut Working<Tracker>| -> Result<(), Failure> { panic!("a fault") };
        assert!(std::panic::catch_unwind(|| with(handle, act)).is_err());
        let code = |result: Result<(), Failure>| result.err().map(|failure| failure.code);
        assert_eq!(code(with(handle, |_: &mut Working<Tracker>| Ok(()))), Some(FoveateCode::Internal));
        assert_eq!(code(free::<MultiTracker, _>(handle)), Some(FoveateCode::Handle), "of the other kind");
        assert_eq!(code(free::<Tracker, _>(handle)), None);
        assert_eq!(code(free::<Tracker, _>(handle)), Some(FoveateCode::Handle), "freed twice");
    }

    #[test]
    fn threads_take_turns_until_the_tracker_is_freed() {
        let key = create::<Tracker, u8>("fast").expect("it ships").addr();
        let handle = || without_provenance_mut::<u8>(key);
        let busy = AtomicUsize::new(0);
        let act = |_: &mut Working<Tracker>| {
            assert_eq!(busy.fetch_add(1, Ordering::SeqCst), 0, "one call at a time");
            std::thread::yield_now();
            busy.fetch_sub(1, Ordering::SeqCst);
            Ok(())
        };
        std::thread::scope(|scope| {
            let call = || while with(handle(), act).is_ok() {};
            (0..4).for_each(|_| _ = scope.spawn(call));
            std::thread::sleep(std::time::Duration::from_millis(20));
            free::<Tracker, _>(handle()).expect("it is live");
        });
    }
}
