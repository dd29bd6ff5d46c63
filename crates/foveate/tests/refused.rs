//! With an allocator that refuses large requests: code that allocates according to a file or a setting checks first, and returns an error.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use foveate::config::Config;
use foveate::files::Nowhere;
use foveate::lab::Digits;
use foveate::scene::Image;
use foveate::video::{Decoder, Options, decode_image, encode_jpeg, encode_png, open_with};
use foveate::{BBox, Error};

/// Bytes from which on an allocation fails.
static MOST: AtomicUsize = AtomicUsize::new(usize::MAX);

struct Mean;

// SAFETY: every call is handed to the system's allocator as it came, or fails.
unsafe impl GlobalAlloc for Mean {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() >= MOST.load(Ordering::Relaxed) {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static MEAN: Mean = Mean;

/// Returns the error of `work` while requests of a megabyte or more are refused. An unchecked allocation would end this test.
fn refused<T>(work: impl FnOnce() -> Result<T, Error>) {
    MOST.store(1 << 20, Ordering::Relaxed);
    let result = work().map(drop);
    MOST.store(usize::MAX, Ordering::Relaxed);
    let said = result.expect_err("a refusal").to_string();
    assert!(said.contains("which the system does not give"), "{said}");
}

#[test]
fn who_asks_for_much_asks_first() {
    let place = std::env::temp_dir().join(format!("foveate-refused-{}", std::process::id()));
    std::fs::create_dir_all(&place).expect("a folder");
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(place.join(name), bytes).expect("a writable folder");
        place.join(name)
    };
    let text = |error: String| Error::Invalid(error);

    // Pictures, by themselves and in a folder.
    let picture = Image::new(700, 500, 3, vec![90; 3 * 700 * 500]).expect("whole");
    let (png, jpeg) = (encode_png(&picture), encode_jpeg(&picture, 80));
    refused(|| decode_image(&png).map_err(text));
    refused(|| decode_image(&jpeg).map_err(text));
    write("1.jpg", &jpeg);
    let open = |path: &Path| {
        let options = Options { decoder: Decoder::Builtin, ..Options::default() };
        open_with(path, &options)?.next().expect("a frame or an error")
    };
    refused(|| open(&place));

    // Streams.
    let y4m = write("a.y4m", b"YUV4MPEG2 W1920 H1080 F30:1\nFRAME\n");
    refused(|| open(&y4m));

    // Settings.
    let config = Config::builtin("natural-raw").expect("it ships").expect("it is right");
    refused(|| config.set("particles=50000")?.check(&Nowhere));

    // Digits.
    let mut images = vec![0, 0, 8, 3];
    [60_000u32, 28, 28].iter().for_each(|n| images.extend(n.to_be_bytes()));
    let (images, labels) = (write("images", &images), write("labels", &[0, 0, 8, 1, 0, 0, 0xea, 0x60]));
    refused(|| Digits::read(&images, &labels));

    // Many targets at once.
    let small = Image::new(64, 48, 1, vec![90; 64 * 48]).expect("whole");
    let config = Config::builtin("multi").expect("it ships").expect("it is right");
    let mut many = config.check(&Nowhere).and_then(|parts| parts.multi_tracker(1)).expect("parts that fit");
    many.update(&small, &[]).expect("a picture");
    refused(|| (0..1000).try_for_each(|_| many.add(&small, None, BBox::new(9.0, 9.0, 12.0, 12.0)).map(drop)));
    std::fs::remove_dir_all(place).expect("it was made");
}
