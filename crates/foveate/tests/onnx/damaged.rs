//! Files that are cut off, changed, or need too much memory: errors, never panics.

use foveate::config::DetectorConfig;
use foveate::memory;
use foveate::scene::object_detector::Settings;

use super::networks::{boxes, deep, linear, numbers};
use super::writer::{Attribute, Network};
use super::{File, check, said};

const ONNX: &str = "{ kind = \"onnx\", model = \"a.onnx\" }";
const RETINA: &str = "rings = [[32, 1]]";

/// A file whose end is missing is refused, or is whole without it.
#[test]
fn cut_files_are_refused() {
    let file = deep(3);
    let places = (0..15).map(|k| k * file.len() / 15).chain([1, 2, file.len() - 1, file.len() - 2]);
    for at in places {
        let message = said(check(RETINA, ONNX, &file[..at]));
        assert!(message.contains("a.onnx"), "{at} of {} bytes: {message:?}", file.len());
    }
    assert_eq!(said(check(RETINA, ONNX, &file)), "");
}

/// 300 files with a few bytes changed, by fixed random numbers: the result is an error or an encoder.
#[test]
fn changed_files_do_not_panic() {
    let (weights, bias) = (numbers(1024 * 3, 1), numbers(3, 2));
    let files = [
        deep(1),
        linear(0, 1024, 3, &weights, &bias),
        boxes(&[1, 3, 32, 32], &[1, 6, 9], &numbers(54, 3), &numbers(54, 4)),
    ];
    let mut refused = 0;
    for k in 0..300usize {
        let mut file = files[k % 3].clone();
        // Weights are most of a file: the graph is at its ends.
        for (n, r) in numbers(1 + k % 4, k as u32 + 5).into_iter().enumerate() {
            let near = (r + 0.5) * if n % 2 == 0 { 400.0 } else { (file.len() - 2) as f32 };
            let at = if k % 2 == 0 { near as usize } else { file.len() - 1 - near as usize };
            let at = at.min(file.len() - 1);
            file[at] = file[at].wrapping_add(1 + (k % 250) as u8);
        }
        let encoder = said(check(RETINA, ONNX, &file));
        let detector = said(DetectorConfig::Onnx(Settings::of("d.onnx")).read(&File(file)));
        refused += usize::from(!encoder.is_empty()) + usize::from(!detector.is_empty());
    }
    assert!(refused > 300, "only {refused} of 600 were refused");
}

#[test]
fn files_without_a_network_are_refused() {
    for (file, part) in
        [(&b""[..], "no"), (b"a text that is no network", "ONNX"), (&[0xff; 64], "ONNX"), (&deep(1)[..9], "ONNX")]
    {
        let message = said(check(RETINA, ONNX, file));
        assert!(message.contains("a.onnx") && message.contains(part), "{message:?}");
    }
    let unknown = Network::new(&[0, 1024], &[0, 1024]).node("Teleport", &["x"], "y", &[]).file();
    let message = said(check(RETINA, ONNX, &unknown));
    assert!(message.contains("a.onnx") && message.contains("Teleport"), "{message}");
    let nowhere = Network::new(&[0, 1024], &[0, 1024]).node("Identity", &["x"], "z", &[]).file();
    assert!(said(check(RETINA, ONNX, &nowhere)).contains("a.onnx"));
    let random = Network::new(&[0, 1024], &[0, 1024])
        .node("RandomUniformLike", &["x"], "r", &[Attribute::Float("high", 1.0)])
        .node("Add", &["x", "r"], "y", &[])
        .file();
    assert!(said(check(RETINA, ONNX, &random)).contains("a.onnx"));
}

/// Checked before allocation: a small file with values of 4 TB.
#[test]
fn memory_is_asked_for() {
    let large = Network::new(&[0, 1024], &[0, 1])
        .ints("sides", &[3], &[1 << 10, 1 << 20, 1 << 10])
        .node("Reshape", &["x", "as"], "flat", &[])
        .ints("as", &[3], &[-1, 1, 1024])
        .node("Expand", &["flat", "sides"], "e", &[])
        .node("ReduceSum", &["e"], "y", &[Attribute::Int("keepdims", 1)])
        .file();
    let message = said(check(RETINA, ONNX, &large));
    assert!(message.contains("a.onnx") && message.contains("--max-memory"), "{message}");
    assert!(memory::limit() > 0);
}
