//! A command whose operations on files fail one by one, and which is killed.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

use super::place::{Place, done, errors};

pub(crate) type Files = BTreeMap<String, Vec<u8>>;

/// All files below a folder but hidden ones, by path.
pub(crate) fn files(folder: &Path) -> Files {
    let mut found = Files::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in std::fs::read_dir(&inside).into_iter().flatten().flatten().map(|entry| entry.path()) {
            let name = entry.strip_prefix(folder).expect("below it").to_string_lossy().into_owned();
            if entry.is_dir() {
                folders.push(entry);
            } else if !entry.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')) {
                found.insert(name, std::fs::read(&entry).expect("a file"));
            }
        }
    }
    found
}

/// These hold times, which may repeat.
const TIMED: [&str; 2] = [".html", "table.txt"];

/// Whether a file is as expected: the same bytes or, if it holds times, as many lines and the same end.
fn is_whole(name: &str, bytes: &[u8], wanted: &[u8], again: &[u8]) -> bool {
    let lines = |bytes: &[u8]| bytes.iter().filter(|byte| **byte == b'\n').count();
    bytes == wanted
        || ((wanted != again || TIMED.iter().any(|end| name.ends_with(end)))
            && lines(bytes) == lines(wanted)
            && bytes.last() == wanted.last())
}

pub(crate) struct Job {
    pub place: Place,
    pub args: Vec<String>,
    /// The output of whole runs; only times differ between them.
    wanted: Files,
    again: Files,
}

impl Job {
    pub(crate) fn new(place: Place, args: impl IntoIterator<Item: AsRef<str>>) -> Self {
        let args = args.into_iter().map(|arg| arg.as_ref().to_owned()).collect();
        let mut job = Self { place, args, wanted: Files::new(), again: Files::new() };
        for _ in 0..2 {
            done(&mut job.command());
            let results = job.results();
            job.wanted = std::mem::replace(&mut job.again, results);
            job.clear();
        }
        assert!(!job.wanted.is_empty() && job.wanted.keys().eq(job.again.keys()));
        job
    }

    /// The program, which finds no data but its own.
    fn command(&self) -> Command {
        let mut command = self.place.command(&self.args);
        command.env("FOVEATE_DATA", ".");
        command
    }

    fn results(&self) -> Files {
        let all = files(&self.place.path(""));
        all.into_iter().filter(|(name, _)| name.starts_with("out")).collect()
    }

    /// Removes its outputs, leftovers and checkpoints.
    fn clear(&self) {
        for name in self.place.names("").iter().filter(|name| name.starts_with("out") || name.starts_with(".out")) {
            let path = self.place.path(name);
            let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        }
    }

    /// Every file that has its final name is whole. Checkpoints are of any moment: the next run shows whether they were.
    fn check_names(&self, what: &str) {
        for (name, bytes) in self.results().iter().filter(|(name, _)| !name.contains("checkpoint")) {
            // Folders of interrupted runs, and runs that continue, have names of their own.
            let (Some(wanted), Some(again)) = (self.wanted.get(name), self.again.get(name)) else { continue };
            assert!(is_whole(name, bytes, wanted, again) || name.ends_with("run.json"), "{what}: {name} is not whole");
        }
    }

    /// The next run ends as if nothing had been.
    fn check_again(&self, what: &str) {
        let output = self.command().output().expect("it starts");
        assert!(output.status.success(), "{what}: {}", errors(&output));
        let found = self.results();
        for (name, wanted) in &self.wanted {
            let bytes = found.get(name).unwrap_or_else(|| panic!("{what}: {name} is missing"));
            assert!(is_whole(name, bytes, wanted, &self.again[name]), "{what}: {name} differs");
        }
    }

    /// Fails each operation once, up to the `most`-th of a kind; answers how many there were of each kind.
    pub(crate) fn fail_each(&self, most: usize) -> [usize; 4] {
        let log = self.place.path("faults.log");
        ["open", "write", "sync", "rename"].map(|operation| {
            for n in 1.. {
                let fault = format!("{operation}:{n}");
                let mut command = self.command();
                let output = command.env("FOVEATE_FAULT", &fault).env("FOVEATE_FAULT_LOG", &log).output();
                let (output, what) = (output.expect("it starts"), format!("{:?}, {fault}", self.args));
                let Ok(failed) = std::fs::read_to_string(&log) else {
                    self.clear();
                    return n - 1;
                };
                std::fs::remove_file(&log).expect("it is there");
                let said = errors(&output);
                assert!(output.status.code().is_some_and(|code| code < 2), "{what}: {said}");
                // Another way may have been taken; else the error names the file, by its name or that of its folder.
                if !output.status.success() {
                    let path = failed.split_whitespace().nth(2).expect("a path").to_owned();
                    // Unfinished folders are named by their final name.
                    let of = |name: &str| name.trim_start_matches('.').split('.').next().unwrap_or_default().to_owned();
                    let mut names = Path::new(&path).iter().rev().take(2).map(|name| of(&name.to_string_lossy()));
                    assert!(names.any(|name| said.contains(&name)), "{what}: {path}: {said}");
                    self.check_names(&what);
                }
                self.check_again(&what);
                self.clear();
                if n == most {
                    return n;
                }
            }
            unreachable!("it counts on")
        })
    }

    /// Kills it so often, at moments all over its run. Checkpoints stay from kill to kill.
    pub(crate) fn kill(&self, times: u32) {
        let took = |_| {
            let began = std::time::Instant::now();
            self.check_again("before");
            self.clear();
            began.elapsed()
        };
        let long = (0..3).map(took).min().expect("three");
        let mut ended = 0;
        for i in 0..times {
            self.clear();
            let mut run = self.command();
            let mut run = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
            // Golden steps: moments that lie apart whatever their number.
            std::thread::sleep(long.mul_f64((f64::from(i) * 0.618_034).fract()));
            let _ = run.kill();
            ended += u32::from(run.wait().expect("it ended").success());
            let what = format!("{:?}, kill {i}", self.args);
            self.check_names(&what);
            self.check_again(&what);
            let litter: Vec<_> = self.place.names("").into_iter().filter(|name| name.ends_with(".tmp")).collect();
            assert!(
                litter.iter().all(|name| !std::fs::metadata(self.place.path(name)).is_ok_and(|m| m.is_dir())),
                "{litter:?}"
            );
        }
        self.clear();
        println!("{:?}: killed {times} times, {ended} of them too late", self.args);
    }
}
