//! Recognition as a user meets it: a model is trained, and a track reports the class of its target.

use std::path::Path;
use std::process::{Command, Output};

fn foveate(dir: &Path, args: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_foveate");
    Command::new(program).current_dir(dir).env("FOVEATE_DATA", dir).args(args).output().expect("it starts")
}

fn said(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Blots instead of digits, as IDX files: enough for an untrained model.
fn write_digits(dir: &Path) {
    for (name, n) in [("train", 120u32), ("t10k", 20)] {
        let mut images = [2051, n, 28, 28].map(u32::to_be_bytes).concat();
        let mut labels = [2049, n].map(u32::to_be_bytes).concat();
        for i in 0..n {
            images.extend((0..784u32).map(|p| if (p * (i % 10 + 3) / 7) % 11 < 3 { 255 } else { 0 }));
            labels.push((i % 10) as u8);
        }
        std::fs::write(dir.join(format!("{name}-images-idx3-ubyte")), images).expect("a writable folder");
        std::fs::write(dir.join(format!("{name}-labels-idx1-ubyte")), labels).expect("a writable folder");
    }
}

#[test]
fn a_track_says_what_it_follows() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    write_digits(dir);
    let train = ["train", "fixations", "--data", ".", "--out", "m.safetensors", "--set", "config=digits", "--set"];
    said(&foveate(
        dir,
        &[&train[..], &["training.hidden=8", "--set", "training.factors=8", "--set", "training.epochs=1"]].concat(),
    ));
    said(&foveate(dir, &["synth", "clutter", "--frames", "8", "--out", "video"]));
    let track = |out: &str, more: &[&str]| {
        said(&foveate(dir, &[&["track", "video", "-c", "digits", "--no-video", "-o", out][..], more].concat()))
    };
    assert!(!track("plain", &[]).contains("Recognised"));
    let words = track("named", &["--recognise", "m.safetensors"]);
    assert!(words.contains("Recognised as class "), "{words}");
    let read = |name: &str| std::fs::read_to_string(dir.join(name)).expect("it was written");
    assert_eq!(read("plain/boxes.txt"), read("named/boxes.txt"), "the track stays the same");
    let last = read("named/track.csv").lines().last().expect("frames").split(',').rev().nth(1).map(str::to_owned);
    let json = track("json", &["--recognise", "m.safetensors", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON alone");
    assert_eq!(Some(json["class"][0].to_string()), last);

    // Settings of what takes the configuration's place.
    track("count", &["--recognise", "m.safetensors", "--set", "recogniser.accumulate=count", "--set", "particles=100"]);
    assert_ne!(read("count/track.csv"), read("named/track.csv"), "each frame is one vote");
    let wrong = ["track", "video", "-c", "digits", "--recognise", "m.safetensors", "--set", "recogniser.none=1"];
    let message = String::from_utf8_lossy(&foveate(dir, &wrong).stderr).into_owned();
    assert!(message.contains("recogniser.none=1") && message.contains("unknown field"), "{message}");

    // The shipped model has the digits as classes, and the help names them.
    let words = track("shipped", &["--recognise"]);
    assert!(words.contains("Recognised as digit ") && read("shipped/boxes.txt") == read("plain/boxes.txt"), "{words}");
    let warned =
        foveate(dir, &["track", "video", "-c", "digits", "--no-video", "--until", "2", "--recognise", "-o", "warned"]);
    let words = String::from_utf8_lossy(&warned.stderr).into_owned();
    assert!(words.contains("knows the digits 0 to 9 alone") && words.contains("train classifier"), "{words}");
    assert!(!said(&warned).is_empty() && read("warned/track.csv").contains(",digit "), "{}", read("warned/track.csv"));
    let missing = foveate(dir, &["track", "video", "--recognise", "gone.safetensors"]);
    let words = String::from_utf8_lossy(&missing.stderr).into_owned();
    assert!(!missing.status.success() && words.contains("gone.safetensors"), "{words}");
}
