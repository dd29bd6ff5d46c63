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

/// Times, predictions and a box by hand mean what they mean in Rust, bit for bit.
#[test]
fn gaps_predictions_and_moves_are_those_of_rust() {
    let (pixels, stride) = bytes(1);
    let picture = picture(&pixels, stride, FoveateFormat::Grey);
    let image = picture.shape().and_then(|shape| shape.read(&pixels[1..], &mut None).cloned()).expect("a picture");
    let config = foveate::Config::named_or_parsed(TINY.to_str().expect("UTF-8")).expect("TOML");
    let time = |t: i32| f64::from(t) + if t < 11 { 0.0 } else { 7.0 };
    let in_rust = |time: &dyn Fn(i32) -> f64| {
        let mut tracker = Tracker::new(config.clone()).expect("it fits");
        tracker.set_time(time(0));
        tracker.init(&image, BOX.into()).expect("inside");
        for t in 1..12 {
            tracker.set_time(time(t));
            tracker.update(&image).expect("it has the size");
        }
        let mut all = vec![tracker.predict(2.5).expect("a result"), tracker.predict_at(time(11) + 2.0).expect("times")];
        tracker.reset_at(BOX.into()).expect("a target");
        all.push(tracker.update(&image).expect("it has the size").without_views());
        all.iter().map(|seen| FoveateResult::of(seen).covariance).collect::<Vec<_>>()
    };
    let mut tracker = MaybeUninit::uninit();
    ok(foveate_tracker_new(TINY.as_ptr(), Some(&mut tracker)));
    // SAFETY: the call wrote it.
    let tracker = unsafe { tracker.assume_init() };
    let mut result = MaybeUninit::uninit();
    ok(foveate_tracker_set_time(tracker, time(0)));
    ok(foveate_tracker_init(tracker, Some(&picture), BOX));
    for t in 1..12 {
        ok(foveate_tracker_set_time(tracker, time(t)));
        ok(foveate_tracker_update(tracker, Some(&picture), Some(&mut result)));
    }
    let mut all = vec![];
    // SAFETY: each call before it wrote the result.
    let mut keep = |result: &MaybeUninit<FoveateResult>| all.push(unsafe { result.assume_init_ref() }.covariance);
    ok(foveate_tracker_predict(tracker, 2.5, Some(&mut result)));
    keep(&result);
    ok(foveate_tracker_predict_at(tracker, time(11) + 2.0, Some(&mut result)));
    keep(&result);
    ok(foveate_tracker_reset_at(tracker, BOX));
    ok(foveate_tracker_update(tracker, Some(&picture), Some(&mut result)));
    keep(&result);
    assert_eq!(all, in_rust(&time));
    assert_ne!(all, in_rust(&|t| f64::from(t)), "the gap matters");
    for code in [
        foveate_tracker_set_time(tracker, f64::NAN),
        foveate_tracker_predict(tracker, -1.0, Some(&mut result)),
        foveate_tracker_predict_at(tracker, f64::NAN, Some(&mut result)),
        foveate_tracker_reset_at(tracker, FoveateBox { width: f64::NAN, ..BOX }),
    ] {
        assert_eq!(code, FoveateCode::Invalid);
    }
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
        foveate_tracker_predict(one, 1.0, None),
        foveate_tracker_predict_at(one, 1.0, None),
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
        foveate_tracker_set_time(one, 1.0),
        foveate_tracker_predict(one, 1.0, Some(&mut result)),
        foveate_tracker_predict_at(one, 1.0, Some(&mut result)),
        foveate_tracker_reset_at(one, BOX),
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
