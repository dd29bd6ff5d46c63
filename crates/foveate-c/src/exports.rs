//! The functions of `foveate.h`. The header's promises about memory are the safety conditions of this file: a pointer is null, or the
//! address of as many readable or writable values as the function's comment states.
#![allow(unreachable_pub)] // C reaches these functions by the linker's names

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::ptr::null_mut;
use std::slice;

use foveate::{Image, MultiTracker, Tracker};

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

/// Calls as a C program makes them, in memory that ends where the arguments end, so that a memory checker finds a byte too many.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::FoveateFormat;

    const TINY: &CStr = c"particles = 4
dynamics = { kind = \"autoregressive\", damping = 1.0, velocity = 0.04, position = 0.08, scale_pull = 0.9, log_scale = 0.0 }
retina = { kind = \"foveal\", side = 4, rings = [[4, 1]] }
encoder = { kind = \"raw\" }
likelihood = { distance = \"cosine\", sharpness = 30 }
policy = { kind = \"fixed\" }
";
    const BOX: FoveateBox = FoveateBox { x: 3.0, y: 2.0, width: 4.0, height: 4.0 };

    /// Bytes of a picture of 12 x 9 pixels, rows apart by 5 bytes more than they have, at an address that is a multiple of nothing.
    fn bytes(depth: usize) -> (Vec<u8>, usize) {
        let stride = 12 * depth + 5;
        let count = stride * 8 + 12 * depth;
        ((0..=count).map(|i| (i * i / 7) as u8).collect(), stride)
    }

    fn picture(pixels: &[u8], stride: usize, format: FoveateFormat) -> FoveatePicture {
        FoveatePicture { pixels: pixels[1..].as_ptr(), width: 12, height: 9, stride, format: format as i32 }
    }

    fn ok(code: FoveateCode) {
        // SAFETY: the text ends with a 0.
        let text = unsafe { CStr::from_ptr(foveate_last_error()) };
        assert_eq!(code, FoveateCode::Ok, "{text:?}");
    }

    #[test]
    fn one_target_is_read_and_written_within_its_memory() {
        for (format, depth) in [(FoveateFormat::Grey, 1), (FoveateFormat::Bgr, 3), (FoveateFormat::Rgba, 4)] {
            let (pixels, stride) = bytes(depth);
            let picture = picture(&pixels, stride, format);
            let mut tracker = MaybeUninit::uninit();
            ok(foveate_tracker_new(TINY.as_ptr(), Some(&mut tracker)));
            // SAFETY: the call wrote it.
            let tracker = unsafe { tracker.assume_init() };
            ok(foveate_tracker_init(tracker, Some(&picture), BOX));
            let mut result = MaybeUninit::uninit();
            ok(foveate_tracker_update(tracker, Some(&picture), Some(&mut result)));
            // SAFETY: the call wrote it.
            let before: FoveateResult = unsafe { result.assume_init() };
            assert!(before.id == 1 && before.bbox.width > 0.0 && before.covariance[0][0] >= 0.0, "{before:?}");

            let mut size = MaybeUninit::uninit();
            assert_eq!(foveate_tracker_save(tracker, null_mut(), 0, Some(&mut size)), FoveateCode::Buffer);
            // SAFETY: the call wrote it.
            let size = unsafe { size.assume_init() };
            let mut state: Vec<c_char> = Vec::with_capacity(size);
            let short = foveate_tracker_save(tracker, state.as_mut_ptr(), size - 1, Some(&mut MaybeUninit::uninit()));
            assert_eq!(short, FoveateCode::Buffer);
            ok(foveate_tracker_save(tracker, state.as_mut_ptr(), size, Some(&mut MaybeUninit::uninit())));
            // SAFETY: the call wrote `size` bytes.
            unsafe { state.set_len(size) };
            assert_eq!(foveate_tracker_load(tracker, state.as_ptr(), size - 1), FoveateCode::Invalid);
            ok(foveate_tracker_load(tracker, state.as_ptr(), size));
            ok(foveate_tracker_skip(tracker, Some(&picture)));
            ok(foveate_tracker_update(tracker, Some(&picture), Some(&mut result)));

            ok(foveate_tracker_free(tracker));
            assert_eq!(foveate_tracker_skip(tracker, Some(&picture)), FoveateCode::Handle);
        }
    }

    #[test]
    fn many_targets_are_read_and_written_within_their_memory() {
        let (pixels, stride) = bytes(1);
        let picture = picture(&pixels, stride, FoveateFormat::Grey);
        let text = format!("{}multi_target = {{}}\n\0", TINY.to_str().expect("UTF-8"));
        let mut tracker = MaybeUninit::uninit();
        ok(foveate_multi_new(text.as_ptr().cast(), Some(&mut tracker)));
        // SAFETY: the call wrote it.
        let tracker = unsafe { tracker.assume_init() };
        let detections = [FoveateDetection { bbox: BOX, score: 0.9 }];
        let mut count = MaybeUninit::uninit();
        ok(foveate_multi_update(tracker, Some(&picture), null_mut(), 0, Some(&mut count)));
        let mut id = 7;
        ok(foveate_multi_add(tracker, Some(&picture), BOX, Some(&mut id)));
        assert_eq!(id, 7);
        ok(foveate_multi_update(tracker, Some(&picture), detections.as_ptr(), 1, Some(&mut count)));
        // SAFETY: the call wrote it.
        let count = unsafe { count.assume_init() };
        let mut results: Vec<FoveateResult> = Vec::with_capacity(count);
        let (room, mut written) = (results.as_mut_ptr(), MaybeUninit::uninit());
        assert_eq!(foveate_multi_targets(tracker, null_mut(), 0, Some(&mut written)), FoveateCode::Buffer);
        ok(foveate_multi_targets(tracker, room, count, Some(&mut written)));
        // SAFETY: the call wrote `count` results.
        unsafe { results.set_len(count) };
        assert_eq!(results[0].id, 7);
        let apart = room.wrapping_byte_add(1);
        assert_eq!(foveate_multi_targets(tracker, apart, count, Some(&mut written)), FoveateCode::Invalid);
        let apart = detections.as_ptr().wrapping_byte_add(4);
        assert_eq!(foveate_multi_update(tracker, Some(&picture), apart, 1, Some(&mut written)), FoveateCode::Invalid);
        ok(foveate_multi_remove(tracker, 7));
        ok(foveate_multi_free(tracker));
    }

    #[test]
    fn null_is_refused_by_every_function() {
        let (pixels, stride) = bytes(3);
        let good = picture(&pixels, stride, FoveateFormat::Rgb);
        let (one, many) = (null_mut::<FoveateTracker>(), null_mut::<FoveateMulti>());
        let mut result = MaybeUninit::uninit();
        let mut size = MaybeUninit::uninit();
        for code in [
            foveate_tracker_new(TINY.as_ptr(), None),
            foveate_tracker_new(null_mut(), Some(&mut MaybeUninit::uninit())),
            foveate_tracker_init(one, None, BOX),
            foveate_tracker_update(one, Some(&good), None),
            foveate_tracker_update(one, None, Some(&mut result)),
            foveate_tracker_skip(one, None),
            foveate_tracker_save(one, null_mut(), 1, Some(&mut size)),
            foveate_tracker_save(one, null_mut(), 0, None),
            foveate_tracker_load(one, null_mut(), 1),
            foveate_multi_new(null_mut(), Some(&mut MaybeUninit::uninit())),
            foveate_multi_update(many, Some(&good), null_mut(), 1, Some(&mut size)),
            foveate_multi_update(many, Some(&good), null_mut(), 0, None),
            foveate_multi_targets(many, null_mut(), 1, Some(&mut size)),
            foveate_multi_targets(many, null_mut(), 0, None),
            foveate_multi_add(many, Some(&good), BOX, None),
            foveate_multi_load(many, null_mut(), 1),
        ] {
            assert_eq!(code, FoveateCode::Invalid);
        }
        for code in [
            foveate_tracker_init(one, Some(&good), BOX),
            foveate_tracker_save(one, null_mut(), 0, Some(&mut size)),
            foveate_multi_skip(many, Some(&good)),
            foveate_multi_save(many, null_mut(), 0, Some(&mut size)),
            foveate_multi_remove(many, 1),
        ] {
            assert_eq!(code, FoveateCode::Handle);
        }
        ok(foveate_tracker_free(one));
        ok(foveate_multi_free(many));
        // SAFETY: the text ends with a 0.
        assert_eq!(unsafe { CStr::from_ptr(foveate_version()) }.to_str(), Ok(env!("CARGO_PKG_VERSION")));
    }
}
