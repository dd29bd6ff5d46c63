//! The commands themselves: make a video, score its own truth on it.

use std::process::{Command, Stdio};

use foveate::video::{Frame, Mp4Writer};

use crate::place::{Place, done, errors, failed, json, printed};

/// A noisy video of a digit among digits.
fn scene(place: &Place, out: &str, digit: &str, frames: &str) {
    place.done(["synth", "clutter", "--digit", digit, "--frames", frames, "--noise", "--out", out]);
}

#[test]
fn the_truth_of_a_made_video_scores_best() {
    let place = Place::empty();
    scene(&place, "seqs/three", "3", "12");
    assert_eq!(place.names("seqs/three/img").len(), 12);
    place.refuses(["synth", "clutter", "--out", "seqs/three"], "is there already");
    // Nor is the film of another scene replaced; and of two sequences none is taken.
    place.write("film.mp4", "mine");
    let many = place.run(["synth", "multi", "--frames", "30", "--out", "seqs/three", "--video", "film.mp4"]);
    assert!(!many.status.success() && place.read("film.mp4") == b"mine");
    ["two/a", "two/b"].into_iter().for_each(|name| scene(&place, name, "3", "12"));
    let hide = ["synth", "hide", "--way", "away", "--seq", "two", "--out", "hidden"];
    place.refuses(hide, "it has 2 sequences; give one of them");

    place.write("perfect/three.txt", place.read("seqs/three/groundtruth_rect.txt"));
    let json = json(&place.done(["eval", "--seqs", "seqs", "--results", "perfect", "--out", "scores", "--json"]));
    let mean = &json["trackers"][0]["mean"];
    assert!((mean["auc"].as_f64().expect("a number") - 20.0 / 21.0).abs() < 1e-12, "{mean}"); // 1 is not above 1
    assert_eq!(
        (mean["p20"].as_f64(), mean["failures"].as_u64(), mean["frames"].as_u64()),
        (Some(1.0), Some(0), Some(12))
    );
    for file in ["table.txt", "scores.json", "curves.svg"] {
        assert!(place.path("scores").join(file).is_file(), "{file}");
    }
    place.refuses(["eval", "--seqs", "perfect", "--results", "perfect", "--out", "scores"], "no sequence here");
    // The error for an invalid first box names its file and line.
    place.write("seqs/three/groundtruth_rect.txt", "7,8,1,1\n".repeat(12));
    let wrong = ["eval", "--seqs", "seqs", "--config", "digits", "--out", "wrong"];
    place.refuses(wrong, "three/groundtruth_rect.txt: the first box is x=7, y=8");
}

/// No control character of a name reaches the terminal or a file that people open.
#[cfg(unix)]
#[test]
fn names_are_shown_escaped() {
    let place = Place::empty();
    let (sequence, results) = ("seqs/a\u{1b}[31m\nroot", "other\u{1b}]0;x\u{7}\nroot");
    scene(&place, sequence, "3", "4");
    let boxes = place.read(&format!("{sequence}/groundtruth_rect.txt"));
    place.write(&format!("{results}/a\u{1b}[31m\nroot.txt"), boxes);
    let eval = place.done(["eval", "--seqs", "seqs", "--peers", results, "--config", "digits", "--out", "e"]);
    let track = place.run(["track", "seqs/none\u{1b}\nroot", "--out", "t"]);
    let mut texts = [eval.stdout, eval.stderr, track.stderr].map(|text| ("terminal".to_owned(), text)).to_vec();
    for entry in std::fs::read_dir(place.path("e")).expect("a folder").flatten().filter(|entry| entry.path().is_file())
    {
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
    let place = Place::empty();
    scene(&place, "seqs/Bolt", "3", "6");
    scene(&place, "seqs/Coke", "3", "6");
    let truth = place.text("seqs/Coke/groundtruth_rect.txt");
    let eval = |more: &[&str], truth: &str| {
        place.write("seqs/Coke/groundtruth_rect.txt", truth);
        place.run([&["eval", "--seqs", "seqs", "--config", "digits", "--out", "out"], more].concat())
    };
    let longer = truth.clone() + "1,1,28,28\n";
    for more in [&[][..], &["--side-by-side"], &["--choose", "particles=20,30"]] {
        let said = failed(&eval(more, &longer));
        assert!(said.contains("Coke/groundtruth_rect.txt: 7 boxes for 6 pictures in"), "{said}");
        assert!(!said.contains("Bolt (seed 1)") && !place.path("out").exists(), "{said}");
    }
    let shorter: String = truth.split_inclusive('\n').take(4).collect();
    let run = eval(&[], &shorter);
    let said = errors(&run);
    assert!(run.status.success() && said.contains("4 boxes for 6 pictures in"), "{said}");
    assert!(said.contains("Coke (seed 1)") && said.contains("of 4 frames"), "{said}");
}

/// As `foveate synth | head` with a reader that has gone.
#[test]
fn output_without_a_reader_is_no_error() {
    let place = Place::empty();
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = place.command(["synth", "clutter", "--frames", "3", "--out", "video"]);
    let output = done(command.stdout(writer).stderr(Stdio::piped()));
    assert!(output.stderr.is_empty(), "{}", errors(&output));
    assert!(place.path("video/groundtruth_rect.txt").is_file());
}

#[test]
fn many_targets_are_scored_from_their_files() {
    let place = Place::empty();
    place.write("street/gt/gt.txt", "1,1,5,5,20,40,1,-1,-1,-1\n2,1,6,5,20,40,1,-1,-1,-1\n");
    place.write("found.txt", "1,3,5,5,20,40,0.9\n2,4,6,5,20,40,0.9\n");
    let eval = ["eval", "--mot", "--truth", "street", "--results", "found.txt", "--out", "scores", "--json"];
    let json = json(&place.done(eval));
    let pooled = &json["trackers"][0]["pooled"];
    // Two boxes, found under two names: one switch, half of the identity.
    assert_eq!(
        (pooled["mota"].as_f64(), pooled["idf1"].as_f64(), pooled["switches"].as_u64()),
        (Some(0.5), Some(0.5), Some(1))
    );
    let table = place.text("scores/table.txt");
    assert!(table.starts_with("found\n") && table.contains("street"), "{table}");

    place.write("found.txt", "1,3,5,5\n");
    place.refuses(&eval[..8], "found.txt: line 1: expected frame,id,x,y,w,h");
    assert!(!place.run(&eval[..4]).status.success(), "results are needed");
    assert!(!place.run("eval --truth street --seqs street".split(' ')).status.success(), "--truth goes with --mot");
}

#[test]
fn a_scene_of_many_digits_has_both_layouts() {
    let place = Place::empty();
    let (scene, out) = ("scenes/five", "scores");
    place.done(["synth", "multi", "--frames", "40", "--crossings", "0", "--out", scene, "--video", "five.mp4"]);
    assert_eq!(place.names("scenes/five/img1").len(), 40);
    assert!(std::fs::metadata(place.path("five.mp4")).expect("a video").len() > 1000);
    // Its truth is a perfect result in MOTChallenge's layout, and five sequences in OTB's.
    std::fs::copy(place.path("scenes/five/gt/gt.txt"), place.path("five.txt")).expect("copied");
    let scored = place.done(["eval", "--mot", "--truth", scene, "--results", "five.txt", "--out", out, "--json"]);
    let pooled = &json(&scored)["trackers"][0]["pooled"];
    assert_eq!((pooled["mota"].as_f64(), pooled["truth_ids"].as_u64()), (Some(1.0), Some(5)));
    let run = place.done(["eval", "--seqs", scene, "--config", "digits-multi", "--out", out, "--json"]);
    assert_eq!(json(&run)["trackers"][0]["mean"]["frames"].as_u64(), Some(200), "five targets of 40 frames");
    let page = place.text("scores/report.html");
    assert!(page.matches("class=\"case\"").count() == 5 && page.contains("five-2"), "a section for each target");

    // Beside others, all of them named at once; the second has one target only.
    for (tracker, targets) in [("still", &["five", "five-2"][..]), ("short", &["five"])] {
        for target in targets {
            place.write(&format!("peers/{tracker}/{target}.txt"), "1,1,50,50\n".repeat(40));
        }
    }
    let args = ["eval", "--seqs", scene, "--config", "digits-multi", "--peers", "peers", "--out", "beside"];
    let table = printed(&place.done([&args[..], &["--seeds", "2"]].concat()));
    assert!(table.contains("foveate against") && table.contains("short has no result for five-2"), "{table}");
    place.done(["eval", "--seqs", scene, "--results", "beside/foveate", "peers", "--out", out]);
    for file in ["curves.svg", "table.txt"] {
        let read = |folder: &str| place.read(&format!("{folder}/{file}"));
        assert_eq!(read("beside"), read(out), "{file}: what was run is scored as its files are");
    }
    // Earlier scores are gone: they were of another tracker.
    assert_eq!(place.names(out), ["curves.svg", "run.json", "scores.json", "table.txt"]);
    let both = ["eval", "--seqs", scene, "--results", "peers", "--peers", "peers", "--out", out];
    place.refuses(both, "cannot be used with");
    place.refuses(["synth", "multi", "--scale", "3", "--out", "none"], "two numbers such as 1,3");
}

/// Two videos, listed by half: each is followed with what `{other}` makes of the configuration, as it is alone.
#[test]
fn each_half_has_what_the_other_half_made() {
    let place = Place::empty();
    scene(&place, "scene", "3", "6");
    let mut film: Option<Mp4Writer> = None;
    for frame in foveate::video::open(place.path("scene/img")).expect("pictures") {
        let Frame { index, image, .. } = frame.expect("a picture");
        let new = || Mp4Writer::create(place.path("film.mp4"), image.width(), image.height(), 30.0).expect("a film");
        film.get_or_insert_with(new).push(&image, index as f64 / 30.0).expect("written");
    }
    film.expect("frames").finish().expect("written");
    for name in ["one", "two"] {
        place.write(&format!("seqs/{name}/video.mp4"), place.read("film.mp4"));
        place.write(&format!("seqs/{name}/groundtruth_rect.txt"), place.read("scene/groundtruth_rect.txt"));
    }
    place.write("seqs/halves.txt", "a one digit first\nb two digit second\n");
    let config = foveate::config::Config::builtin("digits").expect("it ships").expect("it is right");
    for (name, set) in [("a", "particles=30"), ("b", "particles=60")] {
        let text = config.set(set).expect("fewer particles").to_toml();
        place.write(&format!("{name}.toml"), text);
    }
    let eval = |config: &str, more: &[&str], out: &str| {
        place.run([&["eval", "--seqs", "seqs", "--config", config, "--out", out], more].concat())
    };
    let both = eval("{other}.toml", &[], "both");
    assert!(both.status.success(), "{}", errors(&both));
    let said = printed(&both);
    assert!(said.contains("kind digit") && said.matches("half b").count() == 2, "{said}");
    for (half, config, name) in [("a", "b.toml", "one"), ("b", "a.toml", "two")] {
        let alone = eval(config, &["--half", half], "alone");
        assert!(alone.status.success(), "{}", errors(&alone));
        let read = |out: &str| place.read(&format!("{out}/foveate/{name}.txt"));
        assert_eq!(read("both"), read("alone"));
        assert_eq!(std::fs::read_dir(place.path("alone/foveate")).expect("tracks").count(), 3, "boxes, times, values");
    }
    assert!(failed(&eval("{other}.toml", &["--choose", "particles=20,30"], "none")).contains("takes no {other}"));
}

/// The same grid twice: the second time nothing is run, and all figures are the same. The choice evaluated on a half was made on the
/// other: from the figures by half, the choice can be made again by hand.
#[test]
fn settings_are_chosen_on_one_half_and_judged_on_the_other() {
    let place = Place::empty();
    // By the list Coke is of half a, Couple of half b.
    [("seqs/Coke", "3"), ("seqs/Couple", "7")].into_iter().for_each(|(name, digit)| scene(&place, name, digit, "15"));
    let args = ["eval", "--seqs", "seqs", "--config", "digits", "--out", "out", "--seeds", "2", "--choose"];
    let with = |choose: &[&'static str]| [&args[..], choose].concat();
    for (wrong, why) in [
        (&["particles=20"][..], "makes 1 candidate:"),
        (&["particles=20,0"], "particles"),
        (&["particles=20,30", "--results", "seqs"], "cannot be used with"),
        (&["particles=20,30", "--peers", "seqs"], "no result here"),
    ] {
        place.refuses(with(wrong), why);
    }
    let half = "eval --seqs seqs/Coke --config digits --out out --choose particles=20,30";
    place.refuses(half.split(' '), "none of these is in half b: Coke");
    assert!(!place.path("out").exists(), "nothing is written before all is checked");

    let grid = ["particles=5,300", "--choose", "likelihood.sharpness=1,40"];
    let first = place.done(with(&grid));
    assert!(errors(&first).contains("16 runs, 0 of them"), "{}", errors(&first));
    let files = ["cross.json", "cross.txt", "candidates/particles=5_likelihood.sharpness=1/seed-2/Coke.txt"];
    let read = || files.map(|name| place.read(&format!("out/{name}")));
    let before = read();
    let again = errors(&place.done(with(&grid)));
    assert!(again.contains("16 runs, 16 of them"), "{again}");
    assert_eq!(read(), before);

    let cross = place.json("out/cross.json");
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
    let scores = place.json("out/scores.json");
    let mean = scores["trackers"][0]["mean"]["auc"].as_f64().expect("a number");
    assert!((mean - expected).abs() < 1e-12, "{mean}, not {expected}");
    assert_eq!((&scores["sources"][0]["half"], &scores["sources"][1]["half"]), (&"a".into(), &"b".into()));
    let printed = printed(&first);
    assert!(printed.starts_with("Chosen by mean AUC.") && printed.contains("occlusion"), "{printed}");
}

/// Parts in folders of their own, put together, are the run in one: all figures but the times.
#[test]
fn parts_of_an_evaluation_are_put_together() {
    let place = Place::empty();
    [("seqs/Coke", "3"), ("seqs/Couple", "7")].into_iter().for_each(|(name, digit)| scene(&place, name, digit, "15"));
    let with = |out: &str, more: &[&str]| {
        let args = ["eval", "--seqs", "seqs", "--config", "digits", "--set", "particles=50", "--seeds", "3", "--out"];
        errors(&place.done([&args[..], &[out], more].concat()))
    };
    let without_times = |out: &str| {
        let mut scores = place.json(&format!("{out}/scores.json"));
        assert!(scores["run"]["command"].take().is_string());
        let tracker = &mut scores["trackers"][0];
        assert!(tracker["mean"]["fps"].take().is_number());
        tracker["sequences"].as_array_mut().expect("rows").iter_mut().for_each(|row| row["fps"] = 0.into());
        let files = ["foveate/seed-2/Coke.txt", "confidence.json", "reliability.svg"];
        (scores, files.map(|name| place.read(&format!("{out}/{name}"))))
    };
    for choose in [&[][..], &["--choose", "likelihood.sharpness=1,40"]] {
        let name = |part: &str| format!("{part}-{}", choose.len());
        let runs = |out: &str| std::fs::read_dir(place.path(&format!("{out}/runs"))).map_or(0, Iterator::count);
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
            assert!(!place.path(&out).join("scores.json").exists(), "a part has no scores");
        }
        let (first, second, all) = (name("1"), name("2"), if choose.is_empty() { 6 } else { 12 });
        assert_eq!(runs(&first) + runs(&second), all);
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
                let read = |out: &str| place.read(&format!("{}/{file}", name(out)));
                assert_eq!(read("merged"), read("whole"));
            }
        }
    }
    for (wrong, said) in [
        (&["--shard", "3/2"][..], "1/4"),
        (&["--merge", "nowhere"], "no finished runs here"),
        (&["--shard", "1/2", "--results", "seqs"], "cannot be used with"),
    ] {
        place.refuses([&["eval", "--seqs", "seqs", "--out", "wrong"], wrong].concat(), said);
    }
    assert!(!place.path("wrong").exists());
}

/// Two folders of results can be distinguished by run and data.
#[test]
fn an_evaluation_records_what_was_run() {
    let place = Place::empty();
    scene(&place, "seqs/Coke", "3", "8");
    let run = |more: &[&str]| {
        place.done([&["eval", "--seqs", "seqs", "--config", "digits", "--out", "out"][..], more].concat());
        (place.json("out/scores.json")["run"].clone(), place.text("out/report.html"))
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
    let mut bytes = place.read("seqs/Coke/img/0005.png");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    place.write("seqs/Coke/img/0009.png", bytes);
    let (second, _) = run(&["--set", "particles=50"]);
    assert_eq!(second["data"][0]["boxes"], data["boxes"]);
    assert_ne!(second["data"][0]["pictures"], data["pictures"]);
    assert_ne!(second["tracker"]["text"], ran["text"]);
    std::fs::rename(place.path("seqs/Coke/img/0009.png"), place.path("seqs/Coke/img/0008.png")).expect("renamed");
    let truth = place.text("seqs/Coke/groundtruth_rect.txt");
    let mut boxes: Vec<&str> = truth.lines().collect();
    boxes[3] = "1,1,20,20";
    place.write("seqs/Coke/groundtruth_rect.txt", boxes.join("\n"));
    let json = json(&place.done(["eval", "--seqs", "seqs", "--results", "out/foveate", "--out", "again", "--json"]));
    let third = &json["run"];
    assert!(third["tracker"].is_null() && third["data"][0]["pictures"].is_null(), "{third}");
    assert_ne!(third["data"][0]["boxes"], data["boxes"]);
    assert!(third["results"][0].as_str().expect("a folder").ends_with("foveate"));
}

/// Finished runs are continued by the same settings alone, here and where they are taken from.
#[test]
fn runs_of_other_settings_are_refused() {
    let place = Place::empty();
    scene(&place, "seqs/Coke", "3", "8");
    let run = |out: &str, more: &[&str]| {
        place.run([&["eval", "--seqs", "seqs", "--config", "digits", "--seeds", "2", "--out", out], more].concat())
    };
    let part = ["--shard", "1/2", "--set", "particles=50"];
    assert!(run("part", &part).status.success());
    assert!(run("part", &part).status.success(), "the same command continues");
    for (out, args) in [
        ("part", &["--set", "particles=60"][..]),
        ("part", &["--set", "particles=60", "--shard", "2/2"]),
        ("whole", &["--set", "particles=60", "--merge", "part"]),
    ] {
        let said = failed(&run(out, args));
        let expected = "made with another configuration (particles = 50; this command has particles = 60)";
        assert!(said.contains(expected) && said.contains("another --out"), "{said}");
    }
    assert!(!place.path("whole").exists());
    assert!(run("whole", &["--set", "particles=50", "--merge", "part"]).status.success());
    // A finished evaluation leaves nothing to continue: the next one may have other settings.
    assert!(run("next", &["--set", "particles=50"]).status.success());
    assert!(run("next", &["--set", "particles=60"]).status.success());
}

/// After a signal, an evaluation ends after its current run, and the same command continues from there.
#[cfg(unix)]
#[test]
fn a_stopped_evaluation_goes_on() {
    let place = Place::empty();
    scene(&place, "seqs/Coke", "3", "40");
    let args = ["eval", "--seqs", "seqs", "--config", "digits", "--seeds", "8", "--out", "stopped"];
    let runs = || std::fs::read_dir(place.path("stopped/runs")).map_or(0, |files| files.flatten().count());
    let mut command = place.command(args);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts");
    let began = std::time::Instant::now();
    while runs() < 2 {
        assert!(began.elapsed().as_secs() < 60 && child.try_wait().expect("a child").is_none());
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill").success());
    let ended = child.wait_with_output().expect("a child");
    let message = errors(&ended);
    assert_eq!(ended.status.code(), Some(143), "{message}");
    assert!(message.contains("the same command continues"), "{message}");
    let kept = runs();
    assert!((2..8).contains(&kept) && !place.path("stopped/scores.json").exists(), "{kept} runs are kept");
    place.done(args);
    place.done([&args[..8], &["whole"]].concat());
    for file in ["confidence.json", "foveate/seed-1/Coke.txt", "foveate/seed-8/Coke.txt"] {
        let read = |out: &str| std::fs::read(place.path(&format!("{out}/{file}"))).expect(file);
        assert_eq!(read("stopped"), read("whole"), "{file}");
    }
    assert_eq!(runs(), 0);
}
