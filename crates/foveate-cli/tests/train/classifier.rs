//! `foveate train classifier` in use: a folder of drawn digits for each class, a model, and a track that reports the
//! class by its name.

use foveate::lab::Digits;
use foveate::scene::Image;
use foveate::video::save_png;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::training::{fails, said, whole_and_cut};

/// Names of three classes, one of which no table takes as it is.
const CLASSES: [(u8, &str); 3] = [(0, "zero"), (1, "one, a stroke"), (3, "three")];

/// Drawn digits of each class, framed by black.
fn write_pictures(dir: &Path) {
    let digits = Digits::drawn(5, 20);
    for (digit, name) in CLASSES {
        std::fs::create_dir_all(dir.join(name)).expect("a writable folder");
        for (i, index) in digits.of_class(digit).into_iter().enumerate() {
            let picture = Image::new(28, 28, 1, digits.digit(index).to_vec()).expect("28 x 28 pixels");
            save_png(dir.join(name).join(format!("{i:02}.png")), &picture).expect("a writable folder");
        }
    }
}

fn command(dir: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.current_dir(dir).args(args).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_user_s_classes_are_learned_and_a_track_says_them_by_name() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    write_pictures(&dir.join("pictures"));
    let train = |out| {
        command(dir, &["train", "classifier", "--data", "pictures", "--epochs", "25", "--threads", "2", "--out", out])
    };
    let (words, rest) = whole_and_cut(dir, &train, &["epoch 3/25"]);
    assert!(
        words.contains("48 pictures to learn from, 12 held out") && words.contains("one, a stroke: 16 and 4"),
        "{words}"
    );
    // Three classes of pen strokes that differ as a ring, a line and two bows: all twelve right.
    assert!(words.contains("held-out pictures as they are: 100.0 % right"), "{words}");

    assert!(rest.contains("resuming cut.safetensors.checkpoint"), "{rest}");

    // Digits of another pen, alone on black.
    for (digit, name) in CLASSES {
        let scene = ["synth", "clutter", "--frames", "12", "--seed", "3", "--distractors", "0", "--out", name];
        said(command(dir, &[&scene[..], &["--digit", &digit.to_string()]].concat()));
        let track =
            ["track", name, "-c", "digits", "--no-video", "--trace", "-o", "out", "--recognise", "whole.safetensors"];
        let words = said(command(dir, &track));
        assert!(words.contains(&format!("Recognised as {name}, with probability")), "{words}");
        let read = |file: &str| std::fs::read_to_string(dir.join("out").join(file)).expect("it was written");
        let last = read("track.csv").lines().last().expect("frames").to_owned();
        let field = if name.contains(',') { format!(",\"{name}\",") } else { format!(",{name},") };
        assert!(last.contains(&field), "{last}");
        let line: serde_json::Value =
            serde_json::from_str(read("trace.jsonl").lines().last().expect("frames")).expect("a line is JSON");
        assert_eq!((line["class"].as_str(), line["classes"].as_array().map(Vec::len)), (Some(name), Some(3)));
        assert!(read("report.html").contains(&format!("\"name\":\"{name}\"")));
        let json = said(command(dir, &[&track[..], &["--json"]].concat()));
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON alone");
        assert_eq!(json["class_name"].as_str(), Some(name));
    }
}

#[test]
fn mistakes_are_errors() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let dir = dir.path();
    let says = |words: &str, extra: &[&str]| {
        let train = ["train", "classifier", "--data", "pictures", "--out", "m.safetensors"];
        fails(command(dir, &[&train[..], extra].concat()), words);
    };
    says("pictures: cannot read the folder", &[]);
    std::fs::create_dir(dir.join("pictures")).expect("a writable folder");
    says("found 0", &[]);
    write_pictures(&dir.join("pictures"));
    says("epochs", &["--epochs", "0"]);
    let folder = ["train", "classifier", "--data", "pictures", "--out", "pictures"];
    fails(command(dir, &folder), "pictures: expected a file to write to, found a folder");
    std::fs::write(dir.join("m.safetensors.checkpoint"), b"broken").expect("a writable folder");
    says("--restart begins anew", &[]);
    std::fs::remove_file(dir.join("m.safetensors.checkpoint")).expect("written above");
    says("bad.toml", &["--config", "bad.toml"]);
    std::fs::write(dir.join("c.toml"), b"").expect("a writable folder");
    let same = ["train", "classifier", "--data", "pictures", "--config", "c.toml", "--out", "c.toml"];
    fails(command(dir, &same), "it is read, and would be replaced");
    std::fs::write(dir.join("pictures/zero/03.png"), b"not a picture").expect("a writable folder");
    says("03.png", &[]);
    (0..19).for_each(|i| std::fs::remove_file(dir.join(format!("pictures/zero/{i:02}.png"))).expect("written above"));
    says("needs two pictures at least", &[]);
    for name in ["zero", "three"] {
        std::fs::remove_dir_all(dir.join("pictures").join(name)).expect("written above");
    }
    says("found 1", &[]);
    std::fs::write(dir.join("cut"), b"short").expect("a writable folder");
    let track =
        command(dir, &["track", "pictures/one, a stroke", "--init", "1,1,20,20", "--recognise", "cut"]).output();
    assert!(!track.expect("it runs").status.success());
}
