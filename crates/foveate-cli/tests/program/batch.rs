//! `foveate track` of many videos.

use crate::place::{Place, done, errors, failed, json, printed};

/// Three short videos: one with its truth, one without a box, one damaged.
fn videos(place: &Place) {
    for name in ["a", "b"] {
        place.done(["synth", "clutter", "--frames", "6", "--out", &format!("videos/{name}")]);
    }
    place.write("videos/c/0001.png", "no picture");
    place.write("videos/c/groundtruth_rect.txt", "1,1,9,9\n");
}

#[test]
fn many_videos_have_a_folder_each() {
    let place = Place::new();
    videos(&place);
    let all = ["videos/a", "videos/b", "videos/c"];
    let said = failed(&place.track("runs", &all));
    assert!(said.contains("1 of 3 videos failed"), "{said}");
    // The same as alone.
    let alone = place.boxes("alone", &["videos/b"]);
    assert_eq!(place.read("runs/b/boxes.txt"), alone);
    assert!(place.path("runs/a/run.json").is_file() && !place.path("runs/c").exists());
    let failures = place.text("runs/failures.txt");
    assert!(failures.starts_with("videos/c\t") && failures.contains("0001.png"), "{failures}");
    let page = place.text("runs/index.html");
    assert!(page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'"), "a policy: {page}");
    let at = |name: &str| page.find(&format!(">{name}</")).expect(name);
    assert!(page.contains("href=\"a/") && !page.contains("href=\"c/"), "a link needs a folder: {page}");
    assert!(at("c") < at("a") && at("c") < at("b"), "failures come first: {page}");

    // Again: those that are finished stay, the mended one is made.
    let before = std::fs::metadata(place.path("runs/a/boxes.txt")).and_then(|m| m.modified()).expect("a time");
    std::fs::remove_dir_all(place.path("videos/c")).expect("removed");
    place.done(["synth", "clutter", "--frames", "6", "--seed", "2", "--out", "videos/c"]);
    let said = printed(&place.tracked("runs", &all));
    assert!(said.contains("3 videos: 2 finished before, 1 tracked now, 0 failed."), "{said}");
    let after = std::fs::metadata(place.path("runs/a/boxes.txt")).and_then(|m| m.modified()).expect("a time");
    assert!(after == before && !place.path("runs/failures.txt").exists());
    let list = place.json("runs/runs.json");
    assert_eq!((&list["runs"]["c"]["frames"], &list["runs"]["c"]["error"]), (&6.into(), &serde_json::Value::Null));

    // One that was stopped is made again.
    let list = place.text("runs/a/run.json");
    assert!(list.contains("\"ended\": \"finished\"") && list.contains("\"frames\": 6"), "{list}");
    place.write("runs/a/run.json", list.replace("finished", "stopped"));
    let said = printed(&place.track("runs", &all));
    assert!(said.contains("2 finished before, 1 tracked now") && place.text("runs/a/run.json") == list, "{said}");

    // Other settings do not mix.
    let other = failed(&place.track("runs", &[&all[..], &["--seed", "5"]].concat()));
    assert!(other.contains("give another --out"), "{other}");
}

#[test]
fn what_changed_is_tracked_again_or_refused() {
    let place = Place::new();
    videos(&place);
    let all = ["videos/a", "videos/b"];
    assert!(printed(&place.tracked("runs", &all)).contains("0 finished before, 2 tracked now"));
    // Words that change no result.
    let same = ["track", "--config=c.toml", "--no-report", "--out=./runs/", "--threads", "1", "--no-video"];
    assert!(printed(&place.done([&same[..], &all].concat())).contains("2 finished before"));
    // Another first box.
    place.write("videos/a/groundtruth_rect.txt", "31,32,28,28\n");
    assert!(printed(&place.tracked("runs", &all)).contains("1 finished before, 1 tracked now"));
    assert!(place.text("runs/a/boxes.txt").starts_with("31.000,32.000,28.000,28.000\n"));
    // Another configuration of the same name.
    let config = place.text("c.toml").replace("particles = 60", "particles = 61");
    place.write("c.toml", config);
    let said = failed(&place.track("runs", &all));
    assert!(said.contains("another configuration") && said.contains("another --out"), "{said}");
}

#[test]
fn a_summary_of_all_is_one_document() {
    let place = Place::new();
    videos(&place);
    let run = place.track("runs", &["videos/a", "videos/b", "videos/c", "--json"]);
    assert!(!run.status.success() && errors(&run).contains("3 videos: 0 finished before"), "{}", errors(&run));
    assert_eq!(run.stdout, place.read("runs/runs.json"));
    let message = json(&run);
    assert_eq!((&message["runs"]["a"]["frames"], &message["runs"]["a"]["source"]), (&6.into(), &"videos/a".into()));
    assert!(message["runs"]["c"]["error"].as_str().is_some_and(|error| error.contains("0001.png")), "{message}");
}

/// Where files may have such names.
#[cfg(target_os = "linux")]
#[test]
fn a_name_need_not_be_unicode() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    let name = std::ffi::OsStr::from_bytes(b"v\xff");
    if std::fs::rename(place.path("video"), place.path("").join(name)).is_err() {
        return foveate_testing::skip("file system with names that are not Unicode");
    }
    for options in [&["--init", "50,60,28,28"][..], &["--detect"]] {
        let words = [&["track"], options, &["--no-video", "--no-report", "--json"]].concat();
        done(place.command(&words).arg(name).args(["--out", "one"]));
        let out = std::ffi::OsStr::from_bytes(b"out\xff");
        let into = place.command(&words).args([name, "--out".as_ref(), out]).output().expect("it starts");
        assert!(!errors(&into).contains("panicked"), "{}", errors(&into));
    }
    place.done(["synth", "clutter", "--frames", "6", "--out", "other"]);
    let words = ["track", "-c", "c.toml", "--no-video", "--no-report", "--out", "runs", "other"];
    for said in ["0 finished before, 2 tracked now, 0 failed", "2 finished before"] {
        let run = place.command(&words).arg(name).output().expect("it starts");
        assert!(printed(&run).contains(said), "{said}: {}", errors(&run));
    }
}

#[test]
fn what_means_one_video_is_refused() {
    let place = Place::new();
    videos(&place);
    assert!(place.failure(&["videos/a", "videos/b", "--stream"]).contains("--stream is for one video"));
    assert!(place.failure(&["videos/a", "videos/b", "--reinit", "3:1,1,20,20"]).contains("--reinit is for one video"));
    assert!(place.failure(&["videos/a", "video/../videos/a"]).contains("rename one"));
    assert!(place.failure(&["videos/a", "-"]).contains("track it alone"));
    assert!(place.failure(&["videos/a", "index.html.mp4"]).contains("is a list of all videos; rename the video"));
}

#[test]
fn the_first_box_lies_beside_a_video() {
    let place = Place::new();
    place.done(["synth", "multi", "--frames", "5", "--crossings", "0", "--out", "multi", "--video", "one.mp4"]);
    assert!(place.failure(&["one.mp4"]).contains("no box to start from"));
    place.write("one.txt", "30,30,28,28\n");
    assert_eq!(place.boxes("beside", &["one.mp4"]), place.boxes("given", &["one.mp4", "--init", "30,30,28,28"]));
}
