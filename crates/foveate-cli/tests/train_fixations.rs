//! `foveate train fixations` as a user meets it: it trains, it survives being killed, it says what is wrong.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Digits that are bars, level (even) or upright (odd), as IDX files: 120 to learn from, 40 to test with.
fn write_digits(dir: &Path) {
    for (name, n) in [("train", 120u32), ("t10k", 40)] {
        let mut images = [2051, n, 28, 28].map(u32::to_be_bytes).concat();
        let mut labels = [2049, n].map(u32::to_be_bytes).concat();
        for i in 0..n {
            let (long, short) = (5..23, 11 + i % 3..16 + i % 3);
            images.extend((0..784u32).map(|p| {
                let (x, y) = if i % 2 == 0 { (p % 28, p / 28) } else { (p / 28, p % 28) };
                if long.contains(&x) && short.contains(&y) { 255 } else { 0 }
            }));
            labels.push((i % 2) as u8);
        }
        std::fs::write(dir.join(format!("{name}-images-idx3-ubyte")), images).expect("a writable folder");
        std::fs::write(dir.join(format!("{name}-labels-idx1-ubyte")), labels).expect("a writable folder");
    }
}

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.args(["train", "fixations", "--hidden", "24", "--factors", "16", "--batch", "20", "--rate", "0.02"]);
    command.args(["--threads", "2", "--data"]).arg(dir).arg("--out").arg(dir.join(out)).args(extra);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_killed_training_goes_on_and_ends_with_the_same_bits() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let epochs = ["--epochs", "12", "--clean"];
    let whole = command(dir.path(), "whole.safetensors", &epochs).output().expect("it runs");
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let said = String::from_utf8_lossy(&whole.stdout).into_owned();
    assert!(said.contains("epoch 12/12  log p(y|x)") && said.contains("40 test digits, centred and alone"), "{said}");
    assert!(said.contains("30 fixations: the last 3 alone") && said.contains("calibration error"), "{said}");

    let mut child = command(dir.path(), "cut.safetensors", &epochs).spawn().expect("it runs");
    let out = BufReader::new(child.stdout.take().expect("piped"));
    out.lines().map_while(Result::ok).find(|line| line.starts_with("epoch 2/12")).expect("the epoch comes");
    child.kill().expect("it still runs, or has ended");
    child.wait().expect("it ends");
    let rest = command(dir.path(), "cut.safetensors", &epochs).output().expect("it runs");
    let said = String::from_utf8_lossy(&rest.stdout).into_owned();
    assert!(said.contains("going on from") && !said.contains("epoch 1/12"), "{said}");
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).expect("a model");
    assert!(bytes("cut.safetensors") == bytes("whole.safetensors"), "the same command gives the same file");
    assert!(!dir.path().join("cut.safetensors.checkpoint").exists(), "a finished training needs no checkpoint");
}

#[test]
fn the_papers_way_and_larochelle_and_hintons() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    let run = |out: &str, extra: &[&str]| {
        let done = command(dir.path(), out, extra).output().expect("it runs");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8_lossy(&done.stdout).into_owned()
    };
    let said = run("paper.safetensors", &["--cost", "generative", "--gates", "linear", "--clean", "--epochs", "4"]);
    assert!(said.contains("paper.safetensors.softmax") && said.contains("40 test digits"), "{said}");
    let said = run("lh.safetensors", &["--larochelle-hinton", "--cost", "hybrid", "--epochs", "10"]);
    assert!(
        said.contains("96 values a fixation, 4 fixations") && said.contains("40 test digits, all 4 fixations"),
        "{said}"
    );
}

#[test]
fn what_cannot_be_done_is_said_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_digits(dir.path());
    for (extra, word) in [
        (&["--config", "no-such.toml"][..], "no-such.toml"),
        (&["--alpha=-1"], "alpha"),
        (&["--digits", "3"], "at least 10"),
        (&["--reach", "7"], "--reach"),
    ] {
        let done = command(dir.path(), "x.safetensors", extra).output().expect("it runs");
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!done.status.success() && said.contains(word), "{extra:?}: {said}");
    }
}
