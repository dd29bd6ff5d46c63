//! Every operation on a file fails once, and the program is killed at any moment: nothing half-written gets a final name, an error
//! names the file, and the next run ends as if nothing had been.
//!
//! The failures are those of `foveate_base::files::faults`; tests are built with them, programs that are released are not.
#![cfg(debug_assertions)]

mod job;
#[path = "../place/mod.rs"]
mod place;

use std::io::Write;
use std::process::Stdio;

use job::{Job, files};
use place::{Place, errors};

fn track() -> Job {
    let args = "track video -c c.toml --until 3 -o out --save-state out.json --threads 1";
    Job::new(Place::new(), args.split(' '))
}

fn train() -> Job {
    let place = Place::new();
    std::fs::create_dir(place.path("data")).expect("a new folder");
    let inside = |i, x, y| (4 + i % 7..20 + i % 5).contains(&x) && (6..14 + i % 11).contains(&y);
    foveate_testing::write_digits(&place.path("data"), "train", 60, 10, inside);
    let args = "train rbm --data data --recipe digits --set training.hidden=8 --set training.epochs=3 --set glimpses.number=200 \
                --set glimpses.held_out=20 --out out.safetensors --threads 1";
    Job::new(place, args.split(' '))
}

fn eval() -> Job {
    Job::new(Place::new(), "eval --seqs video --config c.toml --out out --threads 1".split(' '))
}

#[test]
fn each_failure_of_a_run_leaves_everything_whole() {
    for (job, most) in [(track(), 2), (train(), 2), (eval(), 1)] {
        let counts = job.fail_each(most);
        assert!(counts.iter().all(|n| *n > 0), "{:?}: {counts:?}", job.args);
        job.kill(2);
    }
}

/// An output that fails in mid-run costs that file, an error and the status; the others are as they are without it.
#[test]
fn an_output_that_fails_ends_alone() {
    let place = Place::new();
    let run = |out: &str, fault: Option<&str>| {
        let mut command = place.command(["track", "video", "-c", "c.toml", "-o", out, "--trace", "--no-report"]);
        command.envs(fault.map(|fault| ("FOVEATE_FAULT", fault)));
        command.output().expect("it starts")
    };
    assert!(run("whole", None).status.success());
    let names = ["annotated.mp4", "boxes.txt", "run.json", "trace.jsonl", "track.csv"];
    assert_eq!(place.names("whole"), names);
    for lost in ["annotated.mp4", "trace.jsonl", "track.csv"] {
        let output = run("out", Some(&format!("write@{lost}:1")));
        let said = errors(&output);
        assert!(output.status.code() == Some(1) && said.contains(&format!("{lost} was not written")), "{said}");
        let left: Vec<_> = names.into_iter().filter(|name| *name != lost).collect();
        assert_eq!(place.names("out"), left);
        for name in left.iter().filter(|name| **name != "run.json") {
            assert!(place.read(&format!("out/{name}")) == place.read(&format!("whole/{name}")), "{lost}: {name}");
        }
    }
    // Nor does a run that lost a file take the place of one that finished.
    let good = files(&place.path("whole"));
    let said = errors(&run("whole", Some("write@track.csv:1")));
    assert!(
        said.contains("whole/track.csv") && said.contains("whole.unplaced-") && !said.contains(".whole."),
        "{said}"
    );
    assert!(files(&place.path("whole")) == good);
    // Everything fails: nothing is put in the place of an earlier run.
    let output = run("whole", Some("write:1+"));
    assert!(output.status.code() == Some(1), "{}", errors(&output));
    assert_eq!(place.names("whole"), names);
}

/// A live run on a disk that fills keeps its lines, and reports it even if the stream breaks off.
#[test]
fn a_live_run_on_a_full_disk_keeps_its_lines() {
    let place = Place::new();
    let frame = 64 * 48;
    let run = |out: &str, fault: &str, bytes: usize| {
        let args = ["track", "-", "--raw", "64x48", "--pix", "gray", "--init", "9,9,20,20", "-c", "c.toml", "-o", out];
        let mut command = place.command([&args[..], &["--no-video", "--no-report", "--json"]].concat());
        command.env("FOVEATE_FAULT", fault).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        let pixels: Vec<u8> = (0..bytes).map(|i| (i % frame * 37 % 251) as u8).collect();
        child.stdin.take().expect("a pipe").write_all(&pixels).expect("it reads all");
        let output = child.wait_with_output().expect("it ends");
        (errors(&output), String::from_utf8(output.stdout).expect("text"))
    };
    let (said, summary) = run("out", "write@boxes.txt:5+", 10 * frame);
    assert!(summary.contains("out/boxes.txt") && summary.contains("out/track.csv"), "{summary}");
    assert!(said.contains("boxes.txt ends early: ") && said.contains("failed on request"), "{said}");
    assert_eq!(place.names("out"), ["boxes.txt", "run.json", "track.csv"]);
    assert_eq!((place.lines("out/boxes.txt"), place.lines("out/track.csv")), (4, 11));
    let (said, _) = run("cut", "write@boxes.txt:5+", 10 * frame + 9);
    assert!(said.contains("boxes.txt ends early: ") && said.contains("frame 11: "), "{said}");
    assert_eq!((place.lines("cut/boxes.txt"), place.lines("cut/track.csv")), (4, 11));
    // The list of files cannot be written either.
    let (said, _) = run("full", "write:9+", 10 * frame);
    let (_, folder) = said.trim().rsplit_once("of this run are in ").expect("where it is");
    assert_eq!(
        (place.lines(&format!("{folder}/boxes.txt")), place.lines(&format!("{folder}/track.csv"))),
        (4, 5),
        "{said}"
    );
}

/// `cargo test -p foveate-cli --test faults -- --ignored --nocapture`: all failures of all commands, and a hundred kills of each; of one
/// command with `FOVEATE_FAULTS=train`.
#[test]
#[ignore = "takes many minutes"]
fn every_failure_and_a_hundred_kills() {
    let asked = std::env::var("FOVEATE_FAULTS").unwrap_or_default();
    for job in [track(), train(), eval()].into_iter().filter(|job| job.args[0].contains(&asked)) {
        let counts = job.fail_each(usize::MAX);
        println!("{:?}: failures of open, write, sync, rename: {counts:?}", job.args);
        job.kill(100);
    }
}
