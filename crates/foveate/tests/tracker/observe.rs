//! The files of observers equal the results of the tracker, in a short real run.

use foveate::files::Folder;
use foveate_testing::need;
use std::path::Path;
use std::sync::Arc;

use crate::common::shown;
use foveate::Seen;
use foveate::config::Config;
use foveate::geometry::BBox;
use foveate::identity::retina::FovealConfig;
use foveate::identity::{Foveal, Retina};
use foveate::report::{Annotator, Boxes, Film, Observer, Report, RunInfo, Table, Trace};
use foveate::scene::Image;
use foveate::video::Frame;
use foveate::{Error, Result};

const FRAMES: usize = 12;
const INIT: BBox = BBox { x: 10.0, y: 12.5, w: 16.0, h: 12.0 };
const HOSTILE: &str = "a/</script><script>alert(1)</script><!--{{script}}&\"'\u{2028}";

const CONFIG: &str = r#"
particles = 60
[dynamics]
kind = "autoregressive"
[retina]
kind = "foveal"
side = 28.0
rings = [[8, 2], [16, 4]]
[encoder]
kind = "raw"
[likelihood]
distance = "cosine"
sharpness = 20.0
[policy]
kind = "hedge"
gamma = 0.5
"#;

/// A patch with a texture of its own drifts over a ramp.
fn frame(index: usize) -> Frame {
    let (w, h) = (64, 48);
    let pixel = |x: usize, y: usize| {
        let (u, v) = (x as isize - 10 - index as isize, y as isize - 12);
        let inside = (0..16).contains(&u) && (0..12).contains(&v);
        if inside { (60 + 37 * (u * v) % 190) as u8 } else { (2 * x + y) as u8 }
    };
    let data = (0..w * h).map(|i| pixel(i % w, i / w)).collect();
    Frame { index, time: index as f64 / 25.0, image: Image::new(w, h, 1, data).expect("64 x 48") }
}

fn info() -> RunInfo {
    let retina = Foveal::new(FovealConfig { side: 28.0, rings: vec![[8, 2], [16, 4]], colour: vec![] });
    let retina: Arc<dyn Retina> = Arc::new(retina.expect("whole cells"));
    RunInfo { source: HOSTILE.into(), command: HOSTILE.into(), rate: 25.0, retina: Some(retina), ..RunInfo::default() }
}

/// Runs the tracker; each step is shown to `observer` and to `look`.
fn run(observer: &mut dyn Observer, mut look: impl FnMut(&Frame, &Seen<'_>)) {
    let blueprint = Config::parse(CONFIG, "test").and_then(|c| c.check(&Folder::here())).expect("a good configuration");
    let mut tracker = blueprint.tracker(7).expect("parts that fit");
    tracker.init(&frame(0).image, INIT).expect("a box in the picture");
    observer.observe(&frame(0), &[Seen::given(frame(0).image.shape(), &INIT)]).expect("room on the disk");
    for index in 1..FRAMES {
        let frame = frame(index);
        let step = tracker.update(&frame.image).expect("a picture of the first size");
        observer.observe(&frame, &[step]).expect("room on the disk");
        look(&frame, &step);
    }
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a text file")
}

#[test]
fn boxes_and_table_read_back() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (boxes, table) = (folder.path().join("boxes.txt"), folder.path().join("track.csv"));
    let mut observers: Vec<Box<dyn Observer>> = vec![
        Box::new(Boxes::create(&boxes).expect("a writable folder")),
        Box::new(Table::create(&table).expect("a writable folder")),
    ];
    let (mut said, mut rows) = (vec![INIT], vec![]);
    run(&mut observers, |_, step| {
        said.push(step.bbox);
        let c = &step.covariance;
        rows.push((step.state.to_array(), c[0][1], c[5][5], step.ess, step.log_evidence, step.plan.chosen().u));
    });
    assert!(!boxes.exists() && !table.exists(), "files appear when they are whole");
    observers.finish().expect("renamed");

    let numbers = |line: &str| line.split(',').map(|n| n.parse::<f64>().ok()).collect::<Vec<_>>();
    let text = read(&boxes);
    assert_eq!(text.lines().next(), Some("11.000,13.500,16.000,12.000"), "counted from 1");
    assert_eq!(text.lines().count(), FRAMES);
    for (line, b) in text.lines().zip(&said) {
        for (got, want) in numbers(line).into_iter().zip([b.x + 1.0, b.y + 1.0, b.w, b.h]) {
            assert!((got.expect("a number") - want).abs() <= 5.1e-4, "{line}: {b:?}");
        }
    }

    let text = read(&table);
    let names: Vec<&str> = text.lines().next().expect("a header").split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("no column {name}"));
    assert_eq!(names.iter().collect::<std::collections::BTreeSet<_>>().len(), names.len(), "no name twice");
    assert_eq!(names.iter().filter(|n| n.starts_with("cov_")).count(), 28);
    let given: Vec<&str> = text.lines().nth(1).expect("frame 1").split(',').collect();
    assert_eq!((given.len(), given[column("left")], given[column("ess")]), (names.len(), "10", ""));
    for (line, (state, cov_xy, cov_aa, ess, evidence, u)) in text.lines().skip(2).zip(&rows) {
        let got = numbers(line);
        assert_eq!(got.len(), names.len());
        let bits = |name: &str| got[column(name)].expect("a number").to_bits();
        for (name, value) in ["x", "y", "vx", "vy", "log_scale", "angle", "log_aspect"].iter().zip(state) {
            assert_eq!(bits(name), value.to_bits(), "{name}");
        }
        for (name, value) in
            [("cov_x_y", cov_xy), ("cov_angle_angle", cov_aa), ("ess", ess), ("log_evidence", evidence)]
        {
            assert_eq!(bits(name), value.to_bits(), "{name}");
        }
        assert_eq!(bits("gaze_u"), u.to_bits());
        assert_eq!(got[column("class")], None, "empty without a recogniser");
        assert_eq!(got[column("class_probability")], None);
    }
}

#[test]
fn the_trace_holds_every_quantity_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("trace.jsonl");
    let mut trace = Trace::create(&path).expect("a writable folder");
    let mut said = vec![];
    run(&mut trace, |_, step| said.push((step.weights.to_vec(), step.particles[7].to_array(), step.percept.clone())));
    trace.finish().expect("renamed");
    let lines: Vec<serde_json::Value> =
        read(&path).lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect();
    assert_eq!((lines.len(), &lines[0]["given"]["y"]), (FRAMES, &serde_json::json!(12.5)));
    for (line, (weights, particle, percept)) in lines[1..].iter().zip(&said) {
        let list = |value: &serde_json::Value| -> Vec<f64> {
            value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
        };
        assert_eq!(&list(&line["weights"]), weights);
        assert_eq!(list(&line["predicted"][7]), particle);
        let glimpse: Vec<f32> = list(&line["percept"]["glimpse"]).iter().map(|v| *v as f32).collect();
        assert_eq!(glimpse, percept.glimpse);
        assert_eq!(line["plan"]["gazes"].as_array().map(Vec::len), Some(9));
        assert_eq!(line["rewards"].as_array().map(Vec::len), Some(9));
        let hoped: f64 = list(&line["snapshot"]["probabilities"]).iter().sum();
        assert!((hoped - 1.0).abs() < 1e-9);
    }
}

fn report(folder: &Path) -> String {
    let path = folder.join("report.html");
    let mut report = Report::create(&path, info()).expect("a writable folder");
    run(&mut report, |_, _| ());
    report.finish().expect("renamed");
    report.finish().expect("finishing twice is finishing once");
    read(&path)
}

#[test]
fn the_report_needs_no_network_and_no_trust() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let page = report(folder.path());
    for outside in ["http:", "https:", "src=", "href=", "@import", "eval(", "//cdn", "fetch("] {
        assert!(!page.contains(outside), "the page must not hold {outside}");
    }
    assert_eq!(page.matches("</script>").count(), 2, "a source's name ends no script");
    assert!(!page.contains("<script>alert") && page.contains("script&gt;&lt;!--"));

    let data =
        page.split("id=\"data\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("a data element");
    let data: serde_json::Value = serde_json::from_str(data).expect("JSON");
    assert_eq!(data["info"]["source"], HOSTILE);
    assert_eq!(data["keys"].as_array().map(Vec::len), Some(FRAMES));
    for (name, column) in data["series"].as_object().expect("columns") {
        assert_eq!(column.as_array().map(Vec::len), Some(FRAMES), "{name}");
    }
    assert_eq!((&data["particles"], &data["shown"]), (&serde_json::json!(60), &serde_json::json!(60)));
    assert_eq!(data["arms"].as_array().map(Vec::len), Some(9));
}

/// Opens the page in a browser, if there is one, and reads its text.
#[test]
fn the_report_runs_in_a_browser() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    report(folder.path());
    let markup = need!(shown(&folder.path().join("report.html"), "frame=5"));
    assert!(
        markup.contains("frame <b>5</b> of 12"),
        "the replay stands at frame 5: {}",
        &markup[..markup.len().min(3000)]
    );
    assert!(markup.matches("<svg width=").count() >= 9, "the charts are drawn");
    assert!(!markup.contains("script failed"));
}

#[test]
fn the_annotated_frame_shows_box_and_lost() {
    let mut annotator = Annotator::new(&info());
    let mut blank = Vec::<Box<dyn Observer>>::new();
    let first = annotator.annotate(&frame(0), &Seen::given(frame(0).image.shape(), &INIT));
    assert!(first.width().is_multiple_of(2) && first.height().is_multiple_of(2) && first.planes() == 3);
    assert_eq!(first.height(), 480, "48 rows are magnified ten times");
    let mut sizes = vec![];
    run(&mut blank, |frame, step| {
        let picture = annotator.annotate(frame, step);
        // The middle of the box's left edge, on the magnified frame, is the target's blue.
        let edge = step.state.fixate(foveate::geometry::Gaze { u: -1.0, v: 0.9, arm: None }, step.extent);
        let (x, y) = ((10.0 * (edge.x + 0.5)).round() as usize, (10.0 * (edge.y + 0.5)).round() as usize);
        let blue = (x - 2..=x + 2).any(|x| picture.at(2, x, y) > 200 && picture.at(0, x, y) < 120);
        sizes.push((picture.width(), picture.height(), blue));
    });
    assert!(sizes.iter().all(|s| *s == (first.width(), first.height(), true)), "{sizes:?}");
}

#[test]
fn nothing_stays_where_nothing_was_finished_and_errors_name_the_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut report = Report::create(folder.path().join("report.html"), info()).expect("a writable folder");
    run(&mut report, |_, _| ());
    drop(report);
    assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 0);
    let nowhere = folder.path().join("no/folder");
    for error in [
        Boxes::create(nowhere.join("boxes.txt")).err(),
        Table::create(nowhere.join("track.csv")).err(),
        Trace::create(nowhere.join("trace.jsonl")).err(),
        Report::create(nowhere.join("report.html"), info()).err(),
        Film::create(nowhere.join("annotated.mp4"), &info()).err(),
    ] {
        let said = error.expect("there is no such folder").to_string();
        assert!(said.contains("no/folder") && said.contains("cannot write"), "{said}");
    }
}

/// Records that it was finished, and fails.
struct Broken<'a>(&'a std::cell::Cell<usize>);

impl Observer for Broken<'_> {
    fn observe(&mut self, _: &Frame, _: &[Seen<'_>]) -> Result<()> {
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        self.0.set(self.0.get() + 1);
        Err(Error::Invalid(format!("failure {}", self.0.get())))
    }
}

#[test]
fn one_broken_observer_does_not_keep_others_from_finishing() {
    let count: &'static std::cell::Cell<usize> = Box::leak(Box::new(std::cell::Cell::new(0)));
    let mut observers: Vec<Box<dyn Observer>> = vec![Box::new(Broken(count)), Box::new(Broken(count))];
    assert_eq!(observers.finish().expect_err("both fail").to_string(), "failure 1");
    assert_eq!(count.get(), 2);
}

#[test]
fn the_film_has_every_frame() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("annotated.mp4");
    let mut film = Film::create(&path, &info()).expect("a writable folder");
    run(&mut film, |_, _| ());
    film.finish().expect("written");
    let source = foveate::video::open(&path).expect("a video");
    let frames: Vec<Frame> = source.collect::<Result<_>>().expect("every frame decodes");
    assert_eq!((frames.len(), frames[0].image.height()), (FRAMES, 480));
    assert!((frames[FRAMES - 1].time - (FRAMES - 1) as f64 / 25.0).abs() < 1e-3, "25 frames a second");
}
