//! A folder with a short video and a quick configuration, and the program run in it.
#![allow(dead_code, missing_docs)] // each test takes what it needs

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
const PROGRAM: &str = match (option_env!("CARGO_BIN_EXE_foveate"), option_env!("CARGO_BIN_EXE_paper")) {
    (Some(program), _) | (None, Some(program)) => program,
    (None, None) => panic!("tests are built with a program"),
};

pub(crate) struct Place(tempfile::TempDir);

impl Place {
    /// A folder with a video of ten frames and a quick configuration.
    pub(crate) fn new() -> Self {
        let place = Self(tempfile::tempdir().expect("a temporary folder"));
        std::fs::write(place.path("c.toml"), CONFIG).expect("a writable folder");
        let made = place.run(&["synth", "clutter", "--frames", &FRAMES.to_string(), "--out", "video"]);
        assert!(made.status.success(), "{}", errors(&made));
        place
    }
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    pub(crate) fn run(&self, args: &[&str]) -> Output {
        self.command(args).output().expect("it starts")
    }
    pub(crate) fn command(&self, args: &[&str]) -> Command {
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
        self.run(&[&["track", "-c", "c.toml", "--no-video", "--no-report", "-o", out][..], args].concat())
    }
    /// The same for a run that must succeed; returns boxes.txt.
    pub(crate) fn boxes(&self, out: &str, args: &[&str]) -> Vec<u8> {
        let output = self.track(out, args);
        assert!(output.status.success(), "{}", errors(&output));
        self.read(&format!("{out}/boxes.txt"))
    }
    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).expect("it was written")
    }
    pub(crate) fn lines(&self, name: &str) -> usize {
        self.read(name).iter().filter(|&&b| b == b'\n').count()
    }
    /// The error, if it fails.
    pub(crate) fn failure(&self, args: &[&str]) -> String {
        let output = self.track("failed", args);
        assert!(!output.status.success(), "{args:?} must fail");
        assert!(!errors(&output).contains("panicked"), "{}", errors(&output));
        errors(&output)
    }
}

pub(crate) fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
