//! A folder, perhaps with a short video and a quick configuration, and the program run in it.
#![allow(dead_code, missing_docs)] // each test takes what it needs

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::{Command, Output};

pub(crate) const FRAMES: usize = 10;

pub(crate) const CONFIG: &str = r#"
particles = 60
[dynamics]
kind = "autoregressive"
[retina]
kind = "foveal"
side = 28
rings = [[8, 2], [24, 4]]
[encoder]
kind = "raw"
[likelihood]
distance = "cosine"
sharpness = 30
[policy]
kind = "hedge"
gamma = 0.5
"#;

/// The program that is tested: `foveate`, or another with its commands.
pub(crate) const PROGRAM: &str = match (option_env!("CARGO_BIN_EXE_foveate"), option_env!("CARGO_BIN_EXE_paper")) {
    (Some(program), _) | (None, Some(program)) => program,
    (None, None) => panic!("tests are built with a program"),
};

pub(crate) struct Place(tempfile::TempDir);

impl Place {
    pub(crate) fn empty() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }
    /// A folder with a video of ten frames and a quick configuration.
    pub(crate) fn new() -> Self {
        let place = Self::empty();
        place.write("c.toml", CONFIG);
        place.done(&["synth", "clutter", "--frames", &FRAMES.to_string(), "--out", "video"]);
        place
    }
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    pub(crate) fn run(&self, args: impl IntoIterator<Item: AsRef<OsStr>>) -> Output {
        self.command(args).output().expect("it starts")
    }
    /// The same for a run that must succeed.
    pub(crate) fn done(&self, args: impl IntoIterator<Item: AsRef<OsStr>>) -> Output {
        done(&mut self.command(args))
    }
    pub(crate) fn command(&self, args: impl IntoIterator<Item: AsRef<OsStr>>) -> Command {
        let mut command = Command::new(PROGRAM);
        command.current_dir(self.0.path()).args(args);
        command
    }
    /// The names in a folder, sorted.
    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).expect("a folder");
        let mut names: Vec<_> = entries.map(|e| e.expect("one").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
    /// Tracks into the folder `out`; without a film and a report.
    pub(crate) fn track(&self, out: &str, args: &[&str]) -> Output {
        self.run([&["track", "-c", "c.toml", "--no-video", "--no-report", "-o", out][..], args].concat())
    }
    /// The same for a run that must succeed.
    pub(crate) fn tracked(&self, out: &str, args: &[&str]) -> Output {
        self.done([&["track", "-c", "c.toml", "--no-video", "--no-report", "-o", out][..], args].concat())
    }
    /// The same; returns boxes.txt.
    pub(crate) fn boxes(&self, out: &str, args: &[&str]) -> Vec<u8> {
        self.tracked(out, args);
        self.read(&format!("{out}/boxes.txt"))
    }
    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).expect("text")
    }
    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).expect("JSON")
    }
    /// Writes a file, and the folder it is in.
    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("it is in the folder")).expect("a writable folder");
        std::fs::write(path, bytes).expect("a writable folder");
    }
    pub(crate) fn lines(&self, name: &str) -> usize {
        self.read(name).iter().filter(|&&b| b == b'\n').count()
    }
    /// The error, if it fails.
    pub(crate) fn failure(&self, args: &[&str]) -> String {
        failed(&self.track("failed", args))
    }
    /// A run that must fail, and say so.
    pub(crate) fn refuses(&self, args: impl IntoIterator<Item: AsRef<OsStr>>, said: &str) {
        let mut command = self.command(args);
        let found = failed(&command.output().expect("it starts"));
        assert!(found.contains(said), "{command:?}: expected {said:?}: {found}");
    }
}

/// Runs a command that must succeed.
pub(crate) fn done(command: &mut Command) -> Output {
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{command:?}: {}", errors(&output));
    output
}

/// The error of a run that must fail, without a panic.
pub(crate) fn failed(output: &Output) -> String {
    let said = errors(output);
    assert!(!output.status.success() && !said.contains("panicked"), "{said}");
    said
}

pub(crate) fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The only JSON document on standard output.
pub(crate) fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).expect("JSON alone on the standard output")
}
