//! `foveate train variation`.

use std::path::Path;
use std::process::Command;

use super::training::{fails, said};

fn foveate(arguments: &[&str], dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.args(arguments).current_dir(dir);
    command
}

/// The covariance of drawn sequences is the same for any number of threads, and a tracker loads it; other files, and those learned
/// of other features, it does not.
#[test]
fn it_is_learned_and_used() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let here = dir.path();
    for digit in ["3", "7"] {
        let out = format!("seqs/{digit}");
        said(foveate(&["synth", "clutter", "--digit", digit, "--frames", "12", "--out", &out], here));
    }
    let learn = |out: &str, more: &[&str]| {
        foveate(&[&["train", "variation", "--seqs", "seqs", "--out", out], more].concat(), here)
    };
    let message = said(learn("a.json", &["--threads", "2"]));
    assert!(message.contains("sequences: 2, of each every frame in 4"), "{message}");
    said(learn("b.json", &["--threads", "1"]));
    let of = |name: &str| {
        let text = std::fs::read_to_string(here.join(name)).expect("it was written");
        text.split_once("sha256").expect("a checksum").1.to_owned()
    };
    assert_eq!(of("a.json"), of("b.json"));

    let track = |set: &str| {
        let words = ["eval", "--seqs", "seqs", "--seeds", "1", "--set", "particles=50", "--set", set];
        foveate(&words, here)
    };
    said(track("variation.covariance=a.json"));
    std::fs::write(here.join("cut.json"), &of("a.json")[..900]).expect("it can be written");
    fails(track("variation.covariance=cut.json"), "cut.json");
    fails(track("variation.covariance=builtin:mine"), "builtin:natural-variation");
    fails(track("encoder.kind=raw"), "variation.weight to 0");
    fails(learn("c.json", &["--every", "9"]), "no sequence has 3 boxes");
    assert!(!here.join("c.json").exists());
}
