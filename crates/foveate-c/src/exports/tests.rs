//! Calls as a C program makes them, in memory that ends where the arguments end, so that a memory checker finds a byte too many.

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

/// Times mean what they mean in Rust: where frames were dropped, the results are those of `Tracker::set_time`.
#[test]
fn a_gap_in_the_times_is_predicted_as_in_rust() {
    let (pixels, stride) = bytes(1);
    let picture = picture(&pixels, stride, FoveateFormat::Grey);
    let image = picture.shape().and_then(|shape| shape.read(&pixels[1..], &mut None).cloned()).expect("a picture");
    let times: Vec<f64> = (0..12).map(|t| f64::from(t) + if t < 11 { 0.0 } else { 7.0 }).collect();
    let in_rust = |times: &[f64]| {
        let mut tracker = Tracker::new(foveate::Config::named_or_parsed(TINY.to_str().expect("UTF-8")).expect("TOML"))
            .expect("it fits");
        tracker.set_time(times[0]);
        tracker.init(&image, BOX.into()).expect("inside");
        let mut last = None;
        for &time in &times[1..] {
            tracker.set_time(time);
            last = Some(FoveateResult::of(&tracker.update(&image).expect("it has the size")));
        }
        last.expect("a result").covariance
    };
    let mut tracker = MaybeUninit::uninit();
    ok(foveate_tracker_new(TINY.as_ptr(), Some(&mut tracker)));
    // SAFETY: the call wrote it.
    let tracker = unsafe { tracker.assume_init() };
    ok(foveate_tracker_set_time(tracker, times[0]));
    ok(foveate_tracker_init(tracker, Some(&picture), BOX));
    let mut result = MaybeUninit::uninit();
    for &time in &times[1..] {
        ok(foveate_tracker_set_time(tracker, time));
        ok(foveate_tracker_update(tracker, Some(&picture), Some(&mut result)));
    }
    // SAFETY: the call wrote it.
    let result: FoveateResult = unsafe { result.assume_init() };
    let even: Vec<f64> = (0..12).map(f64::from).collect();
    assert_eq!(result.covariance, in_rust(&times));
    assert_ne!(result.covariance, in_rust(&even), "the gap matters");
    assert_eq!(foveate_tracker_set_time(tracker, f64::NAN), FoveateCode::Invalid);
    ok(foveate_tracker_free(tracker));
    assert_eq!(foveate_tracker_set_time(tracker, 1.0), FoveateCode::Handle);
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
