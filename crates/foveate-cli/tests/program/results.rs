//! The folder of results: an earlier run is replaced by a whole one or not at all, whatever happens to the program.

use std::collections::BTreeMap;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::place::{FRAMES, PROGRAM, Place, done, errors, failed};

/// All files of a folder.
fn files(place: &Place, folder: &str) -> BTreeMap<String, Vec<u8>> {
    place.names(folder).into_iter().map(|name| (name.clone(), place.read(&format!("{folder}/{name}")))).collect()
}

/// A run that takes its time.
fn slow(place: &Place, out: &str) -> Child {
    let args = ["track", "video", "-c", "c.toml", "-o", out, "--set", "particles=20000", "--no-report"];
    place.command(&args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts")
}

/// Waits until a run has tracked some frames; answers the folder that it writes to.
fn in_the_making(place: &Place, run: &Child) -> String {
    let part = format!(".out.{}.tmp", run.id());
    let until = Instant::now() + Duration::from_secs(60);
    let tracked = || {
        let names = if place.path(&part).is_dir() { place.names(&part) } else { vec![] };
        let boxes = names.iter().find(|name| name.starts_with(".boxes.txt"));
        boxes.is_some_and(|name| std::fs::read(place.path(&part).join(name)).is_ok_and(|text| text.len() > 60))
    };
    while !tracked() {
        assert!(Instant::now() < until, "nothing is tracked in {part}: {:?}", place.names(""));
        std::thread::sleep(Duration::from_millis(2));
    }
    part
}

#[test]
fn a_mistake_leaves_an_earlier_run_as_it_was() {
    let place = Place::new();
    place.boxes("out", &["video"]);
    let (before, beside) = (files(&place, "out"), place.names(""));
    place.write("s.json", "{}");
    for args in [
        &["video", "--init", "1000,1000,50,50"][..],
        &["video", "--init", "1,1,1,1"],
        &["video", "--until", "99"],
        &["video", "--reinit", "99:1,1,50,50"],
        &["nowhere"],
        &["video", "--detections", "nothing.txt"],
        &["video", "--load-state", "s.json"],
        &["video", "--recognise", "nothing.safetensors"],
        &["video", "--set", "policy.kind=best"],
    ] {
        let output = place.track("out", args);
        assert!(!output.status.success() && output.stdout.is_empty(), "{args:?}");
        assert!(files(&place, "out") == before, "{args:?}");
    }
    std::fs::remove_file(place.path("s.json")).expect("it is there");
    assert_eq!(place.names(""), beside, "and nothing beside it");
    // The second frame breaks: nothing was tracked, and nothing is replaced.
    place.write("video/img/0002.png", "broken");
    assert!(failed(&place.track("out", &["video"])).contains("is unchanged"));
    assert!(files(&place, "out") == before && place.names("") == beside);
    // Where the sixth one breaks, the frames before are kept, and a warning reports that the rest is missing.
    std::fs::copy(place.path("video/img/0003.png"), place.path("video/img/0002.png")).expect("a picture");
    place.write("video/img/0006.png", "broken");
    assert!(!place.track("out", &["video"]).status.success());
    assert_eq!((place.lines("out/boxes.txt"), ended(&place)), (5, ("error".into(), 5)));
}

/// How the run in `out` ended, and after how many frames.
fn ended(place: &Place) -> (String, usize) {
    let run = place.json("out/run.json");
    (run["ended"].as_str().expect("a word").to_owned(), run["frames"].as_u64().expect("a number") as usize)
}

#[test]
fn files_of_an_earlier_run_go_and_others_stay() {
    let place = Place::new();
    place.run(["track", "video", "-c", "c.toml", "-o", "out", "--trace", "--regret"]);
    assert_eq!(place.names("out").len(), 9);
    place.boxes("out", &["video", "--until", "4"]);
    assert_eq!(place.names("out"), ["boxes.txt", "run.json", "track.csv"]);
    place.write("out/notes.txt", "mine");
    place.done(["track", "video", "-c", "c.toml", "-o", "out", "--no-video", "--trace"]);
    place.boxes("out", &["video", "--init", "50,60,28,28", "--save-state", "out/s.json"]);
    assert_eq!(place.names("out"), ["boxes.txt", "notes.txt", "run.json", "s.json", "track.csv"]);
    assert_eq!(place.read("out/notes.txt"), b"mine");
    // Many targets make other files.
    place.tracked("out", &["video", "--init", "50,60,28,28", "--init", "90,90,28,28"]);
    assert_eq!(place.names("out"), ["notes.txt", "run.json", "s.json", "targets.csv", "tracks.csv", "tracks.txt"]);
    // An output does not replace its source.
    place.run(["track", "video", "-c", "c.toml", "-o", "film", "--no-report"]);
    let refused = failed(&place.track("film", &["film/annotated.mp4", "--init", "50,60,28,28"]));
    assert!(refused.contains("give another --out"), "{refused}");
    assert!(place.path("film/annotated.mp4").is_file());
}

/// Inputs stay unchanged, even if an output has their name.
#[test]
fn what_is_read_is_not_written_over() {
    let place = Place::new();
    // A folder of frames with its truth, and a file with its first box, named as a result.
    let frame = "video/img/0003.png";
    place.write("bx/boxes.png", place.read(frame));
    place.write("bx/boxes.txt", place.read("video/groundtruth_rect.txt"));
    let before = [files(&place, "video/img"), files(&place, "bx")];
    let config = place.read("c.toml");
    let refused = |args: &[&str], said: &str| {
        place.refuses(args, said);
        assert!([files(&place, "video/img"), files(&place, "bx")] == before && place.read("c.toml") == config);
    };
    let read = "it is read, and would be replaced";
    let state = |to| ["track", "video", "-c", "c.toml", "--no-video", "--save-state", to];
    refused(&state("./c.toml"), read);
    refused(&state(frame), "would become a frame of video");
    refused(&state("video/groundtruth_rect.txt"), read);
    refused(&["track", "bx/boxes.png", "--save-state", "bx/boxes.png"], read);
    refused(&["track", "bx/boxes.png", "--out", "bx"], read);
    refused(&["track", "video", "--detect", "--save-detections", frame], "would become a frame of video");
    refused(&["look", "video", "--map", "saliency", "-o", frame], "would become a frame of video");
    refused(&["look", "video/img", "--map", "saliency", "-o", "video/img/new.PNG"], "would become a frame");
    refused(&["look", frame, "--map", "saliency", "-o", frame], read);
    let convert = ["convert", "--from", "otb", "--to", "vot", "bx/boxes.txt", "bx/../bx/boxes.txt"];
    refused(&convert, read);
    refused(
        &["track", "video/img", "-c", "c.toml", "--init", "9,9,28,28", "-o", "video/img"],
        "surface.png: it would become",
    );
    // Beside the frames there is room, and a state that is taken up may be written anew.
    place.boxes("out", &["video", "--until", "4", "--save-state", "video/img/s.json"]);
    place.boxes("out", &["video", "--load-state", "video/img/s.json", "--save-state", "video/img/s.json"]);
}

#[test]
fn results_in_the_folder_that_the_program_runs_in() {
    let place = Place::new();
    let video = place.path("video");
    std::fs::create_dir(place.path("here")).expect("a new folder");
    for _ in 0..2 {
        let mut command = place.command(["track", "-c", "../c.toml", "--no-video", "--no-report", "-o", "."]);
        done(command.arg(&video).current_dir(place.path("here")));
        assert_eq!(place.names("here"), ["boxes.txt", "run.json", "track.csv"]);
    }
}

#[test]
fn a_killed_run_leaves_the_earlier_one_and_is_cleared_away() {
    let place = Place::new();
    place.boxes("out", &["video"]);
    let before = files(&place, "out");
    let mut run = slow(&place, "out");
    let part = in_the_making(&place, &run);
    run.kill().expect("killed with signal 9");
    run.wait().expect("it ended");
    assert!(files(&place, "out") == before, "the earlier run, whole");
    assert!(place.path(&part).is_dir(), "it could not clear away");
    // Another folder's remains are none of this run's business.
    place.boxes("other", &["video"]);
    assert!(place.path(&part).is_dir());
    place.boxes("out", &["video"]);
    assert!(!place.path(&part).exists());
}

/// Killed at many moments of a short run, the folder holds the earlier run or the new one, never a mixture.
#[test]
fn whenever_it_is_killed_one_run_is_whole() {
    let place = Place::new();
    place.boxes("out", &["video", "--until", "4"]);
    let args = ["track", "video", "-c", "c.toml", "-o", "out", "--no-video", "--no-report"];
    let began = Instant::now();
    place.done(args);
    let long = began.elapsed();
    let (mut new, mut old) = (0, 0);
    for i in 0..24 {
        place.boxes("out", &["video", "--until", "4"]);
        let mut run = place.command(&args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
        std::thread::sleep(long.mul_f64(0.5 + f64::from(i) / 24.0));
        let _ = run.kill();
        run.wait().expect("it ended");
        assert_eq!(place.names("out"), ["boxes.txt", "run.json", "track.csv"]);
        let (boxes, rows) = (place.lines("out/boxes.txt"), place.lines("out/track.csv"));
        assert!(rows == boxes + 1 && [4, FRAMES].contains(&boxes), "{boxes} boxes, {rows} rows");
        *(if boxes == FRAMES { &mut new } else { &mut old }) += 1;
    }
    eprintln!("{old} times the earlier run, {new} times the new one");
}

/// A limit on the size of files is as a full disk: the error names the file, and the earlier run stays.
#[cfg(unix)]
#[test]
fn a_limit_on_files_is_an_error() {
    let place = Place::new();
    let args = ["track", "video", "-c", "c.toml", "-o", "out"];
    place.done(args);
    let before = files(&place, "out");
    let mut command = std::process::Command::new("bash");
    command.current_dir(place.path("")).args(["-c", "ulimit -f 4 && exec \"$@\"", "bash", PROGRAM]).args(args);
    let output = command.output().expect("bash");
    let said = errors(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("annotated.mp4 was not written: ") && said.contains("File too large"), "{said}");
    assert!(files(&place, "out") == before);
}

#[cfg(unix)]
#[test]
fn a_run_that_is_asked_to_stop_keeps_what_it_tracked() {
    let place = Place::new();
    let mut run = slow(&place, "out");
    in_the_making(&place, &run);
    let asked = std::process::Command::new("kill").args(["-INT", &run.id().to_string()]).status();
    assert!(asked.is_ok_and(|status| status.success()));
    let code = run.wait().expect("it ended").code();
    let (boxes, rows) = (place.lines("out/boxes.txt"), place.lines("out/track.csv"));
    assert!(rows == boxes + 1 && boxes > 1, "{boxes} boxes, {rows} rows");
    // The signal may have come at the last frame.
    let word = if code == Some(0) { "finished" } else { "stopped" };
    assert!(code == Some(130) || (boxes == FRAMES && code == Some(0)), "{code:?}");
    assert_eq!(ended(&place), (word.to_owned(), boxes));
    assert!(!place.names("").iter().any(|name| name.starts_with(".out")), "nothing else stays");
}
