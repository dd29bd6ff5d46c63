//! The time of a frame with features from an ONNX network, beside raw pixels.
//!
//! 160 particles on a sequence in OTB layout, one window of 32 × 32 cells, grey and colour where the sequence has it, a fixed gaze, the
//! cosine distance, one thread. `network` is three convolutions with stride 2 (16, 32 and 32 filters of 3 × 3; 512 features) of random
//! weights; `identity` returns its input, so that its time above `raw` is the cost of a call.
//!
//! `cargo bench -p foveate --features lab,onnx --bench onnx -- FOLDER`; one JSON line a figure: milliseconds of CPU
//! a frame, the best of five runs, and the mean overlap of all of them.

use std::path::{Path, PathBuf};

use foveate::config::Config;
use foveate::files::Files;
use foveate::video::{annotation, open};
use foveate::{BBox, Error, Image, Result};

mod clock;
#[path = "../tests/onnx/networks.rs"]
#[allow(dead_code, reason = "the tests use more")]
mod networks;
#[path = "../tests/onnx/writer.rs"]
#[allow(dead_code, reason = "the tests use more")]
mod writer;

const RUNS: u64 = 5;

struct File(Vec<u8>);

impl Files for File {
    fn read(&self, _: &Path) -> Result<Vec<u8>> {
        Ok(self.0.clone())
    }
}

/// Milliseconds of CPU a frame, and the mean overlap with the truth.
fn time(encoder: &str, file: &File, frames: &[Image], truth: &[Option<BBox>]) -> Result<(f64, f64)> {
    let text = format!(
        "particles = 160\ndynamics = {{ kind = \"autoregressive\", damping = 0.5, velocity = 0.25, position = 0.1 }}\n\
         retina = {{ kind = \"foveal\", side = 32, rings = [[32, 1]], colour = [[32, 1]] }}\nencoder = {encoder}\n\
         likelihood = {{ distance = \"cosine\", calibrate = {{ nats = 12, least = 10, most = 200 }} }}\npolicy = {{ kind = \"fixed\" }}\n"
    );
    let blueprint = Config::parse(&text, "bench")?.check(file)?;
    let first = truth[0].ok_or_else(|| Error::Invalid("no box in frame 1".into()))?;
    let (mut best, mut overlap, mut counted) = (f64::INFINITY, 0.0, 0);
    for seed in 1..=RUNS {
        let mut tracker = blueprint.tracker(seed)?;
        tracker.init(&frames[0], first)?;
        let mut boxes = vec![];
        let seconds = clock::seconds(|| {
            let update = |image: &Image| tracker.update(image).expect("pictures of one size").bbox;
            boxes.extend(frames[1..].iter().map(update));
        });
        best = best.min(1e3 * seconds / boxes.len() as f64);
        for (found, truth) in boxes.iter().zip(&truth[1..]).filter_map(|(found, truth)| Some((found, truth.as_ref()?)))
        {
            (overlap, counted) = (overlap + found.iou(truth), counted + 1);
        }
    }
    Ok((best, overlap / f64::from(counted.max(1))))
}

fn main() -> Result<()> {
    let Some(folder) = std::env::args().skip(1).find(|a| !a.starts_with('-')).map(PathBuf::from) else {
        println!("skipped: no folder of a sequence was given");
        return Ok(());
    };
    let frames = open(&folder)?.map(|frame| Ok(frame?.image)).collect::<Result<Vec<Image>>>()?;
    let truth = annotation::read_truth(folder.join("groundtruth_rect.txt"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    let onnx = "{ kind = \"onnx\", model = \"a.onnx\" }";
    let values = 3 * 32 * 32;
    for (name, encoder, file) in [
        ("raw", "{ kind = \"raw\" }", vec![]),
        ("identity", onnx, networks::identity(&[0, 3, 32, 32])),
        ("network", onnx, networks::deep(3)),
        (
            "linear, 256 features",
            onnx,
            networks::linear(0, values, 256, &networks::numbers(256 * values, 1), &[0.0; 256]),
        ),
    ] {
        let (ms, iou) = pool.install(|| time(encoder, &File(file), &frames, &truth))?;
        println!(r#"{{"encoder": "{name}", "frames": {}, "ms": {ms:.3}, "mean_iou": {iou:.3}}}"#, frames.len());
    }
    Ok(())
}
