//! The functions of `foveate.h`. The header's promises about memory are the safety conditions of this file: a pointer is null, or the
//! address of as many readable or writable values as the function's comment states.
#![allow(unreachable_pub)] // C reaches these functions by the linker's names

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::ptr::null_mut;
use std::slice;

use foveate::{Image, MultiTracker, Seen, Tracker};

use crate::errors::{Failure, FoveateCode, enter, last};
use crate::handles::{self, Follows, Working, with};
use crate::types::{FoveateBox, FoveateDetection, FoveatePicture, FoveateResult};

/// Follows one target.
pub struct FoveateTracker {
    _key: [u8; 0],
}

/// Follows many targets.
pub struct FoveateMulti {
    _key: [u8; 0],
}

/// Returns the version of the library.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// Returns the text of the last call that failed in this thread: the place, the expectation, the finding and the remedy, in UTF-8.
/// The text is valid until the next failed call of the thread.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_last_error() -> *const c_char {
    last()
}

/// Creates a tracker of one target. `configuration` is the name of a profile ("fast", "balanced", "accurate") or of a shipped
/// configuration, or the text of a TOML file, which has more than one line. Model files in it are relative to the current folder.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_new(
    configuration: *const c_char,
    tracker: Option<&mut MaybeUninit<*mut FoveateTracker>>,
) -> FoveateCode {
    enter(|| create::<Tracker, _>(configuration, tracker))
}

/// Frees a tracker; the handle is invalid afterwards. Null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_free(tracker: *mut FoveateTracker) -> FoveateCode {
    enter(|| free::<Tracker, _>(tracker))
}

/// Starts or restarts on the target in this box of a picture.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_init(
    tracker: *mut FoveateTracker,
    picture: Option<&FoveatePicture>,
    bbox: FoveateBox,
) -> FoveateCode {
    enter(|| show(tracker, picture, |t: &mut Tracker, image| Ok(t.init(image, bbox.into())?)))
}

/// Tracks the target in the next picture, which has the size of the first one.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_update(
    tracker: *mut FoveateTracker,
    picture: Option<&FoveatePicture>,
    result: Option<&mut MaybeUninit<FoveateResult>>,
) -> FoveateCode {
    enter(|| {
        let result = result.ok_or_else(|| Failure::null("result"))?;
        show(tracker, picture, |t: &mut Tracker, image| {
            result.write(FoveateResult::of(&t.update(image)?));
            Ok(())
        })
    })
}

/// Sets the time of the next picture, seconds from any origin. If frames were dropped before it, the particles move for as many frames
/// more, 30 at most; at a constant rate nothing changes.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_set_time(tracker: *mut FoveateTracker, seconds: f64) -> FoveateCode {
    enter(|| {
        if !seconds.is_finite() {
            return Err(Failure::invalid(format!("seconds: expected a finite number, found {seconds}")));
        }
        with(tracker, |working: &mut Working<Tracker>| {
            working.tracker.set_time(seconds);
            Ok(())
        })
    })
}

/// Predicts the target `frames` frames after the last picture, 0 to 1000000 and with fractions, from its motion: to aim a camera or an arm.
/// Status and P(lost) are those of the last picture. The tracker does not change. It fails before the first picture and after a load.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_predict(
    tracker: *const FoveateTracker,
    frames: f64,
    result: Option<&mut MaybeUninit<FoveateResult>>,
) -> FoveateCode {
    enter(|| predict(tracker, result, |t| t.predict(frames)))
}

/// Predicts as foveate_tracker_predict, for a time on the clock of foveate_tracker_set_time.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_predict_at(
    tracker: *const FoveateTracker,
    seconds: f64,
    result: Option<&mut MaybeUninit<FoveateResult>>,
) -> FoveateCode {
    enter(|| predict(tracker, result, |t| t.predict_at(seconds)))
}

/// Moves the target into this box: draws particles around it, and sets P(lost) to 0 until the next picture. The template and what was
/// learned do not change.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_reset_at(tracker: *mut FoveateTracker, bbox: FoveateBox) -> FoveateCode {
    enter(|| with(tracker, |working: &mut Working<Tracker>| Ok(working.tracker.reset_at(bbox.into())?)))
}

/// Observes a picture without tracking: one before the first, or the last one before foveate_tracker_load.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_skip(tracker: *mut FoveateTracker, picture: Option<&FoveatePicture>) -> FoveateCode {
    enter(|| skip::<Tracker, _>(tracker, picture))
}

/// Writes the state as JSON, without a final 0, to a buffer of `capacity` bytes, and its size in bytes to `size`. If the buffer is too
/// small, nothing but the size is written, and the code is FOVEATE_CODE_BUFFER: call with a capacity of 0 to get the size.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_save(
    tracker: *const FoveateTracker,
    buffer: *mut c_char,
    capacity: usize,
    size: Option<&mut MaybeUninit<usize>>,
) -> FoveateCode {
    enter(|| save::<Tracker, _>(tracker, buffer, capacity, size))
}

/// Restores a state of `size` bytes in a tracker of the same configuration. To continue bit for bit, call foveate_tracker_skip with the
/// last picture before. After an error, call foveate_tracker_init.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_tracker_load(tracker: *mut FoveateTracker, state: *const c_char, size: usize) -> FoveateCode {
    enter(|| load::<Tracker, _>(tracker, state, size))
}

/// Creates a tracker of many targets, as foveate_tracker_new. Configurations for it are "multi" and "multi-boxes", for example.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_new(
    configuration: *const c_char,
    tracker: Option<&mut MaybeUninit<*mut FoveateMulti>>,
) -> FoveateCode {
    enter(|| create::<MultiTracker, _>(configuration, tracker))
}

/// Frees a tracker; the handle is invalid afterwards. Null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_free(tracker: *mut FoveateMulti) -> FoveateCode {
    enter(|| free::<MultiTracker, _>(tracker))
}

/// Tracks all targets in the next picture. `detections` are `count` boxes of your detector; null if there are none. Writes the number of
/// active targets to `targets`; foveate_multi_targets returns them.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_update(
    tracker: *mut FoveateMulti,
    picture: Option<&FoveatePicture>,
    detections: *const FoveateDetection,
    count: usize,
    targets: Option<&mut MaybeUninit<usize>>,
) -> FoveateCode {
    enter(|| {
        let targets = targets.ok_or_else(|| Failure::null("targets"))?;
        // SAFETY: the header demands `count` detections.
        let detections = unsafe { given(detections, count, "detections") }?;
        let detections: Vec<_> = detections.iter().map(|&d| d.into()).collect();
        show(tracker, picture, |t: &mut MultiTracker, image| {
            t.update(image, &detections)?;
            targets.write(t.targets().len());
            Ok(())
        })
    })
}

/// Writes the active targets of the last picture, by id, to `results`, which has space for `capacity` of them, and their number to
/// `count`. If there are more, the code is FOVEATE_CODE_BUFFER, and only the number is written.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_targets(
    tracker: *const FoveateMulti,
    results: *mut FoveateResult,
    capacity: usize,
    count: Option<&mut MaybeUninit<usize>>,
) -> FoveateCode {
    enter(|| {
        let count = count.ok_or_else(|| Failure::null("count"))?;
        // SAFETY: the header demands space for `capacity` results.
        let results = unsafe { space(results, capacity, "results") }?;
        with(tracker, |working: &mut Working<MultiTracker>| {
            let targets = working.tracker.targets();
            count.write(targets.len());
            fits(targets.len(), capacity, "targets")?;
            results.iter_mut().zip(targets).for_each(|(to, target)| _ = to.write(FoveateResult::of(target)));
            Ok(())
        })
    })
}

/// Adds a target with its box in the picture of the last update, or restarts one. `id` is the number of the target, or 0 for the next
/// free one, which is then written to it.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_add(
    tracker: *mut FoveateMulti,
    picture: Option<&FoveatePicture>,
    bbox: FoveateBox,
    id: Option<&mut u64>,
) -> FoveateCode {
    enter(|| {
        let id = id.ok_or_else(|| Failure::null("id"))?;
        show(tracker, picture, |t: &mut MultiTracker, image| {
            *id = t.add(image, Some(*id).filter(|&id| id > 0), bbox.into())?;
            Ok(())
        })
    })
}

/// Ends the track of the target with this number permanently.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_remove(tracker: *mut FoveateMulti, id: u64) -> FoveateCode {
    let missing = || Failure::invalid(format!("no target {id} is active; foveate_multi_targets lists the active ones"));
    enter(|| {
        with(tracker, |working: &mut Working<MultiTracker>| {
            working.tracker.remove(id).then_some(()).ok_or_else(missing)
        })
    })
}

/// Observes a picture without tracking: one before the first update, or before the first update after foveate_multi_load.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_skip(tracker: *mut FoveateMulti, picture: Option<&FoveatePicture>) -> FoveateCode {
    enter(|| skip::<MultiTracker, _>(tracker, picture))
}

/// Writes the state, as foveate_tracker_save.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_save(
    tracker: *const FoveateMulti,
    buffer: *mut c_char,
    capacity: usize,
    size: Option<&mut MaybeUninit<usize>>,
) -> FoveateCode {
    enter(|| save::<MultiTracker, _>(tracker, buffer, capacity, size))
}

/// Restores a state of `size` bytes in a tracker of the same configuration; after an error nothing has changed. To continue bit for bit,
/// call foveate_multi_skip with the last picture afterwards.
#[unsafe(no_mangle)]
pub extern "C" fn foveate_multi_load(tracker: *mut FoveateMulti, state: *const c_char, size: usize) -> FoveateCode {
    enter(|| load::<MultiTracker, _>(tracker, state, size))
}

fn create<T: Follows, H>(
    configuration: *const c_char,
    tracker: Option<&mut MaybeUninit<*mut H>>,
) -> Result<(), Failure> {
    let tracker = tracker.ok_or_else(|| Failure::null("tracker"))?.write(null_mut());
    if configuration.is_null() {
        return Err(Failure::null("configuration"));
    }
    // SAFETY: the header demands a text that ends with a 0.
    let text = unsafe { CStr::from_ptr(configuration) };
    let text = text.to_str().map_err(|e| Failure::invalid(format!("configuration: expected text in UTF-8: {e}")))?;
    *tracker = handles::create::<T, H>(text)?;
    Ok(())
}

fn free<T: Follows, H>(tracker: *mut H) -> Result<(), Failure> {
    if tracker.is_null() { Ok(()) } else { handles::free::<T, H>(tracker) }
}

/// Passes a picture of the caller's memory to a tracker.
fn show<T: Follows, H>(
    tracker: *mut H,
    picture: Option<&FoveatePicture>,
    act: impl FnOnce(&mut T, &Image) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let picture = picture.ok_or_else(|| Failure::null("picture"))?;
    let shape = picture.shape()?;
    with(tracker, |Working { tracker, image }: &mut Working<T>| {
        shape.check(image.as_ref())?;
        // SAFETY: the header demands the bytes of all rows.
        let bytes = unsafe { given(picture.pixels, shape.bytes, "picture.pixels") }?;
        act(tracker, shape.read(bytes, image)?)
    })
}

fn predict(
    tracker: *const FoveateTracker,
    result: Option<&mut MaybeUninit<FoveateResult>>,
    act: impl FnOnce(&Tracker) -> foveate::Result<Seen<'static>>,
) -> Result<(), Failure> {
    let result = result.ok_or_else(|| Failure::null("result"))?;
    with(tracker, |working: &mut Working<Tracker>| {
        result.write(FoveateResult::of(&act(&working.tracker)?));
        Ok(())
    })
}

fn skip<T: Follows, H>(tracker: *mut H, picture: Option<&FoveatePicture>) -> Result<(), Failure> {
    show(tracker, picture, |t: &mut T, image| Ok(t.skip(image)?))
}

fn save<T: Follows, H>(
    tracker: *const H,
    buffer: *mut c_char,
    capacity: usize,
    size: Option<&mut MaybeUninit<usize>>,
) -> Result<(), Failure> {
    let size = size.ok_or_else(|| Failure::null("size"))?;
    // SAFETY: the header demands space for `capacity` bytes.
    let buffer = unsafe { space(buffer.cast::<u8>(), capacity, "buffer") }?;
    let state = with(tracker, |working: &mut Working<T>| Ok(working.tracker.save().to_string()))?;
    size.write(state.len());
    fits(state.len(), capacity, "bytes")?;
    buffer.iter_mut().zip(state.bytes()).for_each(|(to, byte)| _ = to.write(byte));
    Ok(())
}

fn load<T: Follows, H>(tracker: *mut H, state: *const c_char, size: usize) -> Result<(), Failure> {
    // SAFETY: the header demands `size` bytes.
    let state = unsafe { given(state.cast::<u8>(), size, "state") }?;
    let state = str::from_utf8(state)
        .map_err(|e| Failure::invalid(format!("the saved state cannot be used: expected text in UTF-8: {e}")))?
        .parse()?;
    with(tracker, |working: &mut Working<T>| Ok(working.tracker.load(&state)?))
}

fn fits(needed: usize, capacity: usize, what: &str) -> Result<(), Failure> {
    match needed <= capacity {
        true => Ok(()),
        false => Err(Failure::new(
            FoveateCode::Buffer,
            format!("there are {needed} {what}, and space for {capacity}; give a larger buffer"),
        )),
    }
}

/// Returns the values of an argument.
///
/// # Safety
/// `data` is null, or the address of `count` values that do not change during the call.
unsafe fn given<'a, T>(data: *const T, count: usize, argument: &str) -> Result<&'a [T], Failure> {
    // SAFETY: this function's own condition; `checked` refuses null, and more bytes than an address space has.
    if checked(data, count, argument)? { Ok(unsafe { slice::from_raw_parts(data, count) }) } else { Ok(&[]) }
}

/// Returns the space of an argument, which may be uninitialised.
///
/// # Safety
/// `data` is null, or the address of space for `count` values that nothing else uses during the call.
unsafe fn space<'a, T>(data: *mut T, count: usize, argument: &str) -> Result<&'a mut [MaybeUninit<T>], Failure> {
    // SAFETY: as in `given`.
    let space = |data: *mut MaybeUninit<T>| unsafe { slice::from_raw_parts_mut(data, count) };
    if checked(data, count, argument)? { Ok(space(data.cast())) } else { Ok(&mut []) }
}

/// Returns whether there are values; fails if their address is null or there are more than memory can hold.
fn checked<T>(data: *const T, count: usize, argument: &str) -> Result<bool, Failure> {
    match count.checked_mul(size_of::<T>()) {
        Some(0) => Ok(false),
        _ if data.is_null() => Err(Failure::null(argument)),
        Some(bytes) if bytes <= isize::MAX as usize && data.is_aligned() => Ok(true),
        _ => Err(Failure::invalid(format!("{argument}: {count} values at {data:p} are no array in memory"))),
    }
}

#[cfg(test)]
mod tests;
