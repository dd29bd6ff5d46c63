//! After the first frames a step allocates nothing, by a counting allocator.

mod common;

use foveate::files::Folder;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{INIT, POLICIES, blueprint, frame, natural, random_recogniser, with_recogniser};
use foveate::config::{Blueprint, Config};
use foveate::geometry::BBox;
use foveate::scene::Image;
use foveate::video::Frame;

thread_local!(static COUNT: Cell<usize> = const { Cell::new(0) });

struct Counting;

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise.
        unsafe { System.realloc(ptr, layout, new_size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const WARM_UP: usize = 5;
const FRAMES: usize = 30;

/// Allocations of each step of one run.
fn counts(blueprint: &Blueprint, frames: &[Frame]) -> Vec<usize> {
    let mut tracker = blueprint.tracker(5).expect("parts that fit");
    tracker.init(&frames[0].image, INIT).expect("a box in the picture");
    let step = |frame: &Frame| {
        let before = COUNT.get();
        std::hint::black_box(tracker.update(&frame.image).expect("a picture of the first size"));
        COUNT.get() - before
    };
    frames[1..].iter().map(step).collect()
}

fn alone(work: impl FnOnce() + Send) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    pool.install(|| {
        let before = COUNT.get();
        drop(std::hint::black_box(vec![1u8; 100]));
        assert_eq!(COUNT.get(), before + 1, "the allocator counts");
        work();
    });
}

#[test]
fn a_step_allocates_nothing() {
    let videos = [1, 3].map(|planes| (0..FRAMES).map(|i| frame(i, planes)).collect::<Vec<_>>());
    alone(|| {
        for (i, policy) in POLICIES.into_iter().enumerate() {
            for (rbm, frames) in [(false, &videos[0]), (true, &videos[0]), (false, &videos[1]), (true, &videos[1])] {
                for below in [1.0, 0.5] {
                    let planes = frames[0].image.planes();
                    let counts = counts(&blueprint(policy, rbm, below, planes == 3 || i == 0, 150), frames);
                    let what = format!("{policy}, rbm {rbm}, resampling below {below}, {planes} planes");
                    assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{what}: {counts:?}");
                }
            }
        }
    });
}

#[test]
fn learning_while_tracking_allocates_nothing() {
    for planes in [1, 3] {
        let frames: Vec<Frame> = (0..FRAMES).map(|i| frame(i, planes)).collect();
        alone(|| {
            let committee = Config { committee: 2, ..natural(150).config().clone() };
            let committee = committee.check(&Folder::here()).expect("parts that fit");
            for blueprint in [natural(150), committee] {
                let counts = counts(&blueprint, &frames);
                assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{planes} planes: {counts:?}");
            }
        });
    }
}

#[test]
fn recognition_allocates_nothing() {
    let (frames, (_folder, model)) = ((0..FRAMES).map(|i| frame(i, 1)).collect::<Vec<_>>(), random_recogniser());
    alone(|| {
        let alarming = "{ kind = \"random\" }\nalarm = true";
        for looking in ["", alarming, "{ kind = \"anchor\", policy = { kind = \"exp3\", gamma = 0.3 } }"] {
            for rule in ["\"sum\"", "\"count\""] {
                let blueprint = with_recogniser(&blueprint(POLICIES[3], false, 0.5, false, 100), &model, rule, looking);
                let counts = counts(&blueprint, &frames);
                assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{looking} {rule}: {counts:?}");
            }
        }
    });
}

/// Detections in the proposal and the weights, a detector, and camera motion.
#[test]
fn what_the_preprocessor_tells_allocates_nothing() {
    let frames: Vec<Frame> = (0..FRAMES).map(|i| frame(i, 1)).collect();
    let base = blueprint(POLICIES[3], false, 0.5, false, 100).config().to_toml();
    let text = base.replace("[proposal]\nkind = \"prior\"\n", "")
        + "\n[proposal]\nkind = \"mixture\"\n[detection_likelihood]\n[camera_motion]\nlocal = 0.5\n[detector]\nkind = \"saliency\"\n";
    let blueprint = Config::parse(&text, "test").and_then(|c| c.check(&Folder::here())).expect("a good configuration");
    alone(|| {
        let counts = counts(&blueprint, &frames);
        assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{counts:?}");
    });
}

/// Two targets that hide each other for a while, none initiated, none detected.
#[test]
fn many_targets_allocate_nothing() {
    let config = Config::builtin("multi").expect("it ships with the library").expect("it is right");
    let blueprint = Config { particles: 150, ..config }.check(&Folder::here()).expect("parts that fit");
    let frames: Vec<Frame> = (0..FRAMES).map(|i| frame(i, 3)).collect();
    alone(|| {
        let mut tracker = blueprint.multi_tracker(5).expect("trackers");
        tracker.update(&frames[0].image, &[]).expect("the first picture");
        for bbox in [INIT, BBox { x: INIT.x + 10.0, ..INIT }] {
            tracker.add(&frames[0].image, None, bbox).expect("a box in the picture");
        }
        let step = |frame: &Frame| {
            let before = COUNT.get();
            std::hint::black_box(tracker.update(&frame.image, &[]).expect("a picture of the first size"));
            COUNT.get() - before
        };
        let counts: Vec<usize> = frames[1..].iter().map(step).collect();
        assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{counts:?}");
    });
}

#[test]
fn convolution_allocates_nothing() {
    let frames: Vec<Frame> = (0..FRAMES).map(|i| frame(i, 1)).collect();
    alone(|| {
        let config = Config::builtin("natural-learned").expect("it ships").expect("a good configuration");
        let config = config.set("encoder.kind=kmeans").expect("it ships, too");
        let blueprint = Config { particles: 100, ..config }.check(&Folder::here()).expect("parts that fit");
        let counts = counts(&blueprint, &frames);
        assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{counts:?}");
    });
}

/// The target is gone: for 200 frames particles spread over the picture and beyond, and the read area grows with them.
#[test]
fn a_lost_target_costs_no_memory() {
    let (w, h) = (500, 400);
    for planes in [1, 3] {
        let picture = |value: &dyn Fn(usize) -> u8| {
            let data = (0..planes * w * h).map(value).collect();
            Frame { index: 0, time: 0.0, image: Image::new(w, h, planes, data).expect("bytes") }
        };
        let first = picture(&|i| ((i % w) * (i / w) % 251) as u8);
        let gone = picture(&|_| 9);
        let frames: Vec<Frame> = std::iter::once(first).chain(std::iter::repeat_n(gone, 200)).collect();
        alone(|| {
            let counts = counts(&blueprint(POLICIES[3], false, 0.5, planes == 3, 150), &frames);
            assert!(counts[WARM_UP..].iter().all(|&count| count == 0), "{planes} planes: {counts:?}");
        });
    }
}
