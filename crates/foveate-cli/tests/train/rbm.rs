//! `foveate train rbm` as a user meets it: it trains, it survives being killed, and its errors name the problem.

use std::path::Path;
use std::process::Command;

use crate::training::{fails, train, whole_and_cut};

/// Digits that are rectangles of many shapes.
fn write_digits(dir: &Path) {
    let inside = |i, x, y| (4 + i % 7..20 + i % 5).contains(&x) && (6 + i % 4..14 + i % 11).contains(&y);
    foveate_testing::write_digits(dir, "train", 60, 10, inside);
}

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let data = ["rbm", "--recipe", "digits", "training.hidden=40", "glimpses.number=3000", "glimpses.held_out=100"];
    let negative = "training.negative={ persistent = { chains = 100, steps = 1 } }";
    train(dir, out, &[&data[..], &["glimpses.retina.rings=[[8, 1], [16, 2]]", negative]].concat(), extra)
}

#[test]
fn a_killed_training_goes_on_and_ends_with_the_same_bits() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let epochs = ["training.epochs=40"];
    let train = |out| command(dir.path(), out, &epochs);
    let (whole, rest) = whole_and_cut(dir.path(), &train, &["epoch 1/40", "epoch 10/40"]);
    assert!(whole.contains("epoch 40/40  reconstruction") && whole.contains("pseudo-log-likelihood"), "{whole}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));
    assert!(rest.contains("resuming") && !rest.contains("epoch 5/40"), "{rest}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_checkpoint_and_says_how_to_go_on() {
    use std::io::{BufRead, BufReader, Read};
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let mut child = command(dir.path(), "m.safetensors", &["training.epochs=100000"]).spawn().expect("it runs");
    let mut out = BufReader::new(child.stdout.take().expect("piped"));
    let mut line = String::new();
    while !line.starts_with("epoch 2") {
        line.clear();
        assert!(out.read_line(&mut line).expect("text") > 0, "it ended too soon");
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs").success());
    let mut rest = String::new();
    out.read_to_string(&mut rest).expect("text");
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    assert!(rest.contains("the same command continues from there"), "{rest}");
    assert!(dir.path().join("m.safetensors.checkpoint").exists() && !dir.path().join("m.safetensors").exists());
    // With another recipe it refuses to resume and gives the reason; --restart begins anew.
    fails(command(dir.path(), "m.safetensors", &["training.epochs=2", "training.rate=0.3"]), "it was begun as");
    let anew = command(dir.path(), "m.safetensors", &["training.epochs=2", "training.rate=0.3", "--restart"]).status();
    assert!(anew.expect("it runs").success());
}

#[test]
fn mistakes_are_errors_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let says = |extra: &[&str], words: &str| fails(command(dir.path(), "m.safetensors", extra), words);
    says(&[], "train-images-idx3-ubyte");
    write_digits(dir.path());
    says(&["training.momentum=1"], "momentum");
    says(&["training.batch=0"], "rows of a batch");
    says(&["training.bach=3"], "unknown field `bach`, expected one of");
    says(&["glimpses.retina.colour=[16]"], "expected an array of length 2");
    let none = train(dir.path(), "m.safetensors", &["rbm", "--recipe", "none.toml"], &[]);
    fails(none, "recipes that ship with the program: natural, digits");
    let elsewhere = command(dir.path(), "no/such/folder/m.safetensors", &[]);
    fails(elsewhere, "no/such/folder to write it to");
}
