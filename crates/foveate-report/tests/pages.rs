//! The report pages in a browser, if there is one, and the parts that a policy with a single gaze leaves out.

#[cfg(unix)]
#[path = "../../foveate-cli/tests/browser/mod.rs"]
mod browser;

use foveate_testing::need;
use std::path::{Path, PathBuf};

use foveate_base::files::Folder;
use foveate_core::Seen;
use foveate_core::config::Config;
use foveate_core::geometry::BBox;
use foveate_core::multi::Phase;
use foveate_report::{Observer, Report, RunInfo, SurfacePicture};
use serde_json::Value;

mod scene;

use scene::{CONFIG, frame};

const INIT: BBox = BBox { x: 10.0, y: 12.0, w: 16.0, h: 12.0 };
const FRAMES: usize = 10;

/// report.html and surface.png of a short run with a policy.
fn run(folder: &Path, policy: &str) -> PathBuf {
    let config = Config::parse(&format!("{CONFIG}{policy}"), "test").expect("a good configuration");
    let blueprint = config.check(&Folder::here()).expect("parts that fit");
    let mut tracker = blueprint.tracker(7).expect("parts that fit");
    let info = RunInfo { retina: Some(blueprint.retina()), rate: 25.0, ..RunInfo::default() };
    let path = folder.join("report.html");
    let mut all: Vec<Box<dyn Observer>> = vec![
        Box::new(Report::create(&path, info.clone()).expect("a writable folder")),
        Box::new(SurfacePicture::create(folder.join("surface.png"), info).expect("a writable folder")),
    ];
    tracker.init(&frame(0).image, INIT).expect("a box in the picture");
    all.observe(&frame(0), &[Seen::given(frame(0).image.shape(), &INIT)]).expect("kept");
    for index in 1..FRAMES {
        let frame = frame(index);
        let seen = tracker.update(&frame.image).expect("a picture of the first size");
        all.observe(&frame, &[seen]).expect("kept");
    }
    all.finish().expect("written");
    path
}

/// The page above its scripts, as a browser shows it.
fn shown(page: &Path, profile: &Path) -> Result<String, String> {
    let profile = format!("--user-data-dir={}", profile.display());
    let address = format!("file://{}", page.display());
    let ask =
        ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=4000", "--dump-dom", &profile, &address];
    let answer = std::process::Command::new("chromium").args(ask).output().map_err(|_| "chromium")?;
    let text = String::from_utf8_lossy(&answer.stdout).into_owned();
    let body = text.split_once("<body").map(|(_, body)| body.split("<script").next().expect("one part").to_owned());
    body.ok_or_else(|| "chromium that shows pages".into())
}

/// The opening tag of the card that has this attribute.
fn card<'a>(page: &'a str, attribute: &str) -> &'a str {
    let at = page.find(attribute).expect("it has the card");
    let start = page[..at].rfind('<').expect("a tag");
    page[start..].split('>').next().expect("its end")
}

#[test]
fn a_single_gaze_has_no_policy_to_show() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (one, nine) = (folder.path().join("one"), folder.path().join("nine"));
    for (folder, policy, written) in [(&one, "kind = \"fixed\"", false), (&nine, "kind = \"random\"", true)] {
        std::fs::create_dir(folder).expect("a new folder");
        let page = run(folder, policy);
        let names = std::fs::read_dir(folder).expect("results").count();
        assert_eq!((folder.join("surface.png").exists(), names), (written, 1 + usize::from(written)), "{policy}");
        let shown = need!(shown(&page, &folder.join("profile")));
        assert!(!shown.contains("script failed"), "{shown}");
        for attribute in ["aria-labelledby=\"where-title\"", "aria-labelledby=\"film-title\""] {
            assert_eq!(card(&shown, attribute).contains("hidden"), !written, "{policy}: {attribute}");
        }
        assert_eq!(shown.contains("<b>Gaze policy. </b>"), written, "{policy}: the legend");
    }
}

/// Counts labels of one chart that touch each other or leave it.
const OVERLAPS: &str = "<script>
let bad = 0;
for (const svg of document.querySelectorAll('.plot svg')) {
  const whole = svg.getBoundingClientRect(), boxes = [...svg.querySelectorAll('text')].map(t => t.getBoundingClientRect());
  boxes.forEach((a, i) => {
    bad += a.left < whole.left - 1 || a.right > whole.right + 1;
    for (const b of boxes.slice(i + 1)) bad += a.left < b.right && b.left < a.right && a.top < b.bottom - 2 && b.top < a.bottom - 2;
  });
}
document.body.dataset.overlaps = bad;
</script></body>";

#[test]
fn labels_never_overlap() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = std::fs::read_to_string(run(folder.path(), "kind = \"random\"")).expect("a page");
    let (before, rest) = page.split_once("id=\"data\">").expect("data");
    let (data, after) = rest.split_once("</script>").expect("their end");
    let data: Value = serde_json::from_str(data).expect("JSON");
    for frames in [1, 2, 10, 300, 20_000, 200_000] {
        let mut long = data.clone();
        for (name, column) in long["series"].as_object_mut().expect("columns") {
            let values = column.as_array_mut().expect("a column");
            *values = (0..frames).map(|t| values[t % FRAMES].clone()).collect();
            if name == "frame" {
                *values = (1..=frames).map(Value::from).collect();
            }
        }
        if let Some(keys) = long["keys"].as_array_mut() {
            keys.truncate(frames);
        }
        let text = format!("{before}id=\"data\">{long}</script>{}", after.replace("</body>", OVERLAPS));
        let path = folder.path().join(format!("{frames}.html"));
        std::fs::write(&path, text).expect("a writable folder");
        let shown = need!(shown(&path, &folder.path().join("profile")));
        assert!(!shown.contains("script failed"), "{frames} frames: {}", &shown[..300]);
        assert!(shown.contains("data-overlaps=\"0\""), "{frames} frames: {}", shown.split('>').next().unwrap_or(""));
    }
}

/// report.html of a short run with two targets, the second in one frame.
fn many(folder: &Path) -> PathBuf {
    let path = folder.join("many.html");
    let mut report = Report::create(&path, RunInfo::default()).expect("a writable folder");
    for index in 0..FRAMES {
        let given = Seen::given(frame(index).image.shape(), &INIT);
        let (one, mut two) = (given.in_phase(Phase::Tracked), given.in_phase(Phase::Lost));
        two.id = 2;
        report.observe(&frame(index), &[one, two][..1 + usize::from(index == 6)]).expect("kept");
    }
    report.finish().expect("written");
    path
}

#[test]
fn the_page_of_many_targets_replays() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = many(folder.path());
    let shown = need!(shown(&path, &folder.path().join("profile")));
    assert!(!shown.contains("script failed"), "{shown}");
    assert!(shown.contains("frame <b>7</b> of 10 · 2 targets"), "it opens where most targets are");
    assert!(shown.contains("id=\"scrub\"") && shown.contains("Legend") && shown.contains("class=\"bars\""));
}

/// The meaning of the shades of the charts stands beside P(lost), if there are any, and in the legend.
#[test]
fn shaded_frames_are_explained() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = std::fs::read_to_string(run(folder.path(), "kind = \"random\"")).expect("a page");
    let (before, rest) = page.split_once("id=\"data\">").expect("data");
    let (data, after) = rest.split_once("</script>").expect("their end");
    for lost in [false, true] {
        let mut data: Value = serde_json::from_str(data).expect("JSON");
        let usable = data["series"]["usable"].as_array_mut().expect("a column");
        *usable = (0..usable.len()).map(|row| Value::from(u8::from(!lost || row != 4))).collect();
        let path = folder.path().join("lost.html");
        std::fs::write(&path, format!("{before}id=\"data\">{data}</script>{after}")).expect("a writable folder");
        let shown = need!(shown(&path, &folder.path().join("profile")));
        assert!(shown.contains("<b>Shaded frames. </b>"), "the legend");
        assert_eq!(shown.contains("<i class=\"swatch shade\"></i>occluded or lost"), lost, "the chart");
    }
}

/// The page of one target and of many, light and dark, on a screen and on a phone.
#[cfg(unix)]
#[test]
fn pages_fit_screens_and_fingers() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (one, many) = (run(folder.path(), "kind = \"random\""), many(folder.path()));
    let mut browser = need!(browser::Browser::start(folder.path(), &[]).ok_or("chromium that runs here"));
    browser.judge_file("one", &one);
    browser.judge_file("many", &many);
}
