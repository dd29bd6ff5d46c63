//! `foveate train variation`.

use crate::place::{Place, printed};

/// The covariance of drawn sequences is the same for any number of threads, and a tracker loads it; other files, and those learned
/// of other features, it does not.
#[test]
fn it_is_learned_and_used() {
    let place = Place::empty();
    for digit in ["3", "7"] {
        let out = format!("seqs/{digit}");
        place.done(["synth", "clutter", "--digit", digit, "--frames", "12", "--out", &out]);
    }
    let learn = ["train", "variation", "--seqs", "seqs"];
    let learned = |more: &[&str]| printed(&place.done([&learn[..], more].concat()));
    let message = learned(&["--out", "a.json", "--threads", "2"]);
    assert!(message.contains("sequences: 2, of each every frame in 4"), "{message}");
    learned(&["--out", "b.json", "--threads", "1"]);
    let of = |name: &str| place.text(name).split_once("sha256").expect("a checksum").1.to_owned();
    assert_eq!(of("a.json"), of("b.json"));

    let track = |set| ["eval", "--seqs", "seqs", "--seeds", "1", "--set", "particles=50", "--set", set];
    place.done(track("variation.covariance=a.json"));
    place.write("cut.json", &of("a.json")[..900]);
    place.refuses(track("variation.covariance=cut.json"), "cut.json");
    place.refuses(track("variation.covariance=builtin:mine"), "builtin:natural-variation");
    place.refuses(track("encoder.kind=raw"), "variation.weight to 0");
    place.refuses([&learn[..], &["--out", "c.json", "--every", "9"]].concat(), "no sequence has 3 boxes");
    assert!(!place.path("c.json").exists());
}
