//! Recognition stands beside the filter: it reports the class of the target, and changes no bit of the track.

use foveate::files::Folder;
use std::path::Path;

use crate::common::{INIT, POLICIES, blueprint, frame, json, random_recogniser, with_recogniser};
use foveate::Tracker;
use foveate::config::{Blueprint, Config};
use foveate::extend::SavedState;
use foveate::video::Frame;

const RULES: [&str; 3] = ["\"sum\"", "\"count\"", "{ forgetting = { memory = 4.0 } }"];
/// One whose class has a word in whether the target is lost.
const ALARMING: &str = "{ kind = \"random\" }\nalarm = true";
/// The usual, the alarming, one that learns from rewards, one of continuous gazes, one of two looks a frame.
const LOOKING: [&str; 5] = [
    "",
    ALARMING,
    "{ kind = \"exp3\", gamma = 0.3 }",
    "{ kind = \"gp-ucb\" }",
    "{ kind = \"anchor\", policy = { kind = \"circular\" } }",
];

fn frames() -> Vec<Frame> {
    (0..12).map(|i| frame(i, 1)).collect()
}

fn started(blueprint: &Blueprint, frames: &[Frame]) -> Tracker {
    let mut tracker = blueprint.tracker(5).expect("parts that fit");
    tracker.init(&frames[0].image, INIT).expect("a box in the picture");
    tracker
}

/// All numbers about classes of one step.
fn said(tracker: &mut Tracker, frame: &Frame) -> Vec<f64> {
    let step = tracker.update(&frame.image).expect("a picture of the first size");
    assert_eq!((step.classes.len(), step.own_classes.len()), (3, 3));
    for p in [step.classes, step.own_classes] {
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-9 && p.iter().all(|p| (0.0..=1.0).contains(p)), "{p:?}");
    }
    let (class, p) = step.class.expect("there is a recogniser");
    assert!(step.classes.iter().all(|q| *q <= p) && step.classes[class] == p);
    let gazes = step.recognition_gazes.iter().flat_map(|g| [g.u, g.v]);
    step.classes.iter().chain(step.own_classes).copied().chain(gazes).collect()
}

#[test]
fn recognition_changes_no_bit_of_the_track() {
    let (frames, (_folder, model)) = (frames(), random_recogniser());
    for (policy, looking) in
        POLICIES.into_iter().zip(LOOKING.into_iter().filter(|looking| *looking != ALARMING).cycle())
    {
        let (mut a, mut b) = (
            started(&with_recogniser(&raw(policy), &model, RULES[0], looking), &frames),
            started(&raw(policy), &frames),
        );
        for frame in &frames[1..] {
            let [a, b] = [&mut a, &mut b].map(|tracker| tracker.update(&frame.image).expect("a picture"));
            assert!(a.particles == b.particles && a.weights == b.weights && a.ancestors == b.ancestors, "{policy}");
            assert!(a.plan == b.plan && a.rewards == b.rewards && a.percept == b.percept, "{policy}");
            assert_eq!((a.state, a.log_evidence), (b.state, b.log_evidence), "{policy}");
            assert!(b.classes.is_empty() && b.class.is_none() && a.class.is_some());
        }
    }
}

fn raw(policy: &str) -> Blueprint {
    blueprint(policy, false, 0.5, false, 100)
}

#[test]
fn what_is_recognised_survives_a_pause_and_is_forgotten_with_the_target() {
    let (frames, (_folder, model)) = (frames(), random_recogniser());
    for rule in RULES {
        for looking in LOOKING {
            let blueprint = with_recogniser(&raw(POLICIES[2]), &model, rule, looking);
            let run = |tracker: &mut Tracker, frames: &[Frame]| -> Vec<Vec<f64>> {
                frames.iter().map(|frame| said(tracker, frame)).collect()
            };
            let mut whole = started(&blueprint, &frames);
            let all = run(&mut whole, &frames[1..]);
            let mut first = started(&blueprint, &frames);
            run(&mut first, &frames[1..6]);
            let text = first.save().to_string();
            let mut later = blueprint.tracker(5).expect("parts that fit");
            later.load(&serde_json::from_str(&text).expect("JSON")).expect("what was saved fits");
            assert_eq!(run(&mut later, &frames[6..]), all[5..], "{rule} {looking}");
            // A recogniser is a setting as others are.
            let error = raw(POLICIES[2]).tracker(5).expect("fits").load(&first.save()).expect_err("none").to_string();
            assert!(error.contains("recogniser is set in the state and not set in this tracker"), "{error}");
            let mut damaged = json(&first.save());
            damaged["ensemble"]["trackers"][0]["recognizer"]["evidence"]["evidence"] = serde_json::json!([1.0]);
            assert!(later.load(&SavedState::new(&damaged)).expect_err("one class").to_string().contains("3 classes"));
            let mut damaged = json(&first.save());
            assert_eq!(!damaged["ensemble"]["trackers"][0]["recognizer"]["alarm"].is_null(), looking == ALARMING);
            damaged["ensemble"]["trackers"][0]["recognizer"]["alarm"] = serde_json::json!({ "accumulator": "gone" });
            assert_eq!(later.load(&SavedState::new(&damaged)).is_err(), looking == ALARMING);
            whole.init(&frames[0].image, INIT).expect("a box in the picture");
            let again = whole.update(&frames[1].image).expect("a picture of the first size");
            assert!(rule != RULES[1] || again.classes.contains(&1.0), "one frame, one vote: {:?}", again.classes);
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let (folder, model) = random_recogniser();
    let config = with_recogniser(&raw(POLICIES[0]), &model, RULES[2], LOOKING[4]).config().clone();
    assert_eq!(Config::parse(&config.to_toml(), "again").expect("what was written"), config);
    let base = raw(POLICIES[0]).config().to_toml();
    let refuse = |lines: &str, words: &str| {
        let text = format!("{base}\n[recogniser]\nkind = \"multi-fixation\"\n{lines}\n");
        let made = Config::parse(&text, "test").and_then(|c| c.check(&Folder::new(folder.path())));
        let error = made.expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    };
    refuse("weights = \"builtin:owls\"", "no recogniser is called builtin:owls");
    refuse("weights = \"gone.safetensors\"", "gone.safetensors");
    refuse("weights = \"m.safetensors\"\naccumulate = { forgetting = { memory = 0.5 } }", "memory");
    refuse("weights = \"m.safetensors\"\nacumulate = \"sum\"", "acumulate");
    refuse("weights = \"m.safetensors\"\npolicy = { kind = \"fixed\", u = 99 }", "policy.u");
    refuse("weights = \"m.safetensors\"\nalarm = 1", "boolean");
    std::fs::write(folder.path().join("bad.safetensors"), b"no model").expect("a writable folder");
    refuse("weights = \"bad.safetensors\"", "bad.safetensors");
    assert!(Path::new(&model).exists());
}

#[test]
fn tables_traces_and_reports_say_the_class() {
    use foveate::report::{Observer, Report, RunInfo, Table, Trace};
    let (frames, (folder, model)) = (frames(), random_recogniser());
    let (info, at) = (RunInfo::default(), |name: &str| folder.path().join(name));
    let mut observers: Vec<Box<dyn Observer>> = vec![
        Box::new(Table::create(at("track.csv")).expect("a writable folder")),
        Box::new(Trace::create(at("trace.jsonl")).expect("a writable folder")),
        Box::new(Report::create(at("report.html"), info).expect("a writable folder")),
    ];
    let mut tracker = started(&with_recogniser(&raw(POLICIES[3]), &model, RULES[0], ""), &frames);
    observers.observe(&frames[0], &[foveate::Seen::given(frames[0].image.shape(), &INIT)]).expect("room on the disk");
    let mut said = vec![];
    for frame in &frames[1..] {
        let step = tracker.update(&frame.image).expect("a picture of the first size");
        said.push((step.class.expect("a recogniser"), step.classes.to_vec()));
        observers.observe(frame, &[step]).expect("room on the disk");
    }
    observers.finish().expect("renamed");
    let read = |name: &str| std::fs::read_to_string(at(name)).expect("it was written");
    let table = read("track.csv");
    let mut lines = table.lines().map(|line| line.split(',').rev().take(2).collect::<Vec<_>>());
    assert_eq!(lines.next(), Some(vec!["class_probability", "class"]));
    assert_eq!(lines.next(), Some(vec!["", ""]), "the box was given");
    let columns = table.lines().map(|line| line.split(',').count()).collect::<std::collections::BTreeSet<_>>();
    assert_eq!(columns.len(), 1, "{columns:?}");
    for (line, ((class, p), _)) in lines.zip(&said) {
        assert_eq!((line[1].parse::<usize>(), line[0].parse::<f64>()), (Ok(*class), Ok(*p)));
    }
    for (line, (_, classes)) in read("trace.jsonl").lines().skip(1).zip(&said) {
        let line: serde_json::Value = serde_json::from_str(line).expect("an object");
        assert_eq!(line["classes"], serde_json::json!(classes));
        assert_eq!(line["own_classes"].as_array().map(Vec::len), Some(3));
        assert_eq!(line["recognition_gazes"].as_array().map(Vec::len), Some(1));
    }
    let last = said.last().expect("frames").0.0;
    let page = read("report.html");
    assert!(page.contains("\"classes\":[{") && page.contains(&format!("\"name\":\"{last}\"")));
}
