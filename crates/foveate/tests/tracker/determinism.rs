//! Nothing but seed, configuration and video changes a track: not threads, observers, other targets, or a pause.

use crate::common::{INIT, POLICIES, blueprint, frame, json, natural, truth};
use foveate::Seen;
use foveate::Tracker;
use foveate::config::{Blueprint, Config};
use foveate::extend::SavedState;
use foveate::files::Folder;
use foveate::report::{Observer, Table, Trace};
use foveate::video::Frame;

const FRAMES: usize = 14;
/// Three whole chunks and a part of one.
const PARTICLES: usize = 210;

/// All numbers of a step, as bits.
fn bits(step: &Seen<'_>) -> Vec<u64> {
    let mut all: Vec<u64> = Vec::new();
    let mut add = |values: &[f64]| all.extend(values.iter().map(|v| v.to_bits()));
    add(&step.state.to_array());
    step.covariance.iter().for_each(|row| add(row));
    add(&[step.ess, step.log_evidence, step.consistency.deficit, step.consistency.tempered_ess, step.percept.distance]);
    step.particles.iter().for_each(|state| add(&state.to_array()));
    add(step.weights);
    add(step.rewards);
    add(step.gaze_evidence);
    step.plan.gazes().iter().for_each(|g| add(&[g.u, g.v]));
    add(step.plan.weights());
    all.extend(step.ancestors.iter().map(|&a| a as u64));
    all.extend(step.percept.features.iter().chain(&step.percept.glimpse).map(|v| u64::from(v.to_bits())));
    all
}

fn frames() -> Vec<Frame> {
    (0..FRAMES).map(|i| frame(i, 1)).collect()
}

fn started(blueprint: &Blueprint, target: u64, frames: &[Frame]) -> Tracker {
    let mut tracker = blueprint.tracker_of(5, target).expect("parts that fit");
    tracker.init(&frames[0].image, INIT).expect("a box in the picture");
    tracker
}

fn go(tracker: &mut Tracker, frames: &[Frame]) -> Vec<Vec<u64>> {
    frames.iter().map(|frame| bits(&tracker.update(&frame.image).expect("a picture of the first size"))).collect()
}

fn alone(blueprint: &Blueprint, frames: &[Frame]) -> Vec<Vec<u64>> {
    go(&mut started(blueprint, 0, frames), &frames[1..])
}

/// Each policy with each encoder; every second one resamples seldom.
fn each(check: impl Fn(&str, &Blueprint)) {
    for (i, policy) in POLICIES.into_iter().enumerate() {
        for rbm in [false, true] {
            let below = if (i % 2 == 0) == rbm { 1.0 } else { 0.5 };
            let name = format!("{policy}, rbm {rbm}, resampling below {below}");
            check(&name, &blueprint(policy, rbm, below, false, PARTICLES));
        }
    }
    check("natural", &natural(PARTICLES));
    let committee = Config { committee: 3, ..natural(PARTICLES).config().clone() };
    check("natural, three that vote", &committee.check(&Folder::here()).expect("parts that fit"));
}

#[test]
fn threads_change_nothing() {
    let frames = frames();
    let pools = [1, 2, 8].map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a few threads"));
    each(|name, blueprint| {
        let [one, two, eight] = pools.each_ref().map(|pool| pool.install(|| alone(blueprint, &frames)));
        assert!(one == two && one == eight, "{name}");
        assert!(one[0] != one[1], "something happens: {name}");
    });
}

#[test]
fn observers_and_other_targets_change_nothing() {
    let (frames, folder) = (frames(), tempfile::tempdir().expect("a temporary folder"));
    let elsewhere = foveate::geometry::BBox { x: 70.0, y: 20.0, w: 18.0, h: 22.0 };
    each(|name, blueprint| {
        let plain = alone(blueprint, &frames);
        let mut observers: Vec<Box<dyn Observer>> = vec![
            Box::new(Table::create(folder.path().join("track.csv")).expect("a writable folder")),
            Box::new(Trace::create(folder.path().join("trace.jsonl")).expect("a writable folder")),
        ];
        let mut other = blueprint.tracker_of(5, 1).expect("parts that fit");
        other.init(&frames[0].image, elsewhere).expect("a box in the picture");
        let mut tracker = started(blueprint, 0, &frames);
        for (frame, plain) in frames[1..].iter().zip(&plain) {
            let step = tracker.update(&frame.image).expect("a picture of the first size");
            observers.observe(frame, &[step]).expect("room on the disk");
            assert!(bits(&step) == *plain, "{name}");
            let mut twin = bits(&other.update(&frame.image).expect("a picture of the first size"));
            twin.truncate(plain.len());
            assert!(twin != *plain, "another target has randomness of its own");
        }
        observers.finish().expect("renamed");
    });
}

#[test]
fn gazes_that_are_only_scored_change_nothing() {
    let frames = frames();
    each(|name, blueprint| {
        let far = foveate::gaze::Grid { n: 4, reach: 1.4 }.gazes();
        let mut plain = started(blueprint, 0, &frames);
        let mut shadowed = started(&blueprint.clone().shadowing(far), 0, &frames);
        for frame in &frames[1..] {
            let [a, b] = [&mut plain, &mut shadowed].map(|tracker| tracker.update(&frame.image).expect("a picture"));
            assert!(bits(&a) == bits(&b), "{name}");
            assert_eq!((b.bbox, b.recorded.len(), a.recorded.len()), (a.bbox, 16, 0), "{name}");
            assert!(b.recorded.iter().all(|reward| (0.0..=1.0).contains(reward)), "{name}");
        }
        assert_eq!(plain.save(), shadowed.save(), "{name}");
    });
}

/// The recorded rewards equal those of a policy with these gazes: in the first frame all policies weigh the same particles.
#[test]
fn recorded_rewards_are_those_of_gazes_that_are_scored() {
    let frames = frames();
    let gazes = foveate::gaze::Grid::default().gazes();
    let mut hedge = started(&blueprint(POLICIES[3], true, 1.0, false, PARTICLES), 0, &frames);
    let fixed = blueprint(POLICIES[0], true, 1.0, false, PARTICLES).shadowing(gazes.clone());
    let mut fixed = started(&fixed, 0, &frames);
    let [a, b] = [&mut hedge, &mut fixed].map(|tracker| tracker.update(&frames[1].image).expect("a picture"));
    for gaze in gazes {
        let [a, b] = [&a, &b].map(|step| step.reward_of(gaze).expect("scored or recorded"));
        assert!((a - b).abs() < 1e-5, "{gaze:?}: {a} {b}");
    }
}

#[test]
fn a_saved_tracker_goes_on_bit_for_bit() {
    let frames = frames();
    each(|name, blueprint| {
        let whole = alone(blueprint, &frames);
        for pause in [1, 2, 7] {
            let mut first = started(blueprint, 0, &frames);
            assert!(go(&mut first, &frames[1..pause]) == whole[..pause - 1], "{name}");
            let saved = first.save();
            let text = serde_json::to_string(&saved).expect("a JSON value is text");
            let mut fresh = blueprint.tracker(5).expect("parts that fit");
            fresh.load(&serde_json::from_str(&text).expect("JSON")).expect("what was saved fits");
            assert_eq!(fresh.save(), saved, "{name}");
            fresh.skip(&frames[pause - 1].image).expect("a picture in memory"); // camera motion compares pictures, and is not saved
            assert!(go(&mut fresh, &frames[pause..]) == whole[pause - 1..], "{name}, paused before frame {pause}");
        }
    });
}

/// Weights that resampling does not even out may reach −∞ and must come back from JSON.
#[test]
fn particles_without_weight_survive_a_pause() {
    let frames = frames();
    let mut config = blueprint(POLICIES[0], false, 0.0, false, PARTICLES).config().clone();
    config.likelihood.calibrate = None;
    config.likelihood.sharpness = Some(1e6);
    let blueprint = config.check(&Folder::here()).expect("a good configuration");
    let mut tracker = started(&blueprint, 0, &frames);
    go(&mut tracker, &frames[1..5]);
    let text = tracker.save().to_string();
    assert!(text.contains("null,null"), "the test needs particles without weight");
    let mut fresh = blueprint.tracker(5).expect("parts that fit");
    fresh.load(&serde_json::from_str(&text).expect("JSON")).expect("what was saved fits");
    assert!(go(&mut fresh, &frames[5..]) == go(&mut tracker, &frames[5..]));
}

#[test]
fn a_target_given_again_is_followed_from_there() {
    let frames = frames();
    each(|name, blueprint| {
        for again in [1, 6] {
            let run = || {
                let mut tracker = started(blueprint, 0, &frames);
                let mut said = go(&mut tracker, &frames[1..again]);
                tracker.init(&frames[again].image, truth(again)).expect("a box in the picture");
                said.extend(go(&mut tracker, &frames[again + 1..]));
                (tracker, said)
            };
            let ((tracker, once), (_, twice)) = (run(), run());
            assert!(once == twice, "{name}, given again in frame {again}");
            let mut tracker = tracker;
            let end = &frames[FRAMES - 1];
            let step = tracker.update(&end.image).expect("a picture of the first size");
            assert!(step.bbox.iou(&truth(FRAMES - 1)) > 0.3, "{name}: {:?} after frame {again}", step.bbox);
        }
    });
}

/// The configurations that ship for one target, of fewer particles. One with a detector continues with its learned background.
fn shipped() -> impl Iterator<Item = (&'static str, Config)> {
    Config::names().into_iter().filter_map(|name| {
        let config = Config::builtin(name).expect("it ships").expect("it is right");
        let one = config.multi_target.is_none() && config.detector.is_none();
        one.then(|| (name, Config { particles: config.particles.min(PARTICLES), ..config }))
    })
}

/// As OpenCV's trackers do: a second start equals a new tracker, whatever came before, also another video.
#[test]
fn a_second_start_is_a_fresh_one_bit_for_bit() {
    let frames = frames();
    let other: Vec<Frame> = (0..FRAMES).map(|i| frame(40 - 2 * i, 1)).collect();
    let again = |name: &str, blueprint: &Blueprint| {
        let fresh = alone(blueprint, &frames);
        let mut tracker = blueprint.tracker_of(5, 0).expect("parts that fit");
        tracker.init(&other[0].image, truth(40)).expect("a box in the picture");
        go(&mut tracker, &other[1..]);
        tracker.set_visibility(0.3);
        for _ in 0..2 {
            tracker.init(&frames[0].image, INIT).expect("a box in the picture");
            assert!(go(&mut tracker, &frames[1..]) == fresh, "{name}");
        }
    };
    each(again);
    for (name, config) in shipped() {
        again(name, &config.check(&Folder::here()).expect("it ships"));
    }
}

/// A state loads only into a tracker of its seed, target and configuration; the error names the difference.
#[test]
fn a_state_of_other_settings_is_refused_by_name() {
    let frames = frames();
    let config = natural(PARTICLES).config().clone();
    let made = |config: &Config, seed: u64, target: u64| {
        config.clone().check(&Folder::here()).expect("good").tracker_of(seed, target).expect("parts that fit")
    };
    let mut tracker = made(&config, 5, 0);
    tracker.init(&frames[0].image, INIT).expect("a box in the picture");
    let saved = tracker.save();
    made(&config, 5, 0).load(&saved).expect("its own settings");
    // The seed in force counts, not that of the file.
    made(&Config { seed: 77, ..config.clone() }, 5, 0).load(&saved).expect("its own settings");
    let refused = |mut tracker: Tracker| tracker.load(&saved).expect_err("other settings").to_string();
    for (tracker, words) in [
        (made(&config, 6, 0), "seed is 5 in the state and 6 in this tracker"),
        (made(&config, 5, 1), "target is 0 in the state and 1 in this tracker"),
    ] {
        let error = refused(tracker);
        assert!(error.contains(words) && error.contains("settings that the state was saved with"), "{error}");
    }
    for (setting, key) in [
        ("box_regression=none", "box_regression is set in the state and not set in this tracker"),
        ("variation=none", "variation is set in the state and not set in this tracker"),
        (
            "second_opinion=none",
            "second_opinion is \"builtin:natural-middle\" in the state and not set in this tracker",
        ),
        ("particles=200", "particles is 210 in the state and 200 in this tracker"),
        ("confidence.status.leave=0.2", "confidence.status.leave is 0.3 in the state and 0.2 in this tracker"),
        ("retina.colour=[]", "retina.colour is "),
        ("committee=3", "committee is "),
    ] {
        let error = refused(made(&config.set(setting).expect("a key"), 5, 0));
        assert!(error.contains(key), "{setting}: {error}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let frames = frames();
    let blueprint = blueprint(POLICIES[3], false, 1.0, false, 20);
    let saved = started(&blueprint, 0, &frames).save();
    let refuse = |key: &str, value: serde_json::Value, words: &str| {
        let mut saved = json(&saved);
        *saved.pointer_mut(key).expect("it is there") = value;
        let error =
            blueprint.tracker(5).expect("parts that fit").load(&SavedState::new(&saved)).expect_err(key).to_string();
        assert!(error.contains(words), "{error}");
    };
    refuse("/format", 99.into(), "format is 99");
    refuse(
        "/ensemble/trackers/0/filter/particles",
        serde_json::json!([]),
        "0 particles and 20 weights, this tracker has 20",
    );
    refuse("/ensemble/trackers/0/policy", serde_json::json!({ "gain": [1.0], "frames": 1 }), "9 gazes");
    refuse("/ensemble/trackers/0/appearance", serde_json::Value::Null, "without a template");
    refuse("/ensemble/trackers/0/frame", u64::MAX.into(), "frame");
    refuse("/ensemble/trackers/0/consistency", "awake".into(), "consistency");
    refuse("/shape", serde_json::Value::Null, "size of its pictures");
}
