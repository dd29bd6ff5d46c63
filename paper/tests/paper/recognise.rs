//! An experiment counts how often the right class is recognised.

use crate::place::{Place, errors};

#[test]
fn an_experiment_counts_the_frames_recognised() {
    let place = Place::new();
    let run = || {
        let mut command = place.command(&["reproduce", "mine.toml", "--out", "out"]);
        let output = command.env("FOVEATE_DATA", place.path("none")).output().expect("it starts");
        assert!(output.status.success(), "{}", errors(&output));
        errors(&output)
    };
    let experiment = r#"
        title = "mine"
        about = ""
        measure = "accuracy"
        digits = [3, 8]
        seeds = 1
        frames = 6
        scene = [{ name = "clean", video = { scene = "clutter" } }]
        [[line]]
        name = "digits"
        config = "digits"
        change.recogniser = { kind = "multi-fixation", weights = "builtin:digits", policy = { kind = "exp3" } }
    "#;
    std::fs::write(place.path("mine.toml"), experiment).expect("a writable folder");
    run();
    let table: serde_json::Value = serde_json::from_slice(&place.read("out/mine.json")).expect("JSON");
    let line = &table["lines"][0];
    assert_eq!((line["videos"].as_u64(), line["policy"].as_str()), (Some(2), Some("fixed")));
    assert!(line["details"]["right by the last looks alone"].is_f64());
    assert!(run().contains("2 runs, 2 of them"));
}
