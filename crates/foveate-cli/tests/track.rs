//! `foveate track` as a user meets it: files in, files out, and what it says where something is wrong.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const FRAMES: usize = 10;

const CONFIG: &str = r#"
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

struct Place(tempfile::TempDir);

impl Place {
    /// A folder with a video of ten frames and a quick configuration.
    fn new() -> Self {
        let place = Self(tempfile::tempdir().expect("a temporary folder"));
        std::fs::write(place.path("c.toml"), CONFIG).expect("a writable folder");
        let made = place.run(&["synth", "clutter", "--frames", &FRAMES.to_string(), "--out", "video"]);
        assert!(made.status.success(), "{}", errors(&made));
        place
    }
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_foveate")).current_dir(self.0.path()).args(args).output().expect("it starts")
    }
    /// Tracks into the folder `out`; without a film and a report.
    fn track(&self, out: &str, args: &[&str]) -> Output {
        self.run(&[&["track", "-c", "c.toml", "--no-video", "--no-report", "-o", out][..], args].concat())
    }
    /// The same, where it must succeed; boxes.txt comes back.
    fn boxes(&self, out: &str, args: &[&str]) -> Vec<u8> {
        let output = self.track(out, args);
        assert!(output.status.success(), "{}", errors(&output));
        self.read(&format!("{out}/boxes.txt"))
    }
    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).expect("it was written")
    }
    fn lines(&self, name: &str) -> usize {
        self.read(name).iter().filter(|&&b| b == b'\n').count()
    }
    /// What is said where it fails.
    fn failure(&self, args: &[&str]) -> String {
        let output = self.track("failed", args);
        assert!(!output.status.success(), "{args:?} must fail");
        assert!(!errors(&output).contains("panicked"), "{}", errors(&output));
        errors(&output)
    }
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn every_file_is_there_with_a_line_for_each_frame() {
    let place = Place::new();
    let output = place.run(&["track", "video", "-c", "c.toml", "-o", "all"]);
    assert!(output.status.success(), "{}", errors(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("10 frames tracked") && said.contains("boxes.txt"), "{said}");
    assert_eq!(place.lines("all/boxes.txt"), FRAMES);
    assert_eq!(place.lines("all/track.csv"), FRAMES + 1, "names of columns first");
    let text = String::from_utf8(place.read("all/trace.jsonl")).expect("text");
    assert!(text.lines().all(|line| serde_json::from_str::<serde_json::Value>(line).is_ok()));
    assert!(text.lines().count() >= FRAMES);
    assert_eq!(&place.read("all/annotated.mp4")[4..8], b"ftyp");
    assert!(place.read("all/report.html").starts_with(b"<!"));
    assert!(place.read("all/surface.png").starts_with(b"\x89PNG"));
    // Without --init the first line of the truth is the start.
    let first = |name: &str| -> Vec<f64> {
        let text = String::from_utf8(place.read(name)).expect("text");
        text.lines().next().expect("a line").split([',', '\t']).map(|n| n.trim().parse().expect("a number")).collect()
    };
    assert_eq!(first("all/boxes.txt"), first("video/groundtruth_rect.txt"));
    let left: Vec<_> =
        std::fs::read_dir(place.path("all")).expect("results").map(|e| e.expect("one").file_name()).collect();
    assert_eq!(left.len(), 6, "no temporary file stays: {left:?}");
    place.boxes("few", &["video", "--no-trace"]);
    assert_eq!(std::fs::read_dir(place.path("few")).expect("results").count(), 2, "boxes.txt and track.csv alone");
}

#[test]
fn regret_is_written_and_changes_no_box() {
    let place = Place::new();
    let plain = place.boxes("plain", &["video"]);
    assert_eq!(place.boxes("regret", &["video", "--regret"]), plain);
    assert_eq!(place.read("plain/track.csv"), place.read("regret/track.csv"));
    assert_eq!(place.lines("regret/regret.csv"), FRAMES, "names of columns, and each frame that was tracked");
    let text = String::from_utf8(place.read("regret/regret.csv")).expect("text");
    assert!(text.starts_with("frame,gaze_u,gaze_v,reward,best_reward,regret,total_regret"), "{text}");
    assert!(String::from_utf8(place.read("regret/regret.svg")).expect("text").contains("summed regret"));
    let output = place.run(&["track", "video", "-c", "c.toml", "--no-video", "--no-trace", "--regret", "-o", "page"]);
    assert!(output.status.success(), "{}", errors(&output));
    assert!(String::from_utf8(place.read("page/report.html")).expect("text").contains("\"regret\":{"));
}

#[test]
fn seeds_and_threads() {
    let place = Place::new();
    let first = place.boxes("a", &["video", "--seed", "4", "--threads", "1"]);
    assert_eq!(place.boxes("b", &["video", "--seed", "4", "--threads", "2"]), first, "threads change nothing");
    assert_eq!(place.read("a/track.csv"), place.read("b/track.csv"));
    assert_ne!(place.boxes("c", &["video", "--seed", "5"]), first, "another seed, another track");
}

#[test]
fn a_saved_state_goes_on_as_if_nothing_had_been() {
    let place = Place::new();
    let whole = place.boxes("whole", &["video"]);
    let mut parts = place.boxes("one", &["video", "--until", "4", "--save-state", "s.json"]);
    parts.extend(place.boxes("two", &["video", "--load-state", "s.json"]));
    assert_eq!(parts, whole);
    let text = String::from_utf8(place.read("s.json")).expect("text");
    for (bad, words) in [
        ("{}".into(), "not a state written by --save-state"),
        (text[..text.len() / 2].to_owned(), "not a state written by --save-state"),
        (
            text.replace(
                "\"particles\":[",
                "\"particles\":[{\"x\":0,\"y\":0,\"vx\":0,\"vy\":0,\"log_scale\":0,\"angle\":0},",
            ),
            "61 particles",
        ),
        (r#"{"next_frame":1,"tracker":null}"#.into(), "saved tracker"),
    ] {
        std::fs::write(place.path("bad.json"), bad).expect("a writable folder");
        let error = place.failure(&["video", "--load-state", "bad.json"]);
        assert!(error.contains(words), "{error}");
    }
    assert!(place.failure(&["video", "--load-state", "none.json"]).contains("none.json"));
}

#[test]
fn json_and_boxes_given_again() {
    let place = Place::new();
    let output = place.track("json", &["video", "--init", "50,60,28,28", "--reinit", "6:20,30,10.5,12", "--json"]);
    assert!(output.status.success(), "{}", errors(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on the standard output");
    assert_eq!((summary["frames"].as_u64(), summary["seed"].as_u64()), (Some(FRAMES as u64), Some(0)));
    assert!(summary["error"].is_null(), "{summary}");
    let text = String::from_utf8(place.read("json/boxes.txt")).expect("text");
    assert_eq!(text.lines().next(), Some("50.000,60.000,28.000,28.000"));
    assert_eq!(text.lines().nth(5), Some("20.000,30.000,10.500,12.000"));
}

#[test]
fn mistakes_are_told_in_words() {
    let place = Place::new();
    std::fs::create_dir(place.path("empty")).expect("a new folder");
    std::fs::create_dir_all(place.path("alone")).expect("a new folder");
    std::fs::copy(place.path("video/img/0001.png"), place.path("alone/0001.png")).expect("copied");
    std::fs::write(place.path("wrong.toml"), CONFIG.replace("gamma", "gama")).expect("a writable folder");
    let mut missing = vec![];
    for (args, words) in [
        (&["nowhere", "--init", "1,1,20,20"][..], &["nowhere"][..]),
        (&["empty", "--init", "1,1,20,20"], &["empty"]),
        (&["alone"], &["alone", "--init x,y,w,h"]),
        (&["video", "--init", "1,2,3"], &["x,y,w,h", "1,2,3"]),
        (&["video", "--init", "1,2,nan,4"], &["finite", "nan"]),
        (&["video", "--init", "1,2,0,4"], &["at least 2 x 2"]),
        (&["video", "--init", "-500,2,30,40"], &["touching the 250 x 200 picture"]),
        (&["video", "--init", "1e300,2,30,40"], &["touching"]),
        (&["video", "--reinit", "1:2,2,30,40"], &["frame number from 2"]),
        (&["video", "--reinit", "3:2,2,-30,40"], &["at least 2 x 2"]),
        (&["video", "--seed=-1"], &["--seed"]),
        (&["video", "--config", "no.toml"], &["cannot be used multiple times"]),
        (&["video", "--until", "0"], &["until"]),
    ] {
        let error = place.failure(args);
        for word in words {
            if !error.contains(word) {
                missing.push(format!("{args:?}: \"{word}\" is missing in: {error}"));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    let output = place.run(&["track", "video", "-c", "wrong.toml", "-o", "failed"]);
    let error = errors(&output);
    assert!(!output.status.success() && error.contains("wrong.toml") && error.contains("line 14"), "{error}");
    let error = errors(&place.run(&["track", "video", "-c", "nothing", "-o", "failed"]));
    assert!(error.contains("nothing") && error.contains("natural") && error.contains("digits"), "{error}");
}

/// The sixth picture is cut: five frames were tracked, and are kept.
#[test]
fn a_source_that_breaks_half_way_keeps_what_was_tracked() {
    let place = Place::new();
    let cut = |name: &Path| {
        let bytes = std::fs::read(name).expect("a picture");
        std::fs::write(name, &bytes[..bytes.len() / 2]).expect("a writable folder");
    };
    cut(&place.path("video/img/0006.png"));
    let output = place.run(&["track", "video", "-c", "c.toml", "-o", "half", "--json", "--save-state", "s.json"]);
    assert_eq!(output.status.code(), Some(1));
    let error = errors(&output);
    assert!(error.contains("0006.png") && error.contains("frame 6") && !error.contains("panicked"), "{error}");
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on the standard output");
    assert_eq!(summary["frames"].as_u64(), Some(5));
    assert!(summary["error"].as_str().is_some_and(|e| e.contains("frame 6")), "{summary}");
    assert_eq!((place.lines("half/boxes.txt"), place.lines("half/track.csv")), (5, 6));
    for file in ["trace.jsonl", "annotated.mp4", "report.html"] {
        assert!(place.path("half").join(file).is_file(), "{file}");
    }
    assert!(place.path("s.json").is_file(), "the state of the last good frame");

    // A film cut in its middle: what could be decoded is kept as well.
    let film = std::fs::read(place.path("half/annotated.mp4")).expect("a film");
    std::fs::write(place.path("cut.mp4"), &film[..film.len() / 2]).expect("a writable folder");
    let output = place.track("film", &["cut.mp4", "--init", "50,60,28,28"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("cut.mp4") && !errors(&output).contains("panicked"), "{}", errors(&output));
}
