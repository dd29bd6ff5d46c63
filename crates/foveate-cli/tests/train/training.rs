//! Checks that trainings share.
#![allow(dead_code)] // the tests of each program take what they need

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::place::{PROGRAM, done, failed, printed};

/// `foveate train` with these arguments and settings (`key=value`), on the data in a folder, to a model in the same folder.
pub(crate) fn train(dir: &Path, out: &str, args: &[&str], extra: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command.args(["train", args[0], "--threads", "2", "--data"]).arg(dir).arg("--out").arg(dir.join(out));
    for arg in args[1..].iter().chain(extra) {
        command.args(arg.contains('=').then_some("--set")).arg(arg);
    }
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The output of a command that succeeds.
pub(crate) fn said(mut command: Command) -> String {
    printed(&done(&mut command))
}

/// A command that fails with these words, without a panic.
pub(crate) fn fails(mut command: Command, words: &str) {
    let text = failed(&command.output().expect("it runs"));
    assert!(text.contains(words), "{text}");
}

/// A training whose model is `whole.safetensors`; and one of `cut.safetensors` that is killed (-9) whenever one of these
/// lines comes, or a little later, and then continues to the same bits. Returns the output of the first and the last of these runs.
pub(crate) fn whole_and_cut(dir: &Path, train: &dyn Fn(&'static str) -> Command, lines: &[&str]) -> (String, String) {
    let whole = said(train("whole.safetensors"));
    assert!(!dir.join("whole.safetensors.checkpoint").exists(), "a finished training needs no checkpoint");
    for start in lines {
        let mut command = train("cut.safetensors");
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
        let out = BufReader::new(child.stdout.take().expect("piped"));
        out.lines().map_while(Result::ok).find(|line| line.starts_with(start)).expect("the epoch comes");
        child.kill().expect("it still runs, or has ended");
        child.wait().expect("it ends");
    }
    let rest = said(train("cut.safetensors"));
    let bytes = |name: &str| std::fs::read(dir.join(name)).expect("a model");
    assert!(bytes("cut.safetensors") == bytes("whole.safetensors"), "the same command gives the same file");
    (whole, rest)
}
