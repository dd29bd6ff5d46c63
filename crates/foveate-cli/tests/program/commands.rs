//! The small commands: the demo, what ships, completions, manual pages.

use crate::place::{Place, errors, printed};

#[test]
fn configurations_are_listed_and_printed() {
    let place = Place::new();
    let list = printed(&place.done(["configs"]));
    for line in foveate::config::BUILTIN.iter().map(|b| b.0) {
        assert!(list.lines().any(|l| l.starts_with(&format!("{line} "))), "{line} is missing in\n{list}");
    }
    assert!(
        list.lines().any(|l| l.contains("digits-hedge") && l.contains(" hedge ") && l.contains("16/1 24/2")),
        "{list}"
    );
    let text = printed(&place.done(["configs", "natural"]));
    place.write("mine.toml", text);
    place.done(["track", "video", "-c", "mine.toml", "--no-video", "--no-report", "--until", "2"]);
    let error = errors(&place.run(["configs", "nature"]));
    assert!(error.contains("nature") && error.contains("natural-fast"), "{error}");
}

#[test]
fn completions_and_manual_pages() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = printed(&place.done(["completions", shell]));
        assert!(script.contains("foveate") && script.contains("save-state"), "{shell}");
    }
    place.done(["man", "pages"]);
    let pages = place.names("pages");
    for page in ["foveate.1", "foveate-track.1", "foveate-synth-clutter.1", "foveate-man.1"] {
        assert!(pages.iter().any(|p| p == page), "{pages:?}");
    }
    assert!(place.text("pages/foveate-track.1").contains("reinit"));
    assert!(!place.run(["man", "c.toml"]).status.success(), "a file is no folder");
    assert!(printed(&place.done(["--version"])).starts_with("foveate "));
}

#[test]
fn the_demo_is_honest() {
    let place = Place::new();
    let message = printed(&place.done(["demo", "--out", "d"]));
    for words in ["a drawn 2", "values read a frame", "looks that (", "is worth most", "end to end", "d/report.html"] {
        assert!(message.contains(words), "{words} is missing in\n{message}");
    }
    let error = |policy: &str| -> f64 {
        let line = message.lines().find(|line| line.trim_start().starts_with(policy)).expect("a line for each policy");
        let error = line.split("mean error ").nth(1).and_then(|rest| rest.split(' ').next());
        error.and_then(|error| error.parse().ok()).expect("a number")
    };
    let least = error("fixed centre").min(error("random gazes"));
    assert!(error("gp-ucb") < 0.7 * least, "learning where to look pays here:\n{message}");
    // The documents have the figures of ten seeds, with the command that measures them.
    let ten =
        message.split("One run is luck. ").nth(1).and_then(|rest| rest.split(" (docs/").next()).expect("ten seeds");
    let docs = ["README.md", "docs/looking.md"].map(|name| format!("{}/../../{name}", env!("CARGO_MANIFEST_DIR")));
    for path in &docs {
        let text = std::fs::read_to_string(path).expect("a document");
        assert!(text.split_whitespace().collect::<Vec<_>>().join(" ").contains(ten), "{path} has not: {ten}");
    }
    assert_eq!(place.names("d"), ["annotated.mp4", "boxes.txt", "report.html", "run.json", "surface.png", "track.csv"]);
    assert!(place.text("d/report.html").contains("\"baselines\":[{"));
    let clutter = ["demo", "--out", "d", "--scene", "clutter", "--set", "particles=150", "--trace"];
    let message = printed(&place.done(&clutter));
    for words in ["Followed a drawn 3", "occluded in 0 frames", "It learned to look at", "fixed centre", "random gazes"]
    {
        assert!(message.contains(words), "{words} is missing in\n{message}");
    }
    assert!(place.path("d/trace.jsonl").is_file());
    let message = printed(&place.done(["demo", "--out", "d", "--policy", "fixed"]));
    assert!(message.contains("has nothing to learn") && message.contains("random gazes"), "{message}");
    assert!(
        !message.contains("fixed centre mean") && !message.contains("One run is luck"),
        "not beside itself: {message}"
    );
    for name in ["natural", "natural-fast", "multi"] {
        let error = errors(&place.run(["demo", "--out", "d", "--config", name]));
        assert!(error.contains("for real video") && error.contains("digits-hedge"), "{error}");
    }
}
