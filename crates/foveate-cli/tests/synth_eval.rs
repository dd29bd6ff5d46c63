//! The commands themselves: make a video, score its own truth on it.

use std::process::{Command, Output};

fn foveate(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_foveate")).args(args).output().expect("the program starts")
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

    std::fs::create_dir(&results).expect("a new folder");
    std::fs::copy(path("seqs/three/groundtruth_rect.txt"), path("perfect/three.txt")).expect("copied");
    let seqs = path("seqs");
    let scored = foveate(&["eval", "--seqs", &seqs, "--results", &results, "--out", &out, "--json"]);
    assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
    let json: serde_json::Value = serde_json::from_slice(&scored.stdout).expect("JSON alone on the standard output");
    let mean = &json["trackers"][0]["mean"];
    assert!((mean["auc"].as_f64().expect("a number") - 20.0 / 21.0).abs() < 1e-12, "{mean}"); // 1 is not above 1
    assert_eq!((mean["p20"].as_f64(), mean["lost"].as_u64(), mean["frames"].as_u64()), (Some(1.0), Some(0), Some(12)));
    for file in ["table.txt", "scores.json", "curves.svg"] {
        assert!(dir.path().join("scores").join(file).is_file(), "{file}");
    }
    let none = foveate(&["eval", "--seqs", &results, "--results", &results, "--out", &out]);
    assert!(!none.status.success() && String::from_utf8_lossy(&none.stderr).contains("no sequence here"));
}
