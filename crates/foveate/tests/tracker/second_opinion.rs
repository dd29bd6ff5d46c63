//! The second tracker changes the reported P(lost), and no box where no box regression is followed.

use crate::common::{INIT, frame, natural};
use foveate::Tracker;
use foveate::config::Config;
use foveate::control::{ABSENCE, AGREEMENT, ConfidenceModel, Cues, EarlyWeights, LEAP};
use foveate::files::Folder;
use foveate::geometry::BBox;

const FRAMES: usize = 24;
const SEED: u64 = 5;

/// Boxes, P(lost), and its cues.
fn track(mut tracker: Tracker) -> Vec<(BBox, f64, Cues)> {
    tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
    (1..FRAMES)
        .map(|i| {
            let frame = frame(i, 3);
            let seen = tracker.update(&frame.image).expect("a picture of the first size");
            (seen.bbox, seen.p_lost, seen.cues)
        })
        .collect()
}

/// The configuration of a pair of few particles, without the bound of the first frames, which hides the second opinion.
fn pair() -> Config {
    let config = natural(300).config().clone();
    let confidence = ConfidenceModel { early: EarlyWeights::default(), ..config.confidence };
    Config { box_regression: None, confidence, ..config }
}

fn tracker(config: Config) -> Tracker {
    config.check(&Folder::here()).and_then(|blueprint| blueprint.tracker(SEED)).expect("parts that fit")
}

/// Tracked alone with its own randomness, the second answers the same boxes; their overlap with the first's, smoothed, is the cue.
#[test]
fn it_says_what_it_would_say_alone() {
    let first = pair();
    let name = first.second_opinion.clone().expect("it has one");
    let name = name.strip_prefix("builtin:").expect("it ships").to_owned();
    let second = Config::builtin(&name).expect("it ships").and_then(|c| c.check(&Folder::here())).expect("it is right");
    let both = track(tracker(first));
    let alone = track(second.tracker_of(SEED, 1 << 63).expect("parts that fit"));
    let mut smoothed = both[0].0.iou(&alone[0].0);
    for ((a, _, cues), (b, _, alone)) in both.iter().zip(&alone) {
        smoothed += 0.2 * (a.iou(b) - smoothed);
        let (agreement, silent) = (cues[AGREEMENT], alone[AGREEMENT]);
        assert!((smoothed - agreement).abs() < 1e-12, "{a:?} {b:?}: {smoothed} {agreement}");
        assert_eq!(silent, -1.0, "without a second opinion there is no agreement");
    }
    assert!(smoothed > 0.6, "both are on the target: {smoothed}");
}

/// Without it the boxes are the same bit for bit, and P(lost) is that of the tracker's own cues.
#[test]
fn it_changes_p_lost_and_nothing_else() {
    let model = pair().confidence.second_opinion;
    let (pair, alone) = (track(tracker(pair())), track(tracker(Config { second_opinion: None, ..pair() })));
    for ((bbox, p_lost, cues), (same, own, _)) in pair.iter().zip(&alone) {
        assert_eq!(bbox, same);
        let odds = |p: f64| (p / (1.0 - p)).ln();
        let weighed = model.agreement * cues[AGREEMENT] + model.leap * cues[LEAP] + model.absence * cues[ABSENCE];
        let expected = model.own * odds(*own) + weighed + model.bias;
        assert!((odds(*p_lost) - expected).abs() < 1e-9, "{p_lost} of {own} and {cues:?}");
    }
    assert!(pair.iter().zip(&alone).any(|(a, b)| a.1 != b.1));
}

/// What either reads of a picture is counted, once.
#[test]
fn what_it_reads_is_counted() {
    let reads = |settings: &[&str]| {
        let config = Config::builtin("natural-middle").expect("it ships");
        let config = settings.iter().fold(config, |config, setting| config.and_then(|config| config.set(setting)));
        let mut tracker = tracker(config.expect("keys"));
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        let frame = frame(1, 3);
        tracker.update(&frame.image).expect("a picture of the first size").values
    };
    let (small, large) = (reads(&[]), reads(&["dynamics.position=0.5"]));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("large.toml");
    let config = Config::builtin("natural-middle").expect("it ships").and_then(|c| c.set("dynamics.position=0.5"));
    std::fs::write(&file, config.expect("a key").to_toml()).expect("room on the disk");
    let pair = reads(&[&format!("second_opinion={}", file.display())]);
    assert!(small < pair && pair < small + large, "{small} and {large} apart, {pair} together");
}

/// A pair cannot load the state of one tracker; determinism.rs tests that it continues bit for bit.
#[test]
fn half_of_a_pair_is_refused() {
    let mut alone = tracker(Config { second_opinion: None, ..pair() });
    alone.init(&frame(0, 3).image, INIT).expect("a box in the picture");
    let error = tracker(pair()).load(&alone.save()).expect_err("one of two is missing").to_string();
    assert!(error.contains("second_opinion is not set in the state and "), "{error}");
}
