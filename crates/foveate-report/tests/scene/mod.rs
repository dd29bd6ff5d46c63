//! A quick configuration without its policy, and the frames of a short video.

use foveate_core::scene::Image;
use foveate_video::Frame;

pub(crate) const CONFIG: &str = r#"
particles = 40
[dynamics]
kind = "autoregressive"
[retina]
kind = "foveal"
side = 28.0
rings = [[8, 2], [16, 4]]
[encoder]
kind = "raw"
[likelihood]
distance = "cosine"
sharpness = 20.0
[policy]
"#;

pub(crate) fn frame(index: usize) -> Frame {
    let data = (0..64 * 48).map(|i| (60 + 37 * (i % 64 + index) * (i / 64) % 190) as u8).collect();
    Frame { index, time: index as f64 / 25.0, image: Image::new(64, 48, 1, data).expect("64 x 48") }
}
