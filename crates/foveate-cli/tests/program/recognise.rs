//! Recognition as a user meets it: a model is trained, and a track reports the class of its target.

use std::process::Output;

use foveate_testing::write_digits;

use crate::place::{Place, errors, failed, json, printed};

/// Runs the program with the data of the folder.
fn run(place: &Place, args: &[&str]) -> Output {
    place.command(args).env("FOVEATE_DATA", place.path("")).output().expect("it starts")
}

fn said(output: &Output) -> String {
    assert!(output.status.success(), "{}", errors(output));
    printed(output)
}

#[test]
fn a_track_says_what_it_follows() {
    let place = Place::empty();
    // Blots instead of digits: enough for an untrained model.
    for (set, n) in [("train", 120), ("t10k", 20)] {
        write_digits(&place.path(""), set, n, 10, |i, x, y| ((28 * y + x) * (i % 10 + 3) / 7) % 11 < 3);
    }
    let train = "train fixations --data . --out m.safetensors --set config=digits --set training.hidden=8 \
                 --set training.factors=8 --set training.epochs=1";
    said(&run(&place, &train.split(' ').collect::<Vec<_>>()));
    said(&run(&place, &["synth", "clutter", "--frames", "8", "--out", "video"]));
    let track = |out: &str, more: &[&str]| {
        run(&place, &[&["track", "video", "-c", "digits", "--no-video", "-o", out][..], more].concat())
    };
    let tracked = |out: &str, more: &[&str]| said(&track(out, more));
    assert!(!tracked("plain", &[]).contains("Recognised"));
    let words = tracked("named", &["--recognise", "m.safetensors"]);
    assert!(words.contains("Recognised as class "), "{words}");
    let read = |name: &str| place.text(name);
    assert_eq!(read("plain/boxes.txt"), read("named/boxes.txt"), "the track stays the same");
    let last = read("named/track.csv").lines().last().expect("frames").split(',').rev().nth(1).map(str::to_owned);
    let json = json(&track("json", &["--recognise", "m.safetensors", "--json"]));
    assert_eq!(Some(json["class"][0].to_string()), last);

    // Settings of what takes the configuration's place.
    tracked(
        "count",
        &["--recognise", "m.safetensors", "--set", "recogniser.accumulate=count", "--set", "particles=100"],
    );
    assert_ne!(read("count/track.csv"), read("named/track.csv"), "each frame is one vote");
    let message = failed(&track("none", &["--recognise", "m.safetensors", "--set", "recogniser.none=1"]));
    assert!(message.contains("recogniser.none=1") && message.contains("unknown field"), "{message}");

    // The shipped model has the digits as classes, and the help names them.
    let words = tracked("shipped", &["--recognise"]);
    assert!(words.contains("Recognised as digit ") && read("shipped/boxes.txt") == read("plain/boxes.txt"), "{words}");
    let warned = track("warned", &["--until", "2", "--recognise"]);
    let words = errors(&warned);
    assert!(words.contains("knows the digits 0 to 9 alone") && words.contains("train classifier"), "{words}");
    assert!(!said(&warned).is_empty() && read("warned/track.csv").contains(",digit "), "{}", read("warned/track.csv"));
    let words = failed(&run(&place, &["track", "video", "--recognise", "gone.safetensors"]));
    assert!(words.contains("gone.safetensors"), "{words}");
}
