//! Drawn digits as MNIST's files.

use std::path::Path;

/// Writes `n` digits of a set (`train` or `t10k`): digit `i` is of class `i % classes`, white where `ink(i, x, y)` holds, else black.
///
/// # Panics
/// Where the folder is not writable.
pub fn write_digits(folder: &Path, set: &str, n: u32, classes: u32, ink: impl Fn(u32, u32, u32) -> bool) {
    let mut images = [2051, n, 28, 28].map(u32::to_be_bytes).concat();
    let mut labels = [2049, n].map(u32::to_be_bytes).concat();
    for i in 0..n {
        images.extend((0..784).map(|p| if ink(i, p % 28, p / 28) { 255 } else { 0 }));
        labels.push((i % classes) as u8);
    }
    std::fs::write(folder.join(format!("{set}-images-idx3-ubyte")), images).expect("a writable folder");
    std::fs::write(folder.join(format!("{set}-labels-idx1-ubyte")), labels).expect("a writable folder");
}
