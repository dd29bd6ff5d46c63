//! Photographs to learn from, as far as a test needs such.

use std::path::Path;

/// Ten pictures of stripes and noise, in a folder of their own: beside them a picture of filters would count as one.
pub(crate) fn write_photographs(dir: &Path) {
    let dir = dir.join("natural");
    std::fs::create_dir(&dir).expect("a writable folder");
    for i in 0..10u32 {
        let wave = |x: u32, y: u32| ((x * (i + 1) + y * (11 - i)) as f32 * 0.1).sin() * 90.0 + (x * y % 31) as f32;
        let picture = image::GrayImage::from_fn(120, 90, |x, y| image::Luma([(wave(x, y) + 100.0) as u8]));
        picture.save(dir.join(format!("{i}.png"))).expect("a writable folder");
    }
}
