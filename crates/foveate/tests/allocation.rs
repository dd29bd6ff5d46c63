//! After the first frames a step allocates nothing: a counting allocator says so.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{INIT, POLICIES, blueprint, frame};
use foveate::scene::Scene;

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

#[test]
fn a_step_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let videos = [1, 3].map(|planes| (0..FRAMES).map(|i| frame(i, planes)).collect::<Vec<_>>());
    pool.install(|| {
        foveate::rbm::warm();
        let before = COUNT.get();
        drop(std::hint::black_box(vec![1u8; 100]));
        assert_eq!(COUNT.get(), before + 1, "the allocator counts");
        for (i, policy) in POLICIES.into_iter().enumerate() {
            for (rbm, frames) in [(false, &videos[0]), (true, &videos[0]), (false, &videos[1]), (true, &videos[1])] {
                for below in [1.0, 0.5] {
                    let colour = frames[0].image.planes() == 3 || i == 0;
                    let blueprint = blueprint(policy, rbm, below, colour, 150);
                    let mut tracker = blueprint.tracker(5, 0).expect("parts that fit");
                    tracker.start(&frames[0], INIT).expect("a box in the picture");
                    for (t, frame) in frames.iter().enumerate().skip(1) {
                        let before = COUNT.get();
                        std::hint::black_box(tracker.step(Scene { frame, detections: &[] }));
                        let count = COUNT.get() - before;
                        let what = format!("{policy}, rbm {rbm}, below {below}, {} planes", frame.image.planes());
                        assert!(t < WARM_UP || count == 0, "{count} allocations in frame {t}: {what}");
                    }
                }
            }
        }
    });
}
