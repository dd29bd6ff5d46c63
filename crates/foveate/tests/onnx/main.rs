//! Networks from ONNX files, made here byte by byte: as first layers, as detectors, and damaged.
//!
//! `cargo test -p foveate --features lab,onnx --test onnx`

mod damaged;
mod detector;
mod encoder;
mod networks;
mod writer;

use std::path::Path;

use foveate::config::{Blueprint, Config};
use foveate::files::Files;
use foveate::geometry::BBox;
use foveate::scene::Image;
use foveate::{Error, Result};

/// One file in memory, by any name.
struct File(Vec<u8>);

impl Files for File {
    fn read(&self, _: &Path) -> Result<Vec<u8>> {
        Ok(self.0.clone())
    }
}

/// A configuration with this retina and encoder, checked with this file.
fn check(retina: &str, encoder: &str, file: &[u8]) -> Result<Blueprint> {
    let text = format!(
        "seed = 3\nparticles = 100\ndynamics = {{ kind = \"autoregressive\" }}\nretina = {{ kind = \"foveal\", side = 24, {retina} }}\n\
         encoder = {encoder}\nlikelihood = {{ distance = \"cosine\", calibrate = {{ nats = 12, least = 5, most = 500 }} }}\n\
         policy = {{ kind = \"hedge\", gamma = 0.5 }}\n"
    );
    Config::parse(&text, "test")?.check(&File(file.to_vec()))
}

/// Where the target of [`picture`] is.
fn truth(index: usize) -> BBox {
    BBox { x: 20.0 + index as f64, y: 30.0 + (index / 2) as f64, w: 24.0, h: 20.0 }
}

/// A patch with a texture of its own drifts over another; 1 or 3 planes of 120 × 90.
fn picture(index: usize, planes: usize) -> Image {
    let (w, h, at) = (120, 90, truth(index));
    let pixel = |plane: usize, x: usize, y: usize| {
        let (u, v) = (x as isize - at.x as isize, y as isize - at.y as isize);
        let plane = plane as isize;
        if (0..24).contains(&u) && (0..20).contains(&v) {
            (80 + 30 * plane + (37 * (u / 3) * (v / 3 + plane)) % 120) as u8
        } else {
            ((x * y + 13 * (x / 9)) % 97) as u8
        }
    };
    let data = (0..planes * w * h).map(|i| pixel(i / (w * h), i % w, i / w % h)).collect();
    Image::new(w, h, planes, data).expect("120 x 90")
}

/// The boxes of 15 frames, on this many threads.
fn track(blueprint: &Blueprint, planes: usize, threads: usize) -> Vec<BBox> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let mut tracker = blueprint.tracker(7).expect("a checked configuration");
        tracker.init(&picture(0, planes), truth(0)).expect("a box in the picture");
        (1..15).map(|t| tracker.update(&picture(t, planes)).expect("a picture of that size").bbox).collect()
    })
}

/// The error of a file; never a panic.
fn said<T>(result: Result<T>) -> String {
    match result {
        Ok(_) => String::new(),
        Err(error @ (Error::Malformed { .. } | Error::Config(_) | Error::Memory(_))) => error.to_string(),
        Err(error) => panic!("{error:?} is no error of a file or a configuration"),
    }
}
