//! `foveate train classifier` in use: a folder of drawn digits for each class, a model, and a track that reports the
//! class by its name.

use foveate::lab::Digits;
use foveate::scene::Image;
use foveate::video::save_png;
use std::path::Path;

use crate::place::{Place, json, printed};
use crate::training::whole_and_cut;

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

#[test]
fn a_user_s_classes_are_learned_and_a_track_says_them_by_name() {
    let place = Place::empty();
    write_pictures(&place.path("pictures"));
    let train = |out| {
        let args = ["train", "classifier", "--data", "pictures", "--epochs", "25", "--threads", "2", "--out", out];
        place.command(args)
    };
    let (words, rest) = whole_and_cut(&place.path(""), &train, &["epoch 3/25"]);
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
        place.done([&scene[..], &["--digit", &digit.to_string()]].concat());
        let track =
            ["track", name, "-c", "digits", "--no-video", "--trace", "-o", "out", "--recognise", "whole.safetensors"];
        let words = printed(&place.done(track));
        assert!(words.contains(&format!("Recognised as {name}, with probability")), "{words}");
        let read = |file: &str| place.text(&format!("out/{file}"));
        let last = read("track.csv").lines().last().expect("frames").to_owned();
        let field = if name.contains(',') { format!(",\"{name}\",") } else { format!(",{name},") };
        assert!(last.contains(&field), "{last}");
        let line: serde_json::Value =
            serde_json::from_str(read("trace.jsonl").lines().last().expect("frames")).expect("a line is JSON");
        assert_eq!((line["class"].as_str(), line["classes"].as_array().map(Vec::len)), (Some(name), Some(3)));
        assert!(read("report.html").contains(&format!("\"name\":\"{name}\"")));
        let json = json(&place.done([&track[..], &["--json"]].concat()));
        assert_eq!(json["class_name"].as_str(), Some(name));
    }
}

#[test]
fn mistakes_are_errors() {
    let place = Place::empty();
    let train = ["train", "classifier", "--data", "pictures", "--out"];
    let says = |words: &str, extra: &[&str]| {
        place.refuses([&train[..], &["m.safetensors"], extra].concat(), words);
    };
    says("pictures: cannot read the folder", &[]);
    std::fs::create_dir(place.path("pictures")).expect("a writable folder");
    says("found 0", &[]);
    write_pictures(&place.path("pictures"));
    says("epochs", &["--epochs", "0"]);
    let folder = [&train[..], &["pictures"]].concat();
    place.refuses(folder, "pictures: expected a file to write to, found a folder");
    place.write("m.safetensors.checkpoint", b"broken");
    says("--restart begins anew", &[]);
    std::fs::remove_file(place.path("m.safetensors.checkpoint")).expect("written above");
    says("bad.toml", &["--config", "bad.toml"]);
    place.write("c.toml", b"");
    place.refuses([&train[..], &["c.toml", "--config", "c.toml"]].concat(), "it is read, and would be replaced");
    place.write("pictures/zero/03.png", b"not a picture");
    says("03.png", &[]);
    (0..19)
        .for_each(|i| std::fs::remove_file(place.path(&format!("pictures/zero/{i:02}.png"))).expect("written above"));
    says("needs two pictures at least", &[]);
    for name in ["zero", "three"] {
        std::fs::remove_dir_all(place.path("pictures").join(name)).expect("written above");
    }
    says("found 1", &[]);
    place.write("cut", b"short");
    let track = place.run(["track", "pictures/one, a stroke", "--init", "1,1,20,20", "--recognise", "cut"]);
    assert!(!track.status.success());
}
