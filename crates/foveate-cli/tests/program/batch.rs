//! `foveate track` of many videos.

use crate::place::{Place, errors};

/// Three short videos: one with its truth, one without a box, one damaged.
fn videos(place: &Place) {
    for name in ["a", "b"] {
        let made = place.run(&["synth", "clutter", "--frames", "6", "--out", &format!("videos/{name}")]);
        assert!(made.status.success(), "{}", errors(&made));
    }
    std::fs::create_dir(place.path("videos/c")).expect("a new folder");
    std::fs::write(place.path("videos/c/0001.png"), "no picture").expect("written");
    std::fs::write(place.path("videos/c/groundtruth_rect.txt"), "1,1,9,9\n").expect("written");
}

fn text(place: &Place, name: &str) -> String {
    String::from_utf8(place.read(name)).expect("text")
}

#[test]
fn many_videos_have_a_folder_each() {
    let place = Place::new();
    videos(&place);
    let all = ["videos/a", "videos/b", "videos/c"];
    let run = place.track("runs", &all);
    let said = errors(&run);
    assert!(!run.status.success() && said.contains("1 of 3 videos failed") && !said.contains("panicked"), "{said}");
    // The same as alone.
    let alone = place.boxes("alone", &["videos/b"]);
    assert_eq!(place.read("runs/b/boxes.txt"), alone);
    assert!(place.path("runs/a/run.json").is_file() && !place.path("runs/c").exists());
    let failures = text(&place, "runs/failures.txt");
    assert!(failures.starts_with("videos/c\t") && failures.contains("0001.png"), "{failures}");
    let page = text(&place, "runs/index.html");
    assert!(page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'"), "a policy: {page}");
    let at = |name: &str| page.find(&format!(">{name}</")).expect(name);
    assert!(page.contains("href=\"a/") && !page.contains("href=\"c/"), "a link needs a folder: {page}");
    assert!(at("c") < at("a") && at("c") < at("b"), "failures come first: {page}");

    // Again: those that are finished stay, the mended one is made.
    let before = std::fs::metadata(place.path("runs/a/boxes.txt")).and_then(|m| m.modified()).expect("a time");
    std::fs::remove_dir_all(place.path("videos/c")).expect("removed");
    let made = place.run(&["synth", "clutter", "--frames", "6", "--seed", "2", "--out", "videos/c"]);
    assert!(made.status.success(), "{}", errors(&made));
    let run = place.track("runs", &all);
    assert!(run.status.success(), "{}", errors(&run));
    let said = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(said.contains("3 videos: 2 finished before, 1 tracked now, 0 failed."), "{said}");
    let after = std::fs::metadata(place.path("runs/a/boxes.txt")).and_then(|m| m.modified()).expect("a time");
    assert!(after == before && !place.path("runs/failures.txt").exists());
    let list: serde_json::Value = serde_json::from_str(&text(&place, "runs/runs.json")).expect("JSON");
    assert_eq!((&list["runs"]["c"]["frames"], &list["runs"]["c"]["error"]), (&6.into(), &serde_json::Value::Null));

    // One that was stopped is made again.
    let list = text(&place, "runs/a/run.json");
    assert!(list.contains("\"ended\": \"finished\"") && list.contains("\"frames\": 6"), "{list}");
    std::fs::write(place.path("runs/a/run.json"), list.replace("finished", "stopped")).expect("written");
    let said = String::from_utf8_lossy(&place.track("runs", &all).stdout).into_owned();
    assert!(said.contains("2 finished before, 1 tracked now") && text(&place, "runs/a/run.json") == list, "{said}");

    // Other settings do not mix.
    let other = place.track("runs", &[&all[..], &["--seed", "5"]].concat());
    assert!(!other.status.success() && errors(&other).contains("give another --out"), "{}", errors(&other));
}

#[test]
fn what_changed_is_tracked_again_or_refused() {
    let place = Place::new();
    videos(&place);
    let all = ["videos/a", "videos/b"];
    let said = |run: &std::process::Output| {
        assert!(run.status.success(), "{}", errors(run));
        String::from_utf8_lossy(&run.stdout).into_owned()
    };
    assert!(said(&place.track("runs", &all)).contains("0 finished before, 2 tracked now"));
    // Words that change no result.
    let same = ["track", "--config=c.toml", "--no-report", "--out=./runs/", "--threads", "1", "--no-video"];
    assert!(said(&place.run(&[&same[..], &all].concat())).contains("2 finished before"));
    // Another first box.
    std::fs::write(place.path("videos/a/groundtruth_rect.txt"), "31,32,28,28\n").expect("written");
    assert!(said(&place.track("runs", &all)).contains("1 finished before, 1 tracked now"));
    assert!(text(&place, "runs/a/boxes.txt").starts_with("31.000,32.000,28.000,28.000\n"));
    // Another configuration of the same name.
    let config = text(&place, "c.toml").replace("particles = 60", "particles = 61");
    std::fs::write(place.path("c.toml"), config).expect("written");
    let refused = place.track("runs", &all);
    let said = errors(&refused);
    assert!(
        !refused.status.success() && said.contains("another configuration") && said.contains("another --out"),
        "{said}"
    );
}

#[test]
fn a_summary_of_all_is_one_document() {
    let place = Place::new();
    videos(&place);
    let run = place.track("runs", &["videos/a", "videos/b", "videos/c", "--json"]);
    assert!(!run.status.success() && errors(&run).contains("3 videos: 0 finished before"), "{}", errors(&run));
    assert_eq!(run.stdout, place.read("runs/runs.json"));
    let message: serde_json::Value = serde_json::from_slice(&run.stdout).expect("one document");
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
        let alone = place.command(&words).arg(name).arg("--out").arg("one").output().expect("it starts");
        assert!(alone.status.success(), "{}", errors(&alone));
        let into = place
            .command(&words)
            .arg(name)
            .arg("--out")
            .arg(std::ffi::OsStr::from_bytes(b"out\xff"))
            .output()
            .expect("it starts");
        assert!(!errors(&into).contains("panicked"), "{}", errors(&into));
    }
    let made = place.run(&["synth", "clutter", "--frames", "6", "--out", "other"]);
    assert!(made.status.success(), "{}", errors(&made));
    let words = ["track", "-c", "c.toml", "--no-video", "--no-report", "--out", "runs", "other"];
    for said in ["0 finished before, 2 tracked now, 0 failed", "2 finished before"] {
        let run = place.command(&words).arg(name).output().expect("it starts");
        assert!(String::from_utf8_lossy(&run.stdout).contains(said), "{said}: {}", errors(&run));
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
    let made =
        place.run(&["synth", "multi", "--frames", "5", "--crossings", "0", "--out", "multi", "--video", "one.mp4"]);
    assert!(made.status.success(), "{}", errors(&made));
    assert!(place.failure(&["one.mp4"]).contains("no box to start from"));
    std::fs::write(place.path("one.txt"), "30,30,28,28\n").expect("written");
    assert_eq!(place.boxes("beside", &["one.mp4"]), place.boxes("given", &["one.mp4", "--init", "30,30,28,28"]));
}
