//! `foveate track` as a user meets it: files in, files out, and its errors.

use foveate_testing::need;

use crate::place::{CONFIG, FRAMES, Place, errors, json, printed};

#[test]
fn every_file_is_there_with_a_line_for_each_frame() {
    let place = Place::new();
    let said = printed(&place.done(["track", "video", "-c", "c.toml", "-o", "all", "--trace"]));
    for words in ["10 frames tracked, occluded in ", ", lost in ", " in the tracker, ", " end to end.", "boxes.txt"] {
        assert!(said.contains(words), "{said}");
    }
    assert_eq!(place.lines("all/boxes.txt"), FRAMES);
    assert_eq!(place.lines("all/track.csv"), FRAMES + 1, "names of columns first");
    let text = place.text("all/trace.jsonl");
    assert!(text.lines().all(|line| serde_json::from_str::<serde_json::Value>(line).is_ok()));
    assert!(text.lines().count() >= FRAMES);
    assert_eq!(&place.read("all/annotated.mp4")[4..8], b"ftyp");
    assert!(place.read("all/report.html").starts_with(b"<!"));
    assert!(place.read("all/surface.png").starts_with(b"\x89PNG"));
    // Without --init the first line of the truth is the start.
    let first = |name: &str| -> Vec<f64> {
        let text = place.text(name);
        text.lines().next().expect("a line").split([',', '\t']).map(|n| n.trim().parse().expect("a number")).collect()
    };
    assert_eq!(first("all/boxes.txt"), first("video/groundtruth_rect.txt"));
    let all = ["annotated.mp4", "boxes.txt", "report.html", "run.json", "surface.png", "trace.jsonl", "track.csv"];
    assert_eq!(place.names("all"), all);
    place.boxes("few", &["video"]);
    assert_eq!(place.names("few"), ["boxes.txt", "run.json", "track.csv"], "no trace unless asked for");
    // The command of the report is one for a shell.
    place.done(["track", "video", "-c", "c.toml", "-o", "two words", "--no-video"]);
    assert!(place.text("two words/report.html").contains("-o 'two words' --no-video"));
}

/// A frame without a true box takes nothing from those after it.
#[test]
fn truth_may_have_gaps() {
    let place = Place::new();
    let truth = place.text("video/groundtruth_rect.txt");
    let gap = |(i, line)| if i == 2 { "NaN,NaN,NaN,NaN\n".to_owned() } else { format!("{line}\n") };
    let truth: String = truth.lines().enumerate().map(gap).collect();
    place.write("video/groundtruth_rect.txt", truth);
    place.done(["track", "video", "-c", "c.toml", "-o", "out"]);
    let page = place.text("out/report.html");
    let known = page.split_once("\"true_x\":[").expect("a column").1.split(']').next().expect("its values");
    let known: Vec<bool> = known.split(',').map(|value| value != "null").collect();
    assert_eq!(known, (0..FRAMES).map(|i| i != 2).collect::<Vec<_>>());
}

#[test]
fn regret_is_written_and_changes_no_box() {
    let place = Place::new();
    let plain = place.boxes("plain", &["video"]);
    assert_eq!(place.boxes("regret", &["video", "--regret"]), plain);
    assert_eq!(place.read("plain/track.csv"), place.read("regret/track.csv"));
    assert_eq!(place.lines("regret/regret.csv"), FRAMES, "names of columns, and each frame that was tracked");
    let text = place.text("regret/regret.csv");
    assert!(text.starts_with("frame,gaze_u,gaze_v,reward,best_reward,regret,cumulative_regret"), "{text}");
    assert!(place.text("regret/regret.svg").contains("summed regret"));
    place.done(["track", "video", "-c", "c.toml", "--no-video", "--regret", "-o", "page"]);
    assert!(place.text("page/report.html").contains("\"regret\":{"));
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
    // Every second frame goes on from the last tracked one.
    let whole = place.boxes("whole", &["video", "--every", "2", "--from", "2"]);
    let mut parts =
        place.boxes("one", &["video", "--every", "2", "--from", "2", "--until", "5", "--save-state", "e.json"]);
    parts.extend(place.boxes("two", &["video", "--every", "2", "--load-state", "e.json"]));
    assert_eq!(parts, whole);
    let text = place.text("s.json");
    for (bad, words) in [
        ("{}".into(), "not a state written by --save-state"),
        (text[..text.len() / 2].to_owned(), "not a state written by --save-state"),
        (
            text.replace(
                "\"particles\":[",
                "\"particles\":[{\"x\":0,\"y\":0,\"vx\":0,\"vy\":0,\"log_scale\":0,\"angle\":0,\"log_aspect\":0},",
            ),
            "bad.json: the saved filter cannot be used: it has 61 particles",
        ),
        (r#"{"next_frame":1,"tracker":null}"#.into(), "not a state written by --save-state"),
        (text.replace("\"format\":", "\"format\":1"), "saved tracker"),
    ] {
        place.write("bad.json", bad);
        let error = place.failure(&["video", "--load-state", "bad.json"]);
        assert!(error.contains(words), "{error}");
    }
    let smaller = place.failure(&["video", "--load-state", "s.json", "--scale", "0.5"]);
    assert!(
        smaller.contains("s.json: it was saved in pictures of 250 x 200") && smaller.contains("--scale"),
        "{smaller}"
    );
    assert!(place.failure(&["video", "--load-state", "none.json"]).contains("none.json"));
    assert!(
        place.failure(&["video", "--load-state", "s.json", "--seed", "9"]).contains("seed is 0 in the state and 9")
    );
    let other = place.failure(&["video", "--load-state", "s.json", "--set", "particles=50"]);
    assert!(other.contains("s.json: ") && other.contains("particles is 60 in the state and 50"), "{other}");
    assert!(place.failure(&["video", "--load-state", "s.json", "--until", "3"]).contains("continues at frame 5"));
}

#[test]
fn json_and_boxes_given_again() {
    let place = Place::new();
    let args = ["video", "--init", "50,60,28,28", "--reinit", "6:20,30,10.5,12", "--json"];
    let summary = json(&place.tracked("json", &args));
    assert_eq!((summary["frames"].as_u64(), summary["seed"].as_u64()), (Some(FRAMES as u64), Some(0)));
    assert!(summary["error"].is_null(), "{summary}");
    for key in ["occluded_frames", "lost_frames", "outside_frames", "total_fps", "total_seconds"] {
        assert!(summary[key].is_number(), "{key}: {summary}");
    }
    let text = place.text("json/boxes.txt");
    assert_eq!(text.lines().next(), Some("50.000,60.000,28.000,28.000"));
    assert_eq!(text.lines().nth(5), Some("20.000,30.000,10.500,12.000"));
}

#[test]
fn mistakes_have_clear_errors() {
    let place = Place::new();
    // The profiles are of one target.
    place.refuses(["track", "video", "--detect", "--profile", "fast", "-o", "no"], "--profile is for one target");
    std::fs::create_dir(place.path("empty")).expect("a new folder");
    place.write("alone/0001.png", place.read("video/img/0001.png"));
    place.write("wrong.toml", CONFIG.replace("gamma", "gama"));
    place.write("head.y4m", "YUV4MPEG2 W64 H48 F30:1 C420\n");
    place.write("last.txt", "10,1,9,9,20,20,1\n");
    place.write("late.txt", "11,1,9,9,20,20,1\n");
    place.write("far.txt", "1,1,9,9,20,20,1\n2,2,900,9,20,20,1\n");
    let mut missing = vec![];
    for (args, words) in [
        (&["nowhere", "--init", "1,1,20,20"][..], &["nowhere"][..]),
        (&["empty", "--init", "1,1,20,20"], &["empty"]),
        (&["alone"], &["alone", "--init x,y,w,h"]),
        (&["video", "--raw", "64x48"], &["--raw is for files and pipes"]),
        (&["video", "--pix", "gray"], &["--raw"]),
        (&["video", "--reconnect", "60"], &["--reconnect is for streams"]),
        (&["video", "--detections", "late.txt", "--least", "nan"], &["--least", "a number such as 0.5"]),
        (&["head.y4m", "--init", "1,1,20,20"], &["head.y4m: the source has no frame"]),
        (&["video", "--init", "1,2,3"], &["x,y,w,h", "1,2,3"]),
        (&["video", "--init", "1,2,nan,4"], &["finite", "nan"]),
        (&["video", "--init", "1,2,0,4"], &["at least 2 x 2"]),
        (&["video", "--init", "1,2,1001,40"], &["at most 1000 x 800"]),
        (&["video", "--init", "-500,2,30,40"], &["touching the 250 x 200 picture"]),
        (&["video", "--init", "1e300,2,30,40"], &["touching"]),
        (&["video", "--reinit", "1:2,2,30,40"], &["frame number from 2"]),
        (&["video", "--reinit", "3:2,2,-30,40"], &["at least 2 x 2"]),
        (&["video", "--seed=-1"], &["--seed"]),
        (&["video", "--config", "no.toml"], &["cannot be used multiple times"]),
        (&["video", "--until", "0"], &["until"]),
        (&["video", "--from", "8", "--until", "3", "--init", "9,9,20,20"], &["--until 3: --from begins at frame 8"]),
        (&["video", "--until", "11"], &["--until 11", "10 frames"]),
        (&["video", "--reinit", "11:2,2,30,40"], &["--reinit 11", "frames 1 to 10"]),
        (&["video", "--until", "5", "--reinit", "6:2,2,30,40"], &["--reinit 6", "frames 1 to 5"]),
        (&["video", "--reinit", "3:2,2,30,40", "--reinit", "3:9,2,30,40"], &["--reinit 3", "two boxes"]),
        (&["video", "--reinit", "3:1000,2,30,40"], &["--reinit 3", "x=1000", "touching the 250 x 200 picture"]),
        (&["video", "--save-state", "no/s.json"], &["s.json", "no folder"]),
        (&["video", "--set", "particles=0"], &["particles=0"]),
        (&["video", "--set", "nothing"], &["key=value"]),
        (&["video", "--policy", "best"], &["best", "gp-ucb"]),
        (&["video", "--no-trace"], &["--no-trace"]),
        (&["video", "--init", "9,9,20,20", "--init", "900,9,20,20"], &["target 2", "x=900", "touching"]),
        (&["video", "--save-detections", "d.txt"], &["--detect KIND"]),
        (&["video", "--detect", "--trace"], &["--trace is for one target"]),
        (&["video", "--inits", "late.txt"], &["late.txt", "frame 11", "10 frames"]),
        (&["video", "--inits", "far.txt"], &["far.txt", "frame 2", "x=900"]),
        (&["video", "--inits", "last.txt", "--until", "9"], &["last.txt", "up to frame 9", "--until"]),
        (&["alone", "--init", "motion"], &["alone", "needs two frames"]),
        (&["video", "--detections", "late.txt"], &["late.txt", "none of its 1 boxes counts"]),
        (&["video", "--detections", "no.txt"], &["no.txt"]),
        (&["video", "--detect", "--load-state", "s.json"], &["--load-state is for one target", "leave --detect"]),
        (&["-", "--detect", "--save-detections", "d.txt"], &["for videos with an end"]),
    ] {
        let error = place.failure(args);
        for word in words {
            if !error.contains(word) {
                missing.push(format!("{args:?}: \"{word}\" is missing in: {error}"));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(!place.path("failed").exists(), "nothing was made");
    let output = place.run(["track", "video", "-c", "wrong.toml", "-o", "failed"]);
    let error = errors(&output);
    assert!(!output.status.success() && error.contains("wrong.toml") && error.contains("line 14"), "{error}");
    let error = errors(&place.run(["track", "video", "-c", "nothing", "-o", "failed"]));
    assert!(error.contains("nothing") && error.contains("natural") && error.contains("digits"), "{error}");
}

/// The error for a network in a build without networks states how to get one.
#[cfg(not(feature = "onnx"))]
#[test]
fn a_build_without_onnx_says_so() {
    let place = Place::new();
    for args in [
        &["video", "--detect", "onnx:a.onnx"][..],
        &["video", "--set", "encoder={ kind = \"onnx\", model = \"a.onnx\" }"],
        &["video", "--set", "detector={ kind = \"onnx\", model = \"a.onnx\" }"],
    ] {
        let error = place.failure(args);
        let words = ["a.onnx", "has no ONNX", "cargo build --release --features onnx"];
        assert!(words.iter().all(|word| error.contains(word)), "{args:?}: {error}");
    }
}

/// The sixth picture is cut: five frames were tracked, and are kept.
#[test]
fn a_source_that_breaks_half_way_keeps_what_was_tracked() {
    let place = Place::new();
    let picture = place.read("video/img/0006.png");
    place.write("video/img/0006.png", &picture[..picture.len() / 2]);
    let half = ["track", "video", "-c", "c.toml", "-o", "half", "--trace", "--json", "--save-state", "s.json"];
    let output = place.run(&half);
    assert_eq!(output.status.code(), Some(1));
    let error = errors(&output);
    assert!(error.contains("0006.png") && error.contains("frame 6") && !error.contains("panicked"), "{error}");
    let summary = json(&output);
    assert_eq!(summary["frames"].as_u64(), Some(5));
    assert!(summary["error"].as_str().is_some_and(|e| e.contains("frame 6")), "{summary}");
    assert_eq!((place.lines("half/boxes.txt"), place.lines("half/track.csv")), (5, 6));
    for file in ["trace.jsonl", "annotated.mp4", "report.html"] {
        assert!(place.path("half").join(file).is_file(), "{file}");
    }
    assert!(place.path("s.json").is_file(), "the state of the last good frame");

    // A film cut in its middle: what could be decoded is kept as well.
    let film = place.read("half/annotated.mp4");
    place.write("cut.mp4", &film[..film.len() / 2]);
    let output = place.track("film", &["cut.mp4", "--init", "50,60,28,28"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("cut.mp4") && !errors(&output).contains("panicked"), "{}", errors(&output));
}

#[test]
fn policy_and_settings_from_the_command_line() {
    let place = Place::new();
    let plain = place.boxes("plain", &["video"]);
    assert_eq!(place.boxes("same", &["video", "--policy", "hedge", "--set", "policy.gamma=0.5"]), plain);
    assert_ne!(place.boxes("other", &["video", "--policy", "gp-ucb"]), plain);
    assert_ne!(place.boxes("fewer", &["video", "--set", "particles=30", "--set", "likelihood.sharpness=20"]), plain);
    place.boxes("state", &["video", "--policy", "exp3", "--until", "5", "--save-state", "s.json"]);
    assert!(place.failure(&["video", "--load-state", "s.json"]).contains("policy.kind is \"exp3\" in the state"));
    assert!(
        place.failure(&["video", "--policy", "exp3", "--load-state", "s.json", "--until", "5"]).contains("--until 5")
    );
}

#[test]
fn a_detector_runs_once() {
    let place = Place::new();
    let message = |args: &[&str]| {
        let summary = json(&place.tracked("many", &[&["video", "--json"][..], args].concat()));
        (summary["detector"].as_str().expect("a text").to_owned(), place.read("many/tracks.txt"))
    };
    let detector = ["--set", "detector.kind=motion"];
    let (name, _) = message(&["--init", "50,60,28,28", "--init", "90,90,28,28"]);
    assert_eq!(name, "none, given boxes alone");
    let (name, ours) = message(&["--detect", "motion"]);
    assert_eq!(name, "motion (--detect)");
    let (name, both) = message(&[&["--detect", "motion"][..], &detector].concat());
    assert_eq!(name, "motion (--detect), in the place of the configuration's motion");
    assert_eq!(both, ours, "one detector, not two");
    let (name, _) = message(&[&["--init", "50,60,28,28", "--init", "90,90,28,28"][..], &detector].concat());
    assert_eq!(name, "motion, the configuration's");
    place.write("d.txt", "1,-1,9,9,20,20,1\n");
    let (name, _) = message(&[&["--detections", "d.txt"][..], &detector].concat());
    assert_eq!(name, "d.txt, in the place of the configuration's motion");
    // A box that comes after the last frame is no reason to stop.
    place.write("last.txt", "10,1,9,9,20,20,1\n");
    let (name, _) = message(&[&["--inits", "last.txt", "--until", "8"][..], &detector].concat());
    assert_eq!(name, "motion, the configuration's");
}

#[test]
fn useless_detections_are_reported() {
    let place = Place::new();
    place.write("d.txt", "1,-1,9000,9,20,20,1\n2,-1,9,-90,20,20,1\n99,-1,9,9,20,20,1\n");
    let output = place.tracked("many", &["video", "--detections", "d.txt"]);
    for words in ["d.txt: 2 of its boxes lie outside the", "d.txt: 1 of its boxes lie in frames after frame 10"] {
        assert!(errors(&output).contains(words), "{words}: {}", errors(&output));
    }
}

/// Where ffmpeg is installed: a file that it calls whole, though it was cut, ends with an error, and what came is kept.
#[test]
fn a_cut_matroska_file_is_reported() {
    let place = Place::new();
    need!(foveate_testing::ffmpeg());
    let made = "-v error -f lavfi -i testsrc=size=160x120:rate=25:duration=2 -c:v mpeg4 a.mkv";
    let made = std::process::Command::new("ffmpeg").current_dir(place.path("")).args(made.split(' ')).status();
    assert!(made.is_ok_and(|status| status.success()), "a video is made");
    let bytes = place.read("a.mkv");
    place.write("cut.mkv", &bytes[..bytes.len() / 2]);
    place.tracked("whole", &["a.mkv", "--init", "50,60,28,28"]);
    assert_eq!(place.lines("whole/boxes.txt"), 50);
    let cut = place.track("cut", &["cut.mkv", "--init", "50,60,28,28"]);
    assert_eq!(cut.status.code(), Some(1));
    assert!(errors(&cut).contains("cut.mkv") && errors(&cut).contains("breaks off"), "{}", errors(&cut));
    let lines = place.lines("cut/boxes.txt");
    assert!((5..45).contains(&lines), "{lines} frames were kept");
}

/// A target that nothing keeps in the picture: printed and written boxes are in it, the estimate is in track.csv.
#[test]
fn a_box_outside_the_picture_is_no_result() {
    let place = Place::new();
    let wild = ["--set", "dynamics.damping=1.0", "--set", "dynamics.velocity=9.0", "--set", "particles=5"];
    let args = [&["video", "--init", "50,60,28,28"][..], &wild].concat();
    let said = printed(&place.track("far", &args));
    assert!(said.contains("Last box: outside the picture, as in "), "{said}");
    let summary = json(&place.track("far", &[&args[..], &["--json"]].concat()));
    assert!(summary["bbox"].is_null() && summary["outside_frames"].as_u64() > Some(3), "{summary}");
    let text = place.text("far/boxes.txt");
    for line in text.lines() {
        let [x, y, w, h] = line.split(',').map(|n| n.parse().expect("a number")).collect::<Vec<f64>>()[..] else {
            panic!("{line}");
        };
        // Counted from 1: the picture has the columns 1 to 250 and the rows 1 to 200.
        assert!(x < 251.0 && y < 201.0 && x + w > 1.0 && y + h > 1.0, "{line}");
    }
    let last = place.text("far/track.csv").lines().last().expect("a line").to_owned();
    let left: f64 = last.split(',').nth(2).expect("the left edge").parse().expect("a number");
    let top: f64 = last.split(',').nth(3).expect("the top edge").parse().expect("a number");
    assert!(!(-28.0..250.0).contains(&left) || !(-28.0..200.0).contains(&top), "{left}, {top}");
}

#[test]
fn a_video_in_tiles_is_read_by_regions() {
    let place = Place::new();
    place.done(["tiles", "video", "--out", "tiles", "--side", "16", "--levels", "3"]);
    let mut names = place.names("tiles");
    assert_eq!((names.pop().as_deref(), names.len()), (Some("times.txt"), FRAMES));
    let times = place.text("tiles/times.txt");
    assert_eq!(times.lines().count(), FRAMES);
    for (until, said) in [("0", "0 is not in 1.."), ("99", "--until 99: the video has 10 frames")] {
        place.refuses(["tiles", "video", "--out", "none", "--until", until], said);
    }
    assert!(!place.path("none").exists());
    assert_eq!(place.names("tiles/000001"), ["0", "1", "2"]);
    let truth = place.text("video/groundtruth_rect.txt");
    let first = truth.lines().next().expect("a line").replace('\t', ",");
    place.done(["track", "tiles", "--init", &first, "--config", "foveated", "--no-report", "-o", "o"]);
    assert_eq!(place.names("o"), ["annotated.mp4", "boxes.txt", "run.json", "track.csv"]);
    assert_eq!(&place.read("o/annotated.mp4")[4..8], b"ftyp", "a film of what was read");
    assert_eq!(place.lines("o/boxes.txt"), FRAMES);
    let table = place.text("o/track.csv");
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    let read = rows[0].iter().position(|name| *name == "share_read").expect("a column");
    let shares: Vec<f64> = rows[2..].iter().map(|row| row[read].parse().expect("a number")).collect();
    assert!(shares.iter().all(|share| *share > 0.0 && *share < 1.0), "{shares:?}");
    for (args, words) in [
        (&["--config", "natural"][..], "[sensor]"),
        (&["--config", "foveated", "--scale", "0.3"], "0.5, 0.25"),
        (&["--detect", "walkers"], "not tiles"),
    ] {
        place.refuses([&["track", "tiles", "--init", &first, "-o", "p"][..], args].concat(), words);
    }
    place.refuses(["tiles", "video", "--out", "tiles"], "exists");
    assert!(!place.run(["tiles", "nothing.mp4", "--out", "none"]).status.success());
    assert!(!place.path("none").exists());
}
