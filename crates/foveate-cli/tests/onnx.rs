//! `foveate track` with networks from ONNX files, of a build with the feature `onnx`.
//!
//! `cargo test -p foveate-cli --features onnx --test onnx`

#[path = "../../foveate/tests/onnx/networks.rs"]
#[allow(dead_code, missing_docs)] // the library's tests use more
mod networks;
mod place;
#[path = "../../foveate/tests/onnx/writer.rs"]
#[allow(dead_code, missing_docs)] // the library's tests use more
mod writer;

use foveate::BBox;
use foveate::video::{mot::Tracks, open};
use place::{CONFIG, FRAMES, Place, errors, json};

/// A box in the middle of the input, and a weaker one of class 1 left of it; (1, 6, 7).
fn detector() -> Vec<u8> {
    let rows = [[32.0, 32.0, 16.0, 16.0, 0.9, 0.0], [12.0, 32.0, 8.0, 12.0, 0.0, 0.6], [0.0; 6]];
    let numbers: Vec<f32> = (0..42).map(|i| rows[(i % 7).min(2)][i / 7]).collect();
    let scored: Vec<f32> = (0..42).map(|i| if i / 7 < 4 { 0.0 } else { 1.0 }).collect();
    networks::boxes(&[1, 3, 64, 64], &[1, 6, 7], &numbers, &scored)
}

#[test]
fn a_network_detects() {
    let place = Place::new();
    place.write("d.onnx", detector());
    let message = |args: &[&str]| {
        let all = [&["video", "--detect", "onnx:d.onnx", "--json", "--save-detections", "d.txt"][..], args].concat();
        let summary = json(&place.tracked("many", &all));
        (summary, Tracks::read(place.path("d.txt")).expect("just written").sightings)
    };
    let (summary, found) = message(&[]);
    assert_eq!(summary["detector"], "onnx:d.onnx (--detect)");
    assert_eq!(summary["targets"], 2, "both are followed: {summary}");
    assert_eq!(found.len(), 2 * FRAMES);
    let about = open(place.path("video")).expect("a video").info().clone();
    let (w, h) = (about.width as f64, about.height as f64);
    // The picture is wider than high: it has all columns of the input, and whole rows of it.
    let rows = (64.0 * h / w).round();
    let (across, down, top) = (w / 64.0, h / rows, ((64.0 - rows) / 2.0).floor());
    let back = |x: f64, y: f64, w: f64, h: f64| BBox { x: x * across, y: (y - top) * down, w: w * across, h: h * down };
    let (middle, left) = (back(24.0, 24.0, 16.0, 16.0), back(8.0, 26.0, 8.0, 12.0));
    for (k, sighting) in found.iter().enumerate() {
        assert!(sighting.bbox.iou([&middle, &left][k % 2]) > 0.99, "{sighting:?}");
    }
    assert_eq!(message(&["--classes", "1"]).1.len(), FRAMES);
    assert_eq!(message(&["--classes", "0,1"]).1.len(), 2 * FRAMES);
    assert!(message(&["--least", "0.99"]).1.is_empty());
    assert_eq!(message(&["--layout", "yolov8"]).1, found);

    for (args, words) in [
        (&["video", "--detect", "onnx:no.onnx"][..], &["no.onnx", "cannot read"][..]),
        (&["video", "--detect", "onnx:video"], &["video", "not a regular file"]),
        (&["video", "--detect", "onnx:c.toml"], &["c.toml", "not an ONNX network"]),
        (&["video", "--detect", "onnx:"], &["onnx:MODEL"]),
        (&["video", "--detect", "onnx"], &["onnx:MODEL"]),
        (&["video", "--detect", "onnx:d.onnx", "--layout", "end-to-end"], &["d.onnx", "(1, 6, 7)", "(1, boxes, 6)"]),
        (&["video", "--detect", "onnx:d.onnx", "--classes", "2"], &["has 2", "0 to 1"]),
        (&["video", "--detect", "onnx:d.onnx", "--least", "7"], &["detector.confidence", "7"]),
        (&["video", "--detect", "motion", "--least", "0.5"], &["--least is for", "onnx:MODEL"]),
        (&["video", "--classes", "0"], &["--classes is for --detect onnx:MODEL"]),
        (&["video", "--layout", "yolov5"], &["--layout is for"]),
    ] {
        let error = place.failure(args);
        assert!(words.iter().all(|word| error.contains(word)), "{args:?}: {error}");
    }
}

/// Models lie beside the configuration; an identity network tracks as pixels do.
#[test]
fn a_network_encodes() {
    let place = Place::new();
    std::fs::create_dir(place.path("models")).expect("a writable folder");
    let with = |encoder: &str| CONFIG.replace("kind = \"raw\"", encoder);
    place.write("c.toml", with("kind = \"raw\"\nstandardise = false"));
    let raw = place.boxes("raw", &["video"]);
    let onnx = with("kind = \"onnx\"\nmodel = \"a.onnx\"");
    place.write("models/c.toml", &onnx);
    // Of any retina, one glimpse a row.
    place.write("models/a.onnx", networks::identity(&[0, 0]));
    let track = || place.run(["track", "video", "-c", "models/c.toml", "--no-video", "--no-report", "-o", "onnx"]);
    let output = track();
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(place.read("onnx/boxes.txt"), raw);
    place.write("models/a.onnx", networks::identity(&[0, 3, 32, 32]));
    let output = track();
    let error = errors(&output);
    assert!(!output.status.success() && error.contains("a.onnx") && error.contains("(N, 3, 32, 32)"), "{error}");
}
