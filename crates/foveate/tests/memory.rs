//! How much memory targets take: a counting allocator says so.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use foveate::scene::Image;
use foveate::{BBox, MultiTracker};

static LIVE: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LIVE.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const SIZE: (usize, usize) = (640, 480);

fn picture(t: usize) -> Image {
    let pixel = |k: usize| ((k % SIZE.0 + 2 * t) * 37 % 251 + (k / SIZE.0) * 91 % 83) as u8;
    Image::new(SIZE.0, SIZE.1, 3, (0..3 * SIZE.0 * SIZE.1).map(|k| pixel(k).wrapping_mul(3)).collect()).expect("whole")
}

/// Bytes of each of `n` targets of 24 × 48 pixels after a few frames.
fn each(config: &str, n: usize) -> usize {
    let mut many = MultiTracker::new(config).expect("it ships");
    let pictures: Vec<Image> = (0..5).map(picture).collect();
    many.update(&pictures[0], &[]).expect("a picture");
    let before = LIVE.load(Ordering::Relaxed);
    for i in 0..n {
        let (x, y) = ((i % 20) as f64 * 30.0 + 5.0, (i / 20 % 10) as f64 * 40.0 + 3.0);
        many.add(&pictures[0], None, BBox::new(x, y, 24.0, 48.0)).expect("a box");
    }
    let began = std::time::Instant::now();
    for picture in &pictures[1..] {
        many.update(picture, &[]).expect("a picture");
    }
    println!("{config}: {n} targets, {:.1} ms a frame", began.elapsed().as_secs_f64() * 1e3 / 4.0);
    let left = many.targets().len().max(1);
    (LIVE.load(Ordering::Relaxed) - before) / left
}

#[test]
fn a_target_takes_little() {
    for config in ["multi-boxes", "multi", "multi-motion", "natural"] {
        for n in [10, 100] {
            println!("{config} {n}: {} kB each", each(config, n) / 1000);
        }
    }
}
