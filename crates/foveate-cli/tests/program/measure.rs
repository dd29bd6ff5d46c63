//! `foveate measure`: motion in metres and seconds.

use crate::place::{FRAMES, Place, errors};

const UNITS: [&str; 6] = ["--ruler", "1,1,1,101=1.00+-0.01m", "--fps", "25", "--fit", "line:x"];

#[test]
fn a_video_and_its_track_give_the_same_measurement() {
    let place = Place::new();
    let run = |args: &[&str]| place.run(&[&["measure"], &UNITS[..], args].concat());
    let quick = ["video", "-c", "c.toml", "--no-video", "--no-report"];
    let output = run(&[&quick[..], &["-o", "out"]].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("line:x") && said.contains("  v = ") && said.contains("m/s (95 %:"), "{said}");
    let names = ["boxes.txt", "fits.json", "measure.csv", "measure.html", "run.json", "track.csv"];
    assert_eq!(place.names("out"), names);
    assert_eq!(place.lines("out/measure.csv"), FRAMES + 1);
    let again = run(&["--track", "out/track.csv", "-o", "again"]);
    assert!(again.status.success(), "{}", errors(&again));
    for name in ["measure.csv", "fits.json"] {
        assert!(place.read(&format!("out/{name}")) == place.read(&format!("again/{name}")), "{name}");
    }
    // A thing that moves with the target takes its motion away.
    let truth = String::from_utf8(place.read("video/groundtruth_rect.txt")).expect("text");
    let first = truth.lines().next().expect("a box").to_owned();
    let relative = run(&[&quick[..], &["-o", "relative", "--reference", &first]].concat());
    assert!(relative.status.success(), "{}", errors(&relative));
    let speed = |folder: &str| {
        let fits: serde_json::Value =
            serde_json::from_slice(&place.read(&format!("{folder}/fits.json"))).expect("JSON");
        fits["fits"][0]["values"][1]["value"].as_f64().expect("a speed").abs()
    };
    assert!(speed("relative") < 0.3 * speed("out"), "{} {}", speed("relative"), speed("out"));
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let place = Place::new();
    let refused = |args: &[&str], said: &str| {
        let output = place.run(&[&["measure", "-o", "none"][..], args].concat());
        assert!(!output.status.success() && errors(&output).contains(said), "{args:?}: {}", errors(&output));
        assert!(!place.path("none").exists(), "{args:?}");
    };
    refused(&["video", "--init", "1,1,20,20", "--init", "40,40,20,20"], "one target");
    refused(&["video", "--reference", "5000,1,20,20"], "--reference");
    refused(&["video", "--track", "track.csv"], "cannot be used with");
    refused(&["--track", "nothing.csv"], "nothing.csv");
    refused(&[], "required");
    refused(&["video", "--fit", "cubic:y"], "parabola");
}
