//! Attention over objects: a budget of looks is kept, a target without a look follows its prediction and becomes less certain, and a budget that is enough
//! changes nothing.

#![cfg(feature = "lab")]

use foveate::MultiTracker;
use foveate::config::Config;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Multi, MultiVideo};
use foveate::scene::Image;

const TARGETS: usize = 12;

fn video() -> MultiVideo {
    let settings = Multi {
        targets: TARGETS,
        frames: 20,
        scale: [1.0, 1.0],
        turn: 0.0,
        speed: [0.2, 0.6],
        crossings: 0,
        ..Multi::default()
    };
    settings.video(&Digits::drawn(3, 2)).expect("room for all")
}

/// A tracker that was given all targets in frame 1, with a budget and a policy.
fn tracker(video: &MultiVideo, first: &Image, budget: usize, policy: &str) -> MultiTracker {
    let config = Config::builtin("digits-multi").expect("it ships").expect("it is right");
    let settings = [
        "particles=100".into(),
        format!("multi_target.attention.budget={budget}"),
        format!("multi_target.attention.policy=\"{policy}\""),
    ];
    let config = settings.iter().try_fold(config, |config, s| config.set(s)).expect("settings that are right");
    let mut tracker = MultiTracker::new(&config).expect("parts that fit");
    tracker.update(first, &[]).expect("a picture");
    for mover in video.movers() {
        tracker.add(first, None, mover.bbox(0)).expect("a box in the picture");
    }
    tracker
}

fn pictures(video: &MultiVideo) -> Vec<Image> {
    (0..video.frames()).map(|t| video.render(t)).collect()
}

#[test]
fn a_budget_is_kept_and_none_waits_for_ever() {
    let video = video();
    let pictures = pictures(&video);
    for policy in ["round-robin", "surprise"] {
        let mut tracker = tracker(&video, &pictures[0], 3, policy);
        let mut longest = 0;
        for image in &pictures[1..] {
            let targets = tracker.update(image, &[]).expect("pictures of one size");
            assert_eq!(targets.iter().filter(|t| t.waited == 0).count(), 3, "{policy}");
            longest = longest.max(targets.iter().map(|t| t.waited).max().expect("some"));
        }
        let most = if policy == "round-robin" { TARGETS / 3 - 1 } else { 15 };
        assert!(longest <= most, "{policy}: one waited for {longest} frames");
    }
}

#[test]
fn who_waits_becomes_less_certain_and_looking_helps() {
    let video = video();
    let pictures = pictures(&video);
    let mut tracker = tracker(&video, &pictures[0], 3, "round-robin");
    let mut before: Vec<f64> = vec![0.0; TARGETS];
    for image in &pictures[1..] {
        let targets = tracker.update(image, &[]).expect("pictures of one size");
        for (sd, target) in before.iter_mut().zip(targets) {
            let now = target.covariance[0][0].sqrt();
            assert!(target.waited == 0 || now > *sd, "target {} coasts from {sd} px to {now} px", target.id);
            *sd = now;
        }
    }
}

#[test]
fn a_budget_that_is_enough_changes_nothing_and_a_saved_tracker_goes_on() {
    let video = video();
    let pictures = pictures(&video);
    let boxes = |tracker: &mut MultiTracker, pictures: &[Image]| {
        let mut all = vec![];
        for image in pictures {
            all.extend(tracker.update(image, &[]).expect("pictures of one size").iter().map(|t| (t.bbox, t.waited)));
        }
        all
    };
    let all = boxes(&mut tracker(&video, &pictures[0], 0, "round-robin"), &pictures[1..]);
    assert_eq!(boxes(&mut tracker(&video, &pictures[0], TARGETS, "surprise"), &pictures[1..]), all);
    let mut one = tracker(&video, &pictures[0], 4, "surprise");
    boxes(&mut one, &pictures[1..10]);
    let mut other = tracker(&video, &pictures[0], 4, "surprise");
    other.load(&one.save()).expect("its own state");
    other.skip(&pictures[9]);
    assert_eq!(boxes(&mut other, &pictures[10..]), boxes(&mut one, &pictures[10..]));
}
