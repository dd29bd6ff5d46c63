//! The commands themselves: make a video, score its own truth on it.

use std::process::{Command, Output, Stdio};

use foveate::video::{Frame, Mp4Writer};

fn foveate(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_foveate")).args(args).output().expect("the program starts")
}

/// A noisy video of a digit among digits.
fn scene(out: &str, digit: &str, frames: &str) {
    let made = foveate(&["synth", "clutter", "--digit", digit, "--frames", frames, "--noise", "--out", out]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
}

#[test]
fn the_truth_of_a_made_video_scores_best() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let (video, results, out) = (path("seqs/three"), path("perfect"), path("scores"));
    let made = foveate(&["synth", "clutter", "--digit", "3", "--frames", "12", "--noise", "--out", &video]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert_eq!(std::fs::read_dir(path("seqs/three/img")).expect("images").count(), 12);
    let again = foveate(&["synth", "clutter", "--out", &video]);
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("is there already"));
    // Nor is the film of another scene replaced; and of two sequences none is taken.
    std::fs::write(path("film.mp4"), "mine").expect("written");
    let many = foveate(&["synth", "multi", "--frames", "30", "--out", &video, "--video", &path("film.mp4")]);
    assert!(!many.status.success() && std::fs::read(path("film.mp4")).expect("kept") == b"mine");
    for name in ["two/a", "two/b"] {
        scene(&path(name), "3", "12");
    }
    let hidden = foveate(&["synth", "hide", "--way", "away", "--seq", &path("two"), "--out", &path("hidden")]);
    assert!(String::from_utf8_lossy(&hidden.stderr).contains("it has 2 sequences; give one of them"), "{hidden:?}");

    std::fs::create_dir(&results).expect("a new folder");
    std::fs::copy(path("seqs/three/groundtruth_rect.txt"), path("perfect/three.txt")).expect("copied");
    let seqs = path("seqs");
    let scored = foveate(&["eval", "--seqs", &seqs, "--results", &results, "--out", &out, "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let json: serde_json::Value = serde_json::from_slice(&scored.stdout).expect("JSON alone on the standard output");
    let mean = &json["trackers"][0]["mean"];
    assert!((mean["auc"].as_f64().expect("a number") - 20.0 / 21.0).abs() < 1e-12, "{mean}"); // 1 is not above 1
    assert_eq!(
        (mean["p20"].as_f64(), mean["failures"].as_u64(), mean["frames"].as_u64()),
        (Some(1.0), Some(0), Some(12))
    );
    for file in ["table.txt", "scores.json", "curves.svg"] {
        assert!(dir.path().join("scores").join(file).is_file(), "{file}");
    }
    let none = foveate(&["eval", "--seqs", &results, "--results", &results, "--out", &out]);
    assert!(!none.status.success() && String::from_utf8_lossy(&none.stderr).contains("no sequence here"));
    // The error for an invalid first box names its file and line.
    std::fs::write(path("seqs/three/groundtruth_rect.txt"), "7,8,1,1\n".repeat(12)).expect("written");
    let wrong = foveate(&["eval", "--seqs", &path("seqs"), "--config", "digits", "--out", &path("wrong")]);
    let said = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(
        !wrong.status.success() && said.contains("three/groundtruth_rect.txt: the first box is x=7, y=8"),
        "{said}"
    );
}

/// No control character of a name reaches the terminal or a file that people open.
#[cfg(unix)]
#[test]
fn names_are_shown_escaped() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let (sequence, results) = ("seqs/a\u{1b}[31m\nroot", "other\u{1b}]0;x\u{7}\nroot");
    scene(&path(sequence), "3", "4");
    std::fs::create_dir(path(results)).expect("a new folder");
    let boxes = std::fs::read(path(&format!("{sequence}/groundtruth_rect.txt"))).expect("its truth");
    std::fs::write(path(&format!("{results}/a\u{1b}[31m\nroot.txt")), boxes).expect("written");
    let eval = foveate(&[
        "eval",
        "--seqs",
        &path("seqs"),
        "--peers",
        &path(results),
        "--config",
        "digits",
        "--out",
        &path("e"),
    ]);
    assert!(eval.status.success(), "{}", String::from_utf8_lossy(&eval.stderr));
    let track = foveate(&["track", &path("seqs/none\u{1b}\nroot"), "--out", &path("t")]);
    let mut texts = [eval.stdout, eval.stderr, track.stderr].map(|text| ("terminal".to_owned(), text)).to_vec();
    for entry in std::fs::read_dir(path("e")).expect("a folder").flatten().filter(|entry| entry.path().is_file()) {
        let name = entry.file_name().to_string_lossy().into_owned();
        texts.push((name, std::fs::read(entry.path()).expect("a file")));
    }
    assert!(["table.txt", "curves.svg", "report.html"].iter().all(|name| texts.iter().any(|(found, _)| found == name)));
    for (name, bytes) in texts {
        let text = String::from_utf8_lossy(&bytes);
        let raw = text.chars().find(|c| c.is_control() && !['\n', '\t'].contains(c));
        assert!(raw.is_none(), "{name}: {raw:?}");
        // A page shows a line feed as a space.
        let forged = text.lines().any(|line| line.starts_with("root")) && name != "report.html";
        assert!(!forged, "{name}: {text}");
    }
}

/// Boxes without a picture are an error before any sequence is tracked; pictures without a box are a warning.
#[test]
fn boxes_and_pictures_are_counted_first() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    scene(&path("seqs/Bolt"), "3", "6");
    scene(&path("seqs/Coke"), "3", "6");
    let truth = std::fs::read_to_string(path("seqs/Coke/groundtruth_rect.txt")).expect("the truth");
    let eval = |more: &[&str], truth: &str| {
        std::fs::write(path("seqs/Coke/groundtruth_rect.txt"), truth).expect("written");
        foveate(&[&["eval", "--seqs", &path("seqs"), "--config", "digits", "--out", &path("out")], more].concat())
    };
    let longer = truth.clone() + "1,1,28,28\n";
    for more in [&[][..], &["--side-by-side"], &["--choose", "particles=20,30"]] {
        let refused = eval(more, &longer);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(
            !refused.status.success() && said.contains("Coke/groundtruth_rect.txt: 7 boxes for 6 pictures in"),
            "{said}"
        );
        assert!(!said.contains("Bolt (seed 1)") && !dir.path().join("out").exists(), "{said}");
    }
    let shorter: String = truth.split_inclusive('\n').take(4).collect();
    let done = eval(&[], &shorter);
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success() && said.contains("4 boxes for 6 pictures in"), "{said}");
    assert!(said.contains("Coke (seed 1)") && said.contains("of 4 frames"), "{said}");
}

/// As `foveate synth | head` with a reader that has gone.
#[test]
fn output_without_a_reader_is_no_error() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let video = dir.path().join("video").to_string_lossy().into_owned();
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.args(["synth", "clutter", "--frames", "3", "--out", &video]).stdout(writer).stderr(Stdio::piped());
    let output = command.output().expect("the program starts");
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(dir.path().join("video/groundtruth_rect.txt").is_file());
}

#[test]
fn many_targets_are_scored_from_their_files() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    std::fs::create_dir_all(path("street/gt")).expect("a new folder");
    std::fs::write(path("street/gt/gt.txt"), "1,1,5,5,20,40,1,-1,-1,-1\n2,1,6,5,20,40,1,-1,-1,-1\n").expect("written");
    std::fs::write(path("found.txt"), "1,3,5,5,20,40,0.9\n2,4,6,5,20,40,0.9\n").expect("written");
    let (truth, results, out) = (path("street"), path("found.txt"), path("scores"));
    let scored = foveate(&["eval", "--mot", "--truth", &truth, "--results", &results, "--out", &out, "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let json: serde_json::Value = serde_json::from_slice(&scored.stdout).expect("JSON alone on the standard output");
    let pooled = &json["trackers"][0]["pooled"];
    // Two boxes, found under two names: one switch, half of the identity.
    assert_eq!(
        (pooled["mota"].as_f64(), pooled["idf1"].as_f64(), pooled["switches"].as_u64()),
        (Some(0.5), Some(0.5), Some(1))
    );
    let table = std::fs::read_to_string(path("scores/table.txt")).expect("a table");
    assert!(table.starts_with("found\n") && table.contains("street"), "{table}");

    std::fs::write(path("found.txt"), "1,3,5,5\n").expect("written");
    let damaged = foveate(&["eval", "--mot", "--truth", &truth, "--results", &results, "--out", &out]);
    let said = String::from_utf8_lossy(&damaged.stderr).into_owned();
    assert!(!damaged.status.success() && said.contains("found.txt: line 1: expected frame,id,x,y,w,h"), "{said}");
    assert!(!foveate(&["eval", "--mot", "--truth", &truth]).status.success(), "results are needed");
    assert!(!foveate(&["eval", "--truth", &truth, "--seqs", &truth]).status.success(), "--truth goes with --mot");
}

#[test]
fn a_scene_of_many_digits_has_both_layouts() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let (scene, out) = (path("scenes/five"), path("scores"));
    let made = foveate(&[
        "synth",
        "multi",
        "--frames",
        "40",
        "--crossings",
        "0",
        "--out",
        &scene,
        "--video",
        &path("five.mp4"),
    ]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert_eq!(std::fs::read_dir(path("scenes/five/img1")).expect("images").count(), 40);
    assert!(std::fs::metadata(path("five.mp4")).expect("a video").len() > 1000);
    // Its truth is a perfect result in MOTChallenge's layout, and five sequences in OTB's.
    std::fs::copy(path("scenes/five/gt/gt.txt"), path("five.txt")).expect("copied");
    let scored =
        foveate(&["eval", "--mot", "--truth", &scene, "--results", &path("five.txt"), "--out", &out, "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let json: serde_json::Value = serde_json::from_slice(&scored.stdout).expect("JSON alone on the standard output");
    assert_eq!(
        (json["trackers"][0]["pooled"]["mota"].as_f64(), json["trackers"][0]["pooled"]["truth_ids"].as_u64()),
        (Some(1.0), Some(5))
    );
    let run = foveate(&["eval", "--seqs", &scene, "--config", "digits-multi", "--out", &out, "--json"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let json: serde_json::Value = serde_json::from_slice(&run.stdout).expect("JSON alone on the standard output");
    assert_eq!(json["trackers"][0]["mean"]["frames"].as_u64(), Some(200), "five targets of 40 frames");
    let page = std::fs::read_to_string(path("scores/report.html")).expect("a report");
    assert!(page.matches("class=\"case\"").count() == 5 && page.contains("five-2"), "a section for each target");

    // Beside others, all of them named at once; the second has one target only.
    for (tracker, targets) in [("still", &["five", "five-2"][..]), ("short", &["five"])] {
        std::fs::create_dir_all(path(&format!("peers/{tracker}"))).expect("a new folder");
        for target in targets {
            std::fs::write(path(&format!("peers/{tracker}/{target}.txt")), "1,1,50,50\n".repeat(40)).expect("written");
        }
    }
    let (peers, seen) = (path("peers"), path("beside"));
    let args =
        ["eval", "--seqs", &scene, "--config", "digits-multi", "--peers", &peers, "--out", &seen, "--seeds", "2"];
    let run = foveate(&args);
    let table = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(table.contains("foveate against") && table.contains("short has no result for five-2"), "{table}");
    let again = foveate(&["eval", "--seqs", &scene, "--results", &(seen.clone() + "/foveate"), &peers, "--out", &out]);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    for file in ["curves.svg", "table.txt"] {
        let read = |folder: &str| std::fs::read(format!("{folder}/{file}")).expect("written");
        assert_eq!(read(&seen), read(&out), "{file}: what was run is scored as its files are");
    }
    // Earlier scores are gone: they were of another tracker.
    let mut left: Vec<_> = std::fs::read_dir(&out).expect("a folder").flatten().map(|e| e.file_name()).collect();
    left.sort();
    assert_eq!(left, ["curves.svg", "run.json", "scores.json", "table.txt"]);
    let both = foveate(&["eval", "--seqs", &scene, "--results", &peers, "--peers", &peers, "--out", &out]);
    assert!(!both.status.success() && String::from_utf8_lossy(&both.stderr).contains("cannot be used with"));

    let wrong = foveate(&["synth", "multi", "--scale", "3", "--out", &path("none")]);
    assert!(!wrong.status.success() && String::from_utf8_lossy(&wrong.stderr).contains("two numbers such as 1,3"));
}

/// Two videos, listed by half: each is followed with what `{other}` makes of the configuration, as it is alone.
#[test]
fn each_half_has_what_the_other_half_made() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    scene(&path("scene"), "3", "6");
    let mut film: Option<Mp4Writer> = None;
    for frame in foveate::video::open(path("scene/img")).expect("pictures") {
        let Frame { index, image, .. } = frame.expect("a picture");
        let new = || Mp4Writer::create(path("film.mp4"), image.width(), image.height(), 30.0).expect("a film");
        film.get_or_insert_with(new).push(&image, index as f64 / 30.0).expect("written");
    }
    film.expect("frames").finish().expect("written");
    for name in ["one", "two"] {
        std::fs::create_dir_all(path(&format!("seqs/{name}"))).expect("a new folder");
        let [film, truth] = ["video.mp4", "groundtruth_rect.txt"].map(|file| path(&format!("seqs/{name}/{file}")));
        std::fs::copy(path("film.mp4"), film).expect("copied");
        std::fs::copy(path("scene/groundtruth_rect.txt"), truth).expect("copied");
    }
    std::fs::write(path("seqs/halves.txt"), "a one digit first\nb two digit second\n").expect("written");
    let config = foveate::config::Config::builtin("digits").expect("it ships").expect("it is right");
    for (name, set) in [("a", "particles=30"), ("b", "particles=60")] {
        let text = config.set(set).expect("fewer particles").to_toml();
        std::fs::write(path(&format!("{name}.toml")), text).expect("written");
    }
    let eval = |config: &str, more: &[&str], out: &str| {
        let (config, seqs, out) = (path(config), path("seqs"), path(out));
        foveate(&[&["eval", "--seqs", &seqs, "--config", &config, "--out", &out], more].concat())
    };
    let both = eval("{other}.toml", &[], "both");
    assert!(both.status.success(), "{}", String::from_utf8_lossy(&both.stderr));
    let said = String::from_utf8_lossy(&both.stdout).into_owned();
    assert!(said.contains("kind digit") && said.matches("half b").count() == 2, "{said}");
    for (half, config, name) in [("a", "b.toml", "one"), ("b", "a.toml", "two")] {
        let alone = eval(config, &["--half", half], "alone");
        assert!(alone.status.success(), "{}", String::from_utf8_lossy(&alone.stderr));
        let read = |out: &str| std::fs::read(path(&format!("{out}/foveate/{name}.txt"))).expect("a track");
        assert_eq!(read("both"), read("alone"));
        assert_eq!(std::fs::read_dir(path("alone/foveate")).expect("tracks").count(), 3, "boxes, times, values");
    }
    let refused = eval("{other}.toml", &["--choose", "particles=20,30"], "none");
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("takes no {other}"));
}

/// The same grid twice: the second time nothing is run, and all figures are the same. The choice evaluated on a half was made on the
/// other: from the figures by half, the choice can be made again by hand.
#[test]
fn settings_are_chosen_on_one_half_and_judged_on_the_other() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    // By the list Coke is of half a, Couple of half b.
    [("Coke", "3"), ("Couple", "7")]
        .into_iter()
        .for_each(|(name, digit)| scene(&path(&format!("seqs/{name}")), digit, "15"));
    let (seqs, out, one) = (path("seqs"), path("out"), path("seqs/Coke"));
    let args = ["eval", "--seqs", &seqs, "--config", "digits", "--out", &out, "--seeds", "2", "--choose"];
    let with = |choose: &[&str]| foveate(&[&args[..], choose].concat());
    let said = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    for (wrong, why) in [
        (&["particles=20"][..], "makes 1 candidate:"),
        (&["particles=20,0"], "particles"),
        (&["particles=20,30", "--results", &seqs], "cannot be used with"),
        (&["particles=20,30", "--peers", &seqs], "no result here"),
    ] {
        let refused = with(wrong);
        assert!(!refused.status.success() && said(&refused).contains(why), "{wrong:?}: {}", said(&refused));
    }
    let half = foveate(&["eval", "--seqs", &one, "--config", "digits", "--out", &out, "--choose", "particles=20,30"]);
    assert!(said(&half).contains("none of these is in half b: Coke"), "{}", said(&half));
    assert!(!dir.path().join("out").exists(), "nothing is written before all is checked");

    let grid = ["particles=5,300", "--choose", "likelihood.sharpness=1,40"];
    let first = with(&grid);
    assert!(first.status.success() && said(&first).contains("16 runs, 0 of them"), "{}", said(&first));
    let read = |name: &str| std::fs::read(path(&format!("out/{name}"))).expect(name);
    let files = ["cross.json", "cross.txt", "candidates/particles=5_likelihood.sharpness=1/seed-2/Coke.txt"];
    let before = files.map(read);
    let again = with(&grid);
    assert!(said(&again).contains("16 runs, 16 of them"), "{}", said(&again));
    assert_eq!(files.map(read), before);

    let cross: serde_json::Value = serde_json::from_slice(&before[0]).expect("JSON");
    assert_eq!((&cross["configuration"], &cross["seeds"][1]), (&"digits".into(), &2.into()));
    let candidates = cross["candidates"].as_array().expect("a list");
    assert_eq!(candidates.len(), 4);
    let auc = |i: usize, on: &str| candidates[i][on]["auc"].as_f64().expect("a number");
    let best = |on: &str| (0..4).fold(0, |best, i| if auc(i, on) > auc(best, on) { i } else { best });
    let expected = 0.5 * (auc(best("b"), "a") + auc(best("a"), "b"));
    let judged = cross["halves"]["mean"]["auc"].as_f64().expect("a number");
    assert!((judged - expected).abs() < 1e-12, "{judged}, not {expected}");
    // Two sources, each a half: leaving one out is the same.
    assert_eq!(cross["halves"]["mean"], cross["sources"]["mean"]);
    // The tracks that are scored as cross-validated are those of the chosen candidates.
    let scores: serde_json::Value = serde_json::from_slice(&read("scores.json")).expect("JSON");
    let mean = scores["trackers"][0]["mean"]["auc"].as_f64().expect("a number");
    assert!((mean - expected).abs() < 1e-12, "{mean}, not {expected}");
    assert_eq!((&scores["sources"][0]["half"], &scores["sources"][1]["half"]), (&"a".into(), &"b".into()));
    let printed = String::from_utf8_lossy(&first.stdout).into_owned();
    assert!(printed.starts_with("Chosen by mean AUC.") && printed.contains("occlusion"), "{printed}");
}

/// Parts in folders of their own, put together, are the run in one: all figures but the times.
#[test]
fn parts_of_an_evaluation_are_put_together() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    [("Coke", "3"), ("Couple", "7")]
        .into_iter()
        .for_each(|(name, digit)| scene(&path(&format!("seqs/{name}")), digit, "15"));
    let (seqs, read) = (path("seqs"), |name: &str| std::fs::read(path(name)).expect(name));
    let with = |out: &str, more: &[&str]| {
        let args = ["eval", "--seqs", &seqs, "--config", "digits", "--set", "particles=50", "--seeds", "3", "--out"];
        let output = foveate(&[&args[..], &[&path(out)], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let without_times = |out: &str| {
        let mut scores: serde_json::Value = serde_json::from_slice(&read(&format!("{out}/scores.json"))).expect("JSON");
        assert!(scores["run"]["command"].take().is_string());
        let tracker = &mut scores["trackers"][0];
        assert!(tracker["mean"]["fps"].take().is_number());
        tracker["sequences"].as_array_mut().expect("rows").iter_mut().for_each(|row| row["fps"] = 0.into());
        let files = ["foveate/seed-2/Coke.txt", "confidence.json", "reliability.svg"];
        (scores, files.map(|name| read(&format!("{out}/{name}"))))
    };
    for choose in [&[][..], &["--choose", "likelihood.sharpness=1,40"]] {
        let name = |part: &str| format!("{part}-{}", choose.len());
        let runs = |out: &str| std::fs::read_dir(path(&format!("{out}/runs"))).map_or(0, Iterator::count);
        with(&name("whole"), choose);
        if choose.is_empty() {
            assert_eq!(runs(&name("whole")), 0, "a finished evaluation begins anew");
            let message = with(&name("side"), &["--side-by-side", "--threads", "2"]);
            assert!(message.contains("6 runs, 0 of them from") && runs(&name("side")) == 0, "{message}");
            assert_eq!(without_times(&name("side")), without_times(&name("whole")));
        }
        for part in ["1/2", "2/2"] {
            let out = name(&part[..1]);
            with(&out, &[choose, &["--shard", part]].concat());
            assert!(!dir.path().join(&out).join("scores.json").exists(), "a part has no scores");
        }
        let (first, second, all) = (path(&name("1")), path(&name("2")), if choose.is_empty() { 6 } else { 12 });
        assert_eq!(runs(&name("1")) + runs(&name("2")), all);
        let merge = [choose, &["--merge", &first, "--merge", &second, "--threads", "1"]].concat();
        let message = with(&name("merged"), &merge);
        assert!(message.contains(&format!("{all} runs, {all} of them from")), "{message}");
        if choose.is_empty() {
            assert_eq!(without_times(&name("merged")), without_times(&name("whole")));
            // Missing runs are done, also in the folder of a part.
            let message = with(&name("1"), &["--merge", &first]);
            assert!(message.contains(&format!("6 runs, {} of them from", 6 - runs(&name("2")))), "{message}");
            assert_eq!(without_times(&name("1")), without_times(&name("whole")));
        } else {
            for file in ["cross.json", "cross.txt"] {
                assert_eq!(read(&format!("{}/{file}", name("merged"))), read(&format!("{}/{file}", name("whole"))));
            }
        }
    }
    for (wrong, said) in [
        (&["--shard", "3/2"][..], "1/4"),
        (&["--merge", "nowhere"], "no finished runs here"),
        (&["--shard", "1/2", "--results", &seqs], "cannot be used with"),
    ] {
        let refused = foveate(&[&["eval", "--seqs", &seqs, "--out", &path("wrong")], wrong].concat());
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && message.contains(said), "{wrong:?}: {message}");
    }
    assert!(!dir.path().join("wrong").exists());
}

/// Two folders of results can be distinguished by run and data.
#[test]
fn an_evaluation_records_what_was_run() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    scene(&path("seqs/Coke"), "3", "8");
    let (seqs, out) = (path("seqs"), path("out"));
    let run = |more: &[&str]| {
        let output = foveate(&[&["eval", "--seqs", &seqs, "--config", "digits", "--out", &out][..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let read = |name: &str| std::fs::read_to_string(path(name)).expect(name);
        let scores: serde_json::Value = serde_json::from_str(&read("out/scores.json")).expect("JSON");
        (scores["run"].clone(), read("out/report.html"))
    };
    let (first, page) = run(&["--set", "particles=50", "--policy", "random", "--seed", "4", "--seeds", "2"]);
    let ran = &first["tracker"];
    assert_eq!(first["program"], concat!("foveate ", env!("CARGO_PKG_VERSION")));
    assert!(first["command"].as_str().expect("text").contains("eval --seqs") && first["build"].is_string());
    assert_eq!(
        (&ran["configuration"], &ran["policy"], &ran["seeds"]),
        (&"digits, policy random, particles=50".into(), &"random".into(), &serde_json::json!([4, 5]))
    );
    assert!(ran["retina"].as_str().expect("text").contains('/'), "{ran}");
    let config = ran["text"].as_str().expect("text");
    assert!(config.contains("particles = 50") && config.contains("kind = \"random\""), "{config}");
    let data = &first["data"][0];
    assert_eq!(data["sequence"], "Coke");
    for (what, text) in [("Gaze policy", "random"), ("Seeds", "4, 5")] {
        assert!(page.contains(&format!("<dt>{what}</dt><dd>{text}</dd>")), "{what}");
    }
    for text in ["What was run", "particles = 50", data["boxes"].as_str().expect("text"), "--policy random"] {
        assert!(page.contains(text), "{text}");
    }

    // One pixel less, the file as long as before; then a true box that is not the first.
    let picture = path("seqs/Coke/img/0005.png");
    let mut bytes = std::fs::read(&picture).expect("a picture");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(path("seqs/Coke/img/0009.png"), bytes).expect("written");
    let (second, _) = run(&["--set", "particles=50"]);
    assert_eq!(second["data"][0]["boxes"], data["boxes"]);
    assert_ne!(second["data"][0]["pictures"], data["pictures"]);
    assert_ne!(second["tracker"]["text"], ran["text"]);
    std::fs::rename(path("seqs/Coke/img/0009.png"), path("seqs/Coke/img/0008.png")).expect("renamed");
    let truth = path("seqs/Coke/groundtruth_rect.txt");
    let mut boxes: Vec<String> =
        std::fs::read_to_string(&truth).expect("the truth").lines().map(str::to_owned).collect();
    boxes[3] = "1,1,20,20".into();
    std::fs::write(&truth, boxes.join("\n")).expect("written");
    let scored =
        foveate(&["eval", "--seqs", &seqs, "--results", &path("out/foveate"), "--out", &path("again"), "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let json: serde_json::Value = serde_json::from_slice(&scored.stdout).expect("JSON");
    let third = &json["run"];
    assert!(third["tracker"].is_null() && third["data"][0]["pictures"].is_null(), "{third}");
    assert_ne!(third["data"][0]["boxes"], data["boxes"]);
    assert!(third["results"][0].as_str().expect("a folder").ends_with("foveate"));
}

/// Finished runs are continued by the same settings alone, here and where they are taken from.
#[test]
fn runs_of_other_settings_are_refused() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    scene(&path("seqs/Coke"), "3", "8");
    let seqs = path("seqs");
    let run = |out: &str, more: &[&str]| {
        foveate(&[&["eval", "--seqs", &seqs, "--config", "digits", "--seeds", "2", "--out", &path(out)], more].concat())
    };
    let part = ["--shard", "1/2", "--set", "particles=50"];
    assert!(run("part", &part).status.success());
    assert!(run("part", &part).status.success(), "the same command continues");
    let first = path("part");
    for (out, args) in [
        ("part", &["--set", "particles=60"][..]),
        ("part", &["--set", "particles=60", "--shard", "2/2"]),
        ("whole", &["--set", "particles=60", "--merge", &first]),
    ] {
        let refused = run(out, args);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        let expected = "made with another configuration (particles = 50; this command has particles = 60)";
        assert!(!refused.status.success() && said.contains(expected) && said.contains("another --out"), "{said}");
    }
    assert!(!dir.path().join("whole").exists());
    assert!(run("whole", &["--set", "particles=50", "--merge", &first]).status.success());
    // A finished evaluation leaves nothing to continue: the next one may have other settings.
    assert!(run("next", &["--set", "particles=50"]).status.success());
    assert!(run("next", &["--set", "particles=60"]).status.success());
}

/// After a signal, an evaluation ends after its current run, and the same command continues from there.
#[cfg(unix)]
#[test]
fn a_stopped_evaluation_goes_on() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    scene(&path("seqs/Coke"), "3", "40");
    let args = ["eval", "--seqs", &path("seqs"), "--config", "digits", "--seeds", "8", "--out", &path("stopped")];
    let runs = || std::fs::read_dir(path("stopped/runs")).map_or(0, |files| files.flatten().count());
    let mut child = Command::new(env!("CARGO_BIN_EXE_foveate"))
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let began = std::time::Instant::now();
    while runs() < 2 {
        assert!(began.elapsed().as_secs() < 60 && child.try_wait().expect("a child").is_none());
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill").success());
    let ended = child.wait_with_output().expect("a child");
    let message = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(143), "{message}");
    assert!(message.contains("the same command continues"), "{message}");
    let kept = runs();
    assert!((2..8).contains(&kept) && !dir.path().join("stopped/scores.json").exists(), "{kept} runs are kept");
    let on = foveate(&args);
    assert!(on.status.success(), "{}", String::from_utf8_lossy(&on.stderr));
    let whole = foveate(&[&args[..8], &[&path("whole")]].concat());
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    for file in ["confidence.json", "foveate/seed-1/Coke.txt", "foveate/seed-8/Coke.txt"] {
        let read = |out: &str| std::fs::read(path(&format!("{out}/{file}"))).expect(file);
        assert_eq!(read("stopped"), read("whole"), "{file}");
    }
    assert_eq!(runs(), 0);
}
