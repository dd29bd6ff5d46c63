//! The dictionary of columns against the files of a short real run.

use std::collections::BTreeSet;
use std::path::Path;

use foveate_base::files::Folder;
use foveate_core::Seen;
use foveate_core::config::Config;
use foveate_core::geometry::{BBox, Gaze};
use foveate_core::multi::Phase;
use foveate_core::scene::Detection;
use foveate_report::columns::{BOXES, Column, REGRET, TARGETS, TRACE, TRACK, TRACKS, TRACKS_TXT};
use foveate_report::regret::RegretLog;
use foveate_report::{Boxes, MotFile, Observer, Table, TargetsTable, Trace, TracksTable};
use serde_json::Value;

mod scene;

use scene::{CONFIG, frame};

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a text file")
}

fn header(columns: &[Column]) -> String {
    columns.iter().map(|column| column.name).collect::<Vec<_>>().join(",")
}

/// Every line has as many cells as there are columns.
fn check(text: &str, columns: &[Column]) {
    assert!(text.lines().count() > 1);
    assert!(text.lines().all(|line| line.split(',').count() == columns.len()), "{text}");
}

/// The keys of an object, those inside it after a dot; lists are not opened.
fn keys(prefix: &str, value: &Value, all: &mut BTreeSet<String>) {
    // A gaze and a box are one column each.
    let plain = ["u", "w"].iter().any(|key| value.get(key).is_some());
    match value.as_object().filter(|_| !plain) {
        Some(object) => {
            let name = |key: &str| if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") };
            object.iter().for_each(|(key, value)| keys(&name(key), value, all));
        }
        None => drop(all.insert(prefix.to_owned())),
    }
}

#[test]
fn files_of_one_target_have_the_columns_of_the_dictionary() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let mut all: Vec<Box<dyn Observer>> = vec![
        Box::new(Boxes::create(path("boxes.txt")).expect("a writable folder")),
        Box::new(Table::create(path("track.csv")).expect("a writable folder")),
        Box::new(Trace::create(path("trace.jsonl")).expect("a writable folder")),
    ];
    let blueprint = Config::parse(&format!("{CONFIG}kind = \"hedge\"\ngamma = 0.5\n"), "test")
        .and_then(|c| c.check(&Folder::here()))
        .expect("a good configuration");
    let mut tracker = blueprint.tracker(7).expect("parts that fit");
    let bbox = BBox { x: 10.0, y: 12.0, w: 16.0, h: 12.0 };
    tracker.init(&frame(0).image, bbox).expect("a box in the picture");
    all.observe(&frame(0), &[Seen::given(frame(0).image.shape(), &bbox)]).expect("written");
    let mut names = vec![];
    for index in 1..4 {
        let frame = frame(index);
        let seen = tracker.update(&frame.image).expect("a picture of the first size");
        names.push(seen.status.name());
        all.observe(&frame, &[seen]).expect("written");
    }
    all.finish().expect("named");

    let boxes = read(&path("boxes.txt"));
    check(&boxes, BOXES);
    assert_eq!(boxes.lines().next(), Some("11.000,13.000,16.000,12.000"), "pixels count from 1");
    let table = read(&path("track.csv"));
    assert_eq!(table.lines().next(), Some(&*header(TRACK)));
    check(&table, TRACK);
    assert!(table.lines().nth(1).is_some_and(|line| line.starts_with("1,0,10,12,16,12,")), "pixels count from 0");
    let status = TRACK.iter().position(|column| column.name == "status").expect("it has one");
    assert!(table.lines().skip(2).map(|line| line.split(',').nth(status).expect("a cell")).eq(names));

    let mut written = BTreeSet::new();
    let trace = read(&path("trace.jsonl"));
    trace.lines().for_each(|line| keys("", &serde_json::from_str(line).expect("JSON"), &mut written));
    let known: BTreeSet<String> = TRACE.iter().map(|column| column.name.to_owned()).collect();
    let unknown: Vec<_> = written.difference(&known).collect();
    // Without a recogniser, a recorded gaze and a reward surface, these are left out.
    const ABSENT: [&str; 11] = [
        "class",
        "classes",
        "own_classes",
        "recognition_gazes",
        "recorded_gazes",
        "recorded_rewards",
        "snapshot",
        "snapshot.points",
        "snapshot.reach",
        "snapshot.mean",
        "snapshot.best",
    ];
    let missing: Vec<_> = known.difference(&written).filter(|name| !ABSENT.contains(&name.as_str())).collect();
    assert!(unknown.is_empty() && missing.is_empty(), "not in the dictionary: {unknown:?}; not written: {missing:?}");
}

#[test]
fn regret_has_the_columns_of_the_dictionary() {
    let gazes = [Gaze::CENTRE, Gaze { u: 0.5, v: -0.25, arm: None }];
    let mut log = RegretLog::new(gazes.to_vec());
    log.push(2, gazes[0], 0.5, &[0.5, 0.75]);
    let fixed = header(&REGRET[..REGRET.len() - 1]);
    assert_eq!(REGRET[REGRET.len() - 1].name, "reward_U_V");
    assert_eq!(log.csv(), format!("{fixed},reward_0_0,reward_0.5_-0.25\n2,0,0,0.5,0.75,0.25,0.25,0.25,0.5,0.75\n"));
}

#[test]
fn files_of_many_targets_have_the_columns_of_the_dictionary() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let mut all: Vec<Box<dyn Observer>> = vec![
        Box::new(MotFile::create(path("tracks.txt")).expect("a writable folder")),
        Box::new(TracksTable::create(path("tracks.csv")).expect("a writable folder")),
        Box::new(TargetsTable::create(path("targets.csv")).expect("a writable folder")),
    ];
    let bbox = BBox { x: 10.0, y: 12.0, w: 16.0, h: 12.0 };
    let phases = [Phase::Initiated, Phase::Tracked, Phase::Occluded, Phase::Lost, Phase::ReIdentified];
    for (index, phase) in phases.into_iter().enumerate() {
        let detection = (index == 1).then_some(Detection::new(bbox, 1.0));
        let (detection_index, detected_class) = (detection.map(|_| 3), (index > 0).then_some(2));
        let given = Seen::given([64, 48, 1], &bbox);
        let (mut one, mut two) = (given.in_phase(phase), given);
        (one.detection, one.detection_index, one.detected_class) = (detection, detection_index, detected_class);
        one.consistency.deficit = 0.25;
        (two.id, two.class) = (2, Some((7, 0.5)));
        all.observe(&frame(index), &[one, two][..1 + index % 2]).expect("written");
    }
    all.finish().expect("named");
    all.finish().expect("finishing twice is finishing once");

    let text = read(&path("tracks.txt"));
    check(&text, TRACKS_TXT);
    assert_eq!(text.lines().next(), Some("1,1,11.000,13.000,16.000,12.000,0.750,-1,-1,-1"), "pixels count from 1");
    assert_eq!(text.lines().count(), 4 + 2, "a lost target is left out");
    let tracks = read(&path("tracks.csv"));
    assert_eq!(tracks.lines().next(), Some(&*header(TRACKS)));
    check(&tracks, TRACKS);
    let said: Vec<&str> = tracks.lines().skip(1).filter_map(|line| line.split(',').nth(3)).collect();
    assert_eq!(said, ["initiated", "tracked", "initiated", "occluded", "lost", "initiated", "re-identified"]);
    let at = TRACKS.iter().position(|column| column.name == "first_frame").expect("a column");
    let first = |line: &str| line.split(',').nth(at).map(str::to_owned);
    let first: Vec<_> = tracks.lines().skip(1).filter_map(first).collect();
    assert_eq!(first, ["1", "1", "2", "1", "1", "2", "1"], "a tracker counts pictures, a table frames");
    let at = TRACKS.iter().position(|column| column.name == "detected").expect("a column");
    let said = |line: &str| line.split(',').skip(at).take(3).collect::<Vec<_>>().join(",");
    let of_first: Vec<String> = tracks.lines().filter(|line| line.split(',').nth(2) == Some("1")).map(said).collect();
    assert_eq!(of_first, ["0,,", "1,3,2", "0,,2", "0,,2", "0,,2"], "detection and class, the class stays");
    let targets = read(&path("targets.csv"));
    let want = format!("{}\n1,1,5,5,1,1,1,1,,\n2,2,4,2,0,0,0,0,7,0.5\n", header(TARGETS));
    assert_eq!(targets, want);
}
