//! `foveate train confidence`.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::training::{fails, said};

fn fit(dir: &Path, out: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.args([
        "train",
        "confidence",
        "--config",
        "digits",
        "--seeds",
        "4",
        "--rounds",
        "2",
        "--threads",
        "2",
        "--seqs",
    ]);
    command.arg(dir.join("seqs")).arg("--out").arg(dir.join(out)).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Killed while it tracks, a fit continues with the stored tracks, to the same table; what is done is removed, and nothing
/// else that lies there.
#[test]
fn a_fit_that_was_killed_goes_on() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for digit in ["3", "7"] {
        let mut synth = Command::new(env!("CARGO_BIN_EXE_foveate"));
        synth.args(["synth", "clutter", "--digit", digit, "--frames", "120", "--out"]);
        synth.arg(dir.path().join("seqs").join(digit));
        said(synth);
    }
    let table = |out: &str| {
        let text = std::fs::read_to_string(dir.path().join(out)).expect("a table");
        text.split_once('\n').expect("the command, and the table").1.to_owned()
    };
    let whole = said(fit(dir.path(), "whole.toml"));
    assert!(!dir.path().join("whole.runs").exists(), "what is finished begins anew");

    // Not files being written under another name.
    let kept = |file: &std::fs::DirEntry| file.path().extension().is_some_and(|end| end == "json");
    let runs = || std::fs::read_dir(dir.path().join("cut.runs")).map_or(0, |all| all.flatten().filter(kept).count());
    let mut child = fit(dir.path(), "cut.toml").spawn().expect("it runs");
    let began = Instant::now();
    while runs() < 2 {
        assert!(began.elapsed() < Duration::from_secs(60) && child.try_wait().expect("a child").is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("it still runs");
    child.wait().expect("it ends");
    assert!(runs() >= 2 && !dir.path().join("cut.toml").exists());
    let other = dir.path().join("cut.runs/note.txt");
    std::fs::write(&other, "mine").expect("it can be written");
    let last = fit(dir.path(), "cut.toml").output().expect("it runs");
    let message = String::from_utf8_lossy(&last.stderr);
    let (first, _) = message.split_once(" of them from ").expect("how many runs were kept");
    assert!(last.status.success() && !first.ends_with(" 0"), "{message}");
    assert_eq!(table("cut.toml"), table("whole.toml"));
    assert_eq!(String::from_utf8_lossy(&last.stdout).replace("cut.", "whole."), whole);
    assert!(other.exists() && runs() == 0, "{} are left", runs());
}

/// An output that cannot be written, or that would replace an input, is an error before any video is opened.
#[test]
fn unwritable_results_are_refused_at_once() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(dir.path().join("folder")).expect("a folder");
    fails(fit(dir.path(), "folder"), "expected a file to write to, found a folder");
    fails(fit(dir.path(), "nowhere/table.toml"), "there is no folder");
    let with = |option: &str, value: &Path| {
        let mut command = fit(dir.path(), "table.toml");
        command.arg(option).arg(value);
        command
    };
    fails(with("--cues", &dir.path().join("folder")), "expected a file to write to, found a folder");
    for name in ["table.toml", "table.svg", "table.runs"] {
        fails(with("--cues", &dir.path().join(name)), "are written under the same name");
    }
    fails(fit(dir.path(), "table.svg"), "its plot gets the same name");
    fails(fit(dir.path(), "table.runs"), "the folder of its finished tracks gets the same name");
    let mut second = fit(dir.path(), "table.toml");
    second.arg("--only-second-opinion");
    fails(second, "--only-second-opinion: digits has none; add second_opinion");
    let mut committee = fit(dir.path(), "table.toml");
    committee.args(["--set", "committee=2"]);
    fails(committee, "fit a member: --set committee=1");
    let mut two = Command::new(env!("CARGO_BIN_EXE_foveate"));
    two.args(["train", "confidence", "--config", "digits-{other}.toml", "--seqs", ".", "--out", "table.toml"]);
    two.current_dir(dir.path());
    for (half, bias) in [("a", "bias = 1.0"), ("b", "bias = 2.0")] {
        let text = include_str!("../../../foveate-core/configs/digits.toml").replace("bias = 1.521", bias);
        std::fs::write(dir.path().join(format!("digits-{half}.toml")), text).expect("a writable folder");
    }
    fails(two, "[confidence] of the two halves differs");
    for half in ["a", "b"] {
        std::fs::remove_file(dir.path().join(format!("digits-{half}.toml"))).expect("it was written");
    }
    assert_eq!(std::fs::read_dir(dir.path()).expect("a folder").count(), 1, "nothing was made");
}
