//! The pages of evaluations and many videos: one style, no script, opened in a browser where there is one.

use crate::browser::{Browser, is_one_document};
use crate::place::{Place, done};
use foveate_testing::need;

#[test]
fn pages_without_a_script_have_the_style_of_the_reports() {
    let place = Place::new();
    for line in [
        "synth clutter --frames 10 --seed 5 --out a-video-with-a-rather-long-name",
        "track -c c.toml --no-video --no-report -o runs video a-video-with-a-rather-long-name",
        "eval --config c.toml --seqs video a-video-with-a-rather-long-name --out scores",
    ] {
        done(place.command(line.split(' ')).env("FOVEATE_DATA", place.path("none")));
    }
    let pages = ["runs/index.html", "scores/report.html"];
    let texts = pages.map(|page| place.text(page));
    for text in &texts {
        is_one_document(text);
        assert!(text.contains(foveate::report::STYLE) && !text.contains("<script"), "one style, and no script");
    }
    // The curves are in the page, with their names below them; each run has its own.
    let [_, scores] = &texts;
    for chart in ["Success, and its mean (AUC)", "Precision, and its value at 20 px", "Reliability of P(lost)"] {
        assert!(scores.contains(&format!("aria-label=\"{chart}\"")), "{chart}");
    }
    assert_eq!(scores.matches("class=\"drawing\"").count(), 3 + 2);
    let mut browser = need!(Browser::start(&place.path("."), &[]).ok_or("chromium that runs here"));
    for (name, page) in ["runs", "scores"].into_iter().zip(pages) {
        browser.judge_file(name, &place.path(page));
    }
}
