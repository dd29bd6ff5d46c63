//! `foveate experiment clutter` through the program: the table, its files, and going on after a stop.

use std::path::Path;
use std::process::{Command, Output};

/// Two videos of 12 frames, of drawn digits.
fn clutter(dir: &Path, more: &[&str]) -> Output {
    let out = dir.join("out");
    Command::new(env!("CARGO_BIN_EXE_foveate"))
        .args([
            "experiment",
            "clutter",
            "--config",
            "digits-hedge",
            "--digits",
            "3,8",
            "--seeds",
            "1",
            "--frames",
            "12",
        ])
        .args(["--noise", "noisy", "--json", "--out"])
        .arg(&out)
        .args(more)
        .env("FOVEATE_DATA", dir)
        .current_dir(dir)
        .output()
        .expect("the program starts")
}

/// The table without what depends on the clock.
fn table(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut table: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on standard output");
    for line in table["lines"].as_array_mut().expect("lines") {
        line.as_object_mut().expect("a line").remove("fps").expect("frames a second");
    }
    table
}

#[test]
fn it_makes_a_table_and_goes_on_after_a_stop() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let first = clutter(dir.path(), &["--threads", "1"]);
    let said = String::from_utf8_lossy(&first.stderr).into_owned();
    assert!(said.contains("NOT MNIST") && said.contains("4 runs, 0 of them"), "{said}");
    let table_1 = table(&first);
    let lines = table_1["lines"].as_array().expect("lines");
    let policies: Vec<_> = lines.iter().map(|line| line["policy"].as_str().expect("a name")).collect();
    assert_eq!(policies, ["fixed", "hedge"]);
    for line in lines {
        assert_eq!((line["videos"].as_u64(), line["noise"].as_f64()), (Some(2), Some(0.3)));
        // 11 frames from a true first box, at most 5 px a frame: it cannot be a video's diagonal away.
        assert!((0.0..320.0).contains(&line["mean"].as_f64().expect("pixels")), "{line}");
    }
    assert!(lines[0]["against_fixed"].is_null() && lines[1]["against_fixed"]["high"].is_f64());
    assert!(std::fs::read_to_string(dir.path().join("out/table.txt")).expect("a table").contains("ten videos"));

    // Stopped after two runs, while a third was being written in place.
    let mut runs: Vec<_> = std::fs::read_dir(dir.path().join("out/runs"))
        .expect("finished runs")
        .map(|entry| entry.expect("a file").path())
        .collect();
    runs.sort();
    assert_eq!(runs.len(), 4);
    std::fs::remove_file(&runs[0]).expect("a finished run");
    let whole = std::fs::read(&runs[1]).expect("a finished run");
    std::fs::write(&runs[1], &whole[..whole.len() / 2]).expect("a writable folder");
    let kept = std::fs::metadata(&runs[3]).and_then(|m| m.modified()).expect("a finished run");
    let again = clutter(dir.path(), &["--threads", "3"]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("4 runs, 2 of them from"));
    assert_eq!(table(&again), table_1, "neither the stop nor the number of threads shows");
    assert_eq!(std::fs::metadata(&runs[3]).and_then(|m| m.modified()).expect("a finished run"), kept);

    // All policies share the runs of those two.
    let all = clutter(dir.path(), &["--policies"]);
    assert!(String::from_utf8_lossy(&all.stderr).contains("28 runs, 4 of them from"));
    let all = table(&all);
    let find = |policy: &str| all["lines"].as_array().expect("lines").iter().find(|l| l["policy"] == policy).cloned();
    assert_eq!(find("hedge").as_ref(), Some(&lines[1]));
    assert!(find("anchor+hedge").is_some());

    for wrong in [&["--digits", "7-12"][..], &["--frames", "1"], &["--config", "nothing"], &["--data", "nowhere"]] {
        let output = Command::new(env!("CARGO_BIN_EXE_foveate"))
            .args(["experiment", "clutter", "--out"])
            .arg(dir.path().join("wrong"))
            .args(wrong)
            .current_dir(dir.path())
            .output()
            .expect("the program starts");
        assert!(!output.status.success() && !output.stderr.is_empty(), "{wrong:?}");
    }
}

#[test]
fn the_curve_is_drawn_and_goes_on_after_a_stop() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let curve = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_foveate"))
            .args([
                "experiment",
                "hedge-curve",
                "--digits",
                "3,8",
                "--seeds",
                "2",
                "--frames",
                "25",
                "--json",
                "-o",
                "out",
            ])
            .args(more)
            .env("FOVEATE_DATA", dir.path())
            .current_dir(dir.path())
            .output()
            .expect("the program starts")
    };
    let first = curve(&["--threads", "1"]);
    assert!(first.status.success(), "{}", String::from_utf8_lossy(&first.stderr));
    let table: serde_json::Value = serde_json::from_slice(&first.stdout).expect("JSON alone on standard output");
    let all = &table["curves"][0];
    assert_eq!((all["name"].as_str(), all["runs"].as_u64()), (Some("authors: all"), Some(4)));
    assert_eq!(all["points"].as_array().map(Vec::len), Some(24));
    let mean = all["points"][0]["mean"].as_f64().expect("a probability");
    assert!((mean - 1.0 / 9.0).abs() < 0.02, "one frame changes little: {mean}");
    for name in ["table.txt", "table.json", "curve.svg"] {
        assert!(dir.path().join("out").join(name).is_file(), "{name}");
    }
    let again = curve(&["--threads", "2"]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("4 runs, 4 of them from"));
    assert_eq!(again.stdout, first.stdout);
    let other = curve(&["--template", "authors"]);
    assert!(String::from_utf8_lossy(&other.stderr).contains("4 runs, 0 of them from"), "another template, other runs");
    assert!(!curve(&["--policies"]).status.success());
    let fixed = dir.path().join("fixed.toml");
    std::fs::write(&fixed, "particles = 5").expect("a writable folder");
    assert!(!curve(&["-c", "fixed.toml"]).status.success());
}

#[test]
fn surfaces_are_drawn_for_policies_that_have_one() {
    let dir = tempfile::tempdir().expect("a folder");
    let run = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_foveate"))
            .args(["experiment", "surfaces", "--digits", "3", "--runs", "2", "--frames", "30", "--out", "out"])
            .args(more)
            .env("FOVEATE_DATA", "nowhere")
            .current_dir(dir.path())
            .output()
            .expect("the program starts")
    };
    assert!(run(&[]).status.success());
    let text = std::fs::read(dir.path().join("out/surfaces.json")).expect("results");
    let all: serde_json::Value = serde_json::from_slice(&text).expect("valid JSON");
    assert_eq!(all["surfaces"][0]["best"].as_array().map(Vec::len), Some(2));
    assert!(dir.path().join("out/surfaces.png").is_file());
    let other = run(&["--config", "digits"]);
    assert!(!other.status.success() && String::from_utf8_lossy(&other.stderr).contains("gp-ucb"));
}

#[test]
fn many_digits_are_followed_scored_and_shown() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let multi = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_foveate"))
            // Few frames: what 300 have room for would be too fast here.
            .args(["experiment", "multi", "--seeds", "1", "--frames", "24", "--crossings", "0", "--scale", "1,1.3"])
            .args(["--turn", "10", "--json", "--out"])
            .arg(dir.path().join("out"))
            .args(more)
            .env("FOVEATE_DATA", dir.path())
            .current_dir(dir.path())
            .output()
            .expect("the program starts")
    };
    let first = multi(&["--threads", "1"]);
    let table_1 = table(&first);
    let lines = table_1["lines"].as_array().expect("lines");
    assert_eq!(lines.len(), 2, "together and alone");
    for line in lines {
        // 23 frames of targets that start apart, from true boxes.
        assert!(line["idf1"].as_f64().expect("a share") > 0.9, "{line}");
        assert!(line["scale_error"][0].as_f64().expect("a share") < 0.1, "{line}");
    }
    let again = multi(&["--figure"]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("2 runs, 2 of them"));
    for file in ["figure.png", "annotated.mp4", "report.html", "table.txt"] {
        assert!(std::fs::metadata(dir.path().join("out").join(file)).expect(file).len() > 400, "{file}");
    }
}
