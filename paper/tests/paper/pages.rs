//! The page of experiments: the style of the reports, no script, opened in a browser where there is one.

use crate::browser::{Browser, is_one_document};
use crate::place::{Place, errors};
use foveate_testing::need;

/// An experiment of two quick runs.
const EXPERIMENT: &str = r#"
title = "Two lines"
about = "To see the page."
seeds = 1
frames = 12
digits = [3]
scene = [{ name = "bars", video = { scene = "occlusion" } }]
[[line]]
name = "Hedge, of nine gazes that lie on a grid over the target, for a long name"
config = "digits-hedge"
[[line]]
name = "fixed"
config = "digits"
"#;

#[test]
fn the_page_of_experiments_has_the_style_of_the_reports() {
    let place = Place::new();
    std::fs::write(place.path("mine.toml"), EXPERIMENT).expect("a writable folder");
    let mut command = place.command(&["reproduce", "mine.toml", "--set", "particles=60", "--out", "paper"]);
    let done = command.env("FOVEATE_DATA", place.path("none")).output().expect("it starts");
    assert!(done.status.success(), "{}", errors(&done));
    let text = String::from_utf8(place.read("paper/index.html")).expect("text");
    is_one_document(&text);
    assert!(text.contains(foveate::report::STYLE) && !text.contains("<script"), "one style, and no script");
    assert!(text.contains("class=\"drawing\"") && !text.contains("image/svg"), "charts take the colours of the page");
    let mut browser = need!(Browser::start(&place.path("."), &[]).ok_or("chromium that runs here"));
    browser.judge_file("paper", &place.path("paper/index.html"));
}
