//! `foveate train fixations` as a user meets it: it trains, and its errors name the problem.

use std::path::Path;
use std::process::Command;

use crate::training::{fails, said, train};

/// Digits that are bars, level (even) or upright (odd): 120 to learn from, 40 to test with.
fn write_digits(dir: &Path) {
    let inside = |i, x, y| {
        let (x, y) = if i % 2 == 0 { (x, y) } else { (y, x) };
        (5..23).contains(&x) && (11 + i % 3..16 + i % 3).contains(&y)
    };
    foveate_testing::write_digits(dir, "train", 120, 2, inside);
    foveate_testing::write_digits(dir, "t10k", 40, 2, inside);
}

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let args = ["fixations", "training.hidden=24", "training.factors=16", "training.batch=20", "training.rate=0.02"];
    train(dir, out, &args, extra)
}

#[test]
fn decisions_of_test_digits_are_counted() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let epochs = ["training.epochs=12", "clean=true"];
    let whole = said(command(dir.path(), "whole.safetensors", &epochs));
    assert!(whole.contains("epoch 12/12  log p(y|x)"), "{whole}");
    assert!(whole.contains("40 test digits, centred and alone"), "{whole}");
    assert!(whole.contains("30 fixations: the last 3 alone") && whole.contains("calibration error"), "{whole}");
}

#[test]
fn the_papers_way_and_larochelle_and_hintons() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let run = |out: &str, extra: &[&str]| said(command(dir.path(), out, extra));
    let layered =
        ["training.cost=generative", "training.classes=0", "training.gates=linear", "clean=true", "training.epochs=4"];
    let words = run("paper.safetensors", &layered);
    assert!(words.contains("paper.safetensors.softmax") && words.contains("40 test digits"), "{words}");
    let words = run("lh.safetensors", &["--recipe", "larochelle-hinton", "training.cost=hybrid", "training.epochs=10"]);
    assert!(words.contains("96 values a fixation, 4 fixations"), "{words}");
    assert!(words.contains("40 test digits, all 4 fixations"), "{words}");
}

#[test]
fn impossible_work_is_refused_first() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    for (extra, word) in [
        (&["config=no-such.toml"][..], "no-such.toml"),
        (&["training.alpha=-1"], "alpha"),
        (&["digits=3"], "at least 10"),
        (&["within=7"], "within"),
    ] {
        fails(command(dir.path(), "x.safetensors", extra), word);
    }
}

/// Other digits in the same folder are other data.
#[cfg(unix)]
#[test]
fn a_training_does_not_go_on_with_other_digits() {
    use std::io::{BufRead, BufReader};
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let long = ["training.epochs=100000", "clean=true"];
    let mut child = command(dir.path(), "m.safetensors", &long).spawn().expect("it runs");
    let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    let begun = lines.map_while(Result::ok).find(|line| line.starts_with("epoch 2"));
    assert!(begun.is_some(), "it ended too soon");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs").success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    foveate_testing::write_digits(dir.path(), "train", 120, 2, |i, x, y| (4 + i % 5..9 + i % 5).contains(&x) && y > 7);
    fails(command(dir.path(), "m.safetensors", &long), "was begun");
}
