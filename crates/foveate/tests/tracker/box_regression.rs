//! Box regression moves the reported box to the target; its estimate of presence makes a target lost, and
//! resets the learned appearance. The particles follow its size and shape. Nothing else changes.

use crate::common::{INIT, frame, json, natural, truth};
use foveate::Tracker;
use foveate::config::Config;
use foveate::extend::SavedState;
use foveate::files::Folder;
use foveate::geometry::{BBox, Extent, State};
use foveate::identity::box_regression::{Answer, BoxRegression, Settings};
use foveate::scene::Image;
use std::sync::Arc;

const FRAMES: usize = 24;

fn config(settings: &[&str]) -> Config {
    let natural = natural(300).config().clone();
    settings.iter().fold(natural, |config, setting| config.set(setting).expect("a key"))
}

fn tracker(config: Config) -> Tracker {
    config.check(&Folder::here()).and_then(|blueprint| blueprint.tracker(5)).expect("parts that fit")
}

/// The reported state, and all else that follows from a frame.
fn track(settings: &[&str]) -> Vec<(State, String)> {
    let mut tracker = tracker(config(settings));
    tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
    (1..FRAMES)
        .map(|i| {
            let frame = frame(i, 3);
            let seen = tracker.update(&frame.image).expect("a picture of the first size");
            let step = &seen;
            (
                seen.state,
                format!(
                    "{:?} {:?} {:?}",
                    (step.p_lost, step.own_p_lost, step.status, step.cues),
                    step.particles,
                    step.weights
                ),
            )
        })
        .collect()
}

/// With `follow = 0` the correction is for output only.
#[test]
fn it_moves_the_reported_box_alone() {
    // P(lost) without the network.
    let alone = ["absence.weight", "early.absence", "second_opinion.absence"].map(|key| format!("confidence.{key}=0"));
    let [with, without] = ["box_regression.follow=0", "box_regression=none"].map(|last| {
        let settings: Vec<&str> = alone.iter().map(String::as_str).chain([last]).collect();
        track(&settings)
    });
    let mut moved = 0;
    for (with, without) in with.iter().zip(&without) {
        assert_eq!(with.1, without.1);
        let (report, mean) = (with.0, without.0);
        let (half_w, half_h) = mean.half(Extent::of(&INIT));
        let size = [report.log_scale - mean.log_scale, 0.5 * (report.log_aspect - mean.log_aspect)];
        let off = [(report.x - mean.x) / half_w, (report.y - mean.y) / half_h, size[0], size[1]];
        assert!(off.iter().all(|x| x.abs() <= 0.5 + 1e-9), "no farther than half a half side: {off:?}");
        assert_eq!((report.vx, report.vy, report.angle), (mean.vx, mean.vy, mean.angle));
        moved += usize::from(off != [0.0; 4]);
    }
    assert_eq!(moved, FRAMES - 1);
}

/// A sample that agrees is no certainty: the reported covariance has the network's expected errors besides.
#[test]
fn the_covariance_includes_the_expected_errors() {
    let plain =
        ["belief=1", "borders=1", "pixels=0", "lone=0", "sharp=0"].map(|of| format!("confidence.localisation.{of}"));
    let covariance = |settings: &[&str]| {
        let settings: Vec<&str> = settings.iter().copied().chain(plain.iter().map(String::as_str)).collect();
        let mut tracker = tracker(config(&settings));
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        tracker.update(&frame(1, 3).image).expect("a picture of the first size").covariance
    };
    let with = covariance(&["confidence.absence.weight=0", "box_regression.follow=0"]);
    let without = covariance(&["confidence.absence.weight=0", "box_regression=none"]);
    let (half_w, half_h) = State::of(&INIT).half(Extent::of(&INIT));
    for (i, j) in (0..7).flat_map(|i| (0..7).map(move |j| (i, j))) {
        let more = with[i][j] - without[i][j];
        let unit = [half_w, half_h, 0.0, 0.0, 1.0, 0.0, 1.0][i];
        match i == j && unit > 0.0 {
            true => assert!((0.01..0.6).contains(&(more.sqrt() / unit)), "{i}: {more}"),
            false => assert_eq!(more, 0.0, "{i}, {j}"),
        }
    }
}

/// The particles' share of the correction is no longer in the correction: the reported box stays.
#[test]
fn what_the_particles_take_leaves_the_report_as_it_is() {
    let settings = Settings { every: 3, follow: 0.3, ..Settings::default() };
    let network = Arc::new(settings.read(&Folder::here()).expect("it ships"));
    let mut boxes = BoxRegression::new(network, settings);
    let (image, extent) = (frame(0, 3).image, Extent::of(&INIT));
    boxes.init_template(&image, &State::of(&INIT), extent);
    let state = State { log_scale: 0.2, log_aspect: -0.3, ..State::of(&INIT) };
    let before = boxes.moved(&image, &state, extent, None);
    let [log_scale, log_aspect] = boxes.follow().expect("the first frame has an evaluation");
    assert!(log_scale < -0.01 && log_aspect > 0.01, "back to the true box: {log_scale}, {log_aspect}");
    let followed = State { log_scale: state.log_scale + log_scale, log_aspect: state.log_aspect + log_aspect, ..state };
    let after = boxes.moved(&image, &followed, extent, None);
    assert!((after.log_scale - before.log_scale).abs() < 1e-12 && (after.log_aspect - before.log_aspect).abs() < 1e-12);
    assert_eq!(boxes.follow(), None, "no evaluation, nothing to take");
}

/// Pictures that grow wider: the particles take the shape, which dynamics without noise of it never would.
#[test]
fn particles_follow_the_shape_of_the_target() {
    let first = frame(0, 3).image;
    let (middle, _) = INIT.centre();
    let stretched = |factor: f64| {
        let (width, height) = (first.width(), first.height());
        let mut image = Image::new(width, height, 3, vec![0; 3 * width * height]).expect("sizes agree");
        for plane in 0..3 {
            for (i, value) in image.plane_mut(plane).iter_mut().enumerate() {
                let from = (middle + ((i % width) as f64 - middle) / factor).round();
                *value = first.plane(plane)[i / width * width + from.clamp(0.0, width as f64 - 1.0) as usize];
            }
        }
        image
    };
    let end = |settings: &[&str]| {
        let mut tracker = tracker(config(settings));
        tracker.init(&first, INIT).expect("a box in the picture");
        let mut shape = 0.0;
        for i in 1..=60 {
            let image = stretched(1.0 + 0.01 * f64::from(i.min(50)));
            let seen = tracker.update(&image).expect("a picture of the first size");
            shape = seen.particles.iter().map(|state| state.log_aspect).sum::<f64>() / seen.particles.len() as f64;
        }
        shape
    };
    let wanted = 1.5f64.ln();
    let (followed, kept) = (end(&[]), end(&["box_regression.follow=0"]));
    assert!((0.35 * wanted..1.3 * wanted).contains(&followed), "{followed} of {wanted}");
    assert!(kept.abs() < 1e-12);
}

/// If the box regression alone reports that the target is absent, the tracker learns nothing, reports occluded, and resets the appearance it
/// learned before, which may have been something else.
#[test]
fn a_target_that_is_not_there_is_lost_and_what_was_learned_is_forgotten() {
    let learned =
        |tracker: &Tracker| json(&tracker.save())["ensemble"]["trackers"][0]["appearance"]["discriminant"].clone();
    let start = |settings: &[&str]| {
        let mut tracker = tracker(config(settings));
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        tracker
    };
    let run = |tracker: &mut Tracker, frames: std::ops::Range<usize>| {
        let update = |i| !tracker.update(&frame(i, 3).image).expect("a picture of the first size").is_usable();
        frames.map(update).last().expect("a frame")
    };
    let mut tracked = start(&[]);
    let first = learned(&tracked);
    assert!(!run(&mut tracked, 1..9), "it is there");
    assert_ne!(learned(&tracked), first);
    // Log odds of -6 and more count as 18 then.
    let gone = ["confidence.absence.weight=1", "confidence.absence.bias=24"];
    let mut misled = start(&gone);
    // A state loads only into a tracker of its own settings; this one is given those of the other.
    let mut saved = json(&tracked.save());
    saved["origin"] = json(&misled.save())["origin"].clone();
    misled.load(&SavedState::new(&saved)).expect("the same parts");
    // The status follows from P(lost) at once; the search begins two frames later.
    assert!(run(&mut misled, 9..10));
    assert_eq!(learned(&misled), learned(&tracked), "what is doubted is not learned");
    assert!(run(&mut misled, 10..12));
    assert_eq!(learned(&misled), first, "what was learned is forgotten");
}

/// A network from elsewhere may return any numbers.
#[test]
fn answers_that_are_no_numbers_move_nothing() {
    let settings = Settings { every: 1, ..Settings::default() };
    let network = Arc::new(settings.read(&Folder::here()).expect("it ships"));
    let mut boxes = BoxRegression::new(network, settings);
    let (image, state, extent) = (frame(0, 3).image, State::of(&INIT), Extent::of(&INIT));
    boxes.init_template(&image, &state, extent);
    let answer = boxes.answer(&image, &state, extent);
    for odd in [
        Answer { offset: [f32::NAN, 0.0], ..answer },
        Answer { log_scale: f32::INFINITY, ..answer },
        Answer { half_log_aspect: f32::NAN, ..answer },
        Answer { lost: f32::NAN, ..answer },
    ] {
        let message = boxes.moved(&image, &state, extent, Some(odd));
        assert!(message.to_array().iter().all(|x| x.is_finite()), "{odd:?}: {message:?}");
    }
}

/// The network that ships, on pictures that it was not trained on: boxes that are 0.3 half sides off, or a quarter too large or small.
#[test]
fn it_says_where_the_target_is() {
    let settings = Settings::default();
    let network = Arc::new(settings.read(&Folder::here()).expect("it ships"));
    let mut boxes = BoxRegression::new(network, settings);
    let extent = Extent::of(&INIT);
    boxes.init_template(&frame(0, 3).image, &State::of(&INIT), extent);
    let (mut erred, mut stayed) = (0.0, 0.0);
    for i in 1..FRAMES {
        let (image, truth) = (frame(i, 3).image, State::of(&truth(i)));
        for [u, v, s] in
            [[0.3, 0.0, 0.0], [-0.3, 0.1, 0.0], [0.0, 0.3, 0.0], [0.1, -0.3, 0.0], [0.0, 0.0, 0.22], [0.0, 0.0, -0.22]]
        {
            let size = f64::exp(s);
            let at = State {
                x: truth.x + u * size * extent.half_w,
                y: truth.y + v * size * extent.half_h,
                log_scale: s,
                ..truth
            };
            let said = boxes.answer(&image, &at, extent);
            let ([x, y], z) = (said.offset.map(f64::from), f64::from(said.log_scale));
            erred += (x + u).abs() + (y + v).abs() + (z + s).abs();
            stayed += u.abs() + v.abs() + s.abs();
            assert!(said.lost < 0.0, "the target is there: {said:?}");
        }
    }
    assert!(erred < 0.5 * stayed, "it errs by {erred}, staying by {stayed}");
    let far = State { x: 95.0, y: 12.0, ..State::of(&INIT) };
    assert!(boxes.answer(&frame(1, 3).image, &far, extent).lost > 0.0, "nothing is there");
}

/// With other pictures in between, the last picture does not matter.
#[test]
fn an_answer_depends_on_its_picture_alone() {
    let settings = Settings::default();
    let network = Arc::new(settings.read(&Folder::here()).expect("it ships"));
    let new = || {
        let mut boxes = BoxRegression::new(network.clone(), Settings::default());
        boxes.init_template(&frame(0, 1).image, &State::of(&INIT), Extent::of(&INIT));
        boxes
    };
    let answer = |boxes: &mut BoxRegression, i: usize, w: f64, h: f64| {
        let bbox = BBox { w, h, ..truth(i) };
        boxes.answer(&frame(i, 1).image, &State::of(&bbox), Extent::of(&bbox))
    };
    let (mut one, mut other) = (new(), new());
    let first = answer(&mut one, 4, 24.0, 20.0);
    for (w, h) in [(3.0, 90.0), (300.0, 200.0), (24.0, 20.0)] {
        let _ = answer(&mut other, 7, w, h);
    }
    assert_eq!(first, answer(&mut other, 4, 24.0, 20.0));
}

#[test]
fn what_does_not_fit_is_refused() {
    let refused = |settings: &[&str]| {
        let config = settings.iter().try_fold(config(&["second_opinion=none"]), |config, setting| config.set(setting));
        config.and_then(|config| config.check(&Folder::here())).map(|_| ()).expect_err("refused").to_string()
    };
    for (setting, said) in [
        ("box_regression.rate=1.5", "box_regression.rate"),
        ("box_regression.every=0", "box_regression.every"),
        ("box_regression.rate=0", "box_regression.rate"),
        ("box_regression.weights=builtin:boxes", "builtin:natural-boxes"),
        ("box_regression.weights=nowhere.json", "nowhere.json"),
    ] {
        let error = refused(&[setting]);
        assert!(error.contains(said), "{setting}: {error}");
    }
    let start = |config: Config| {
        let mut tracker = tracker(config);
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        tracker
    };
    let saved = start(config(&["box_regression=none"])).save();
    let error = start(config(&[])).load(&saved).expect_err("nothing to find").to_string();
    assert!(error.contains("box_regression is not set in the state"), "{error}");
    for (key, value, said) in [
        ("template", serde_json::json!("AAAAAA=="), "2048 features"),
        (
            "correction",
            serde_json::json!({ "frames": 1, "mean": [0.0, 7.0, 0.0, 0.0], "errors": [0.0, 0.0, 0.0, 0.0] }),
            "it moves the box",
        ),
        ("histograms", serde_json::json!({ "first": "", "recent": "" }), "histograms"),
    ] {
        let mut saved = json(&start(config(&[])).save());
        saved["ensemble"]["trackers"][0]["box_regression"][key] = value;
        let error = start(config(&[])).load(&SavedState::new(&saved)).expect_err("damaged").to_string();
        assert!(error.contains(said), "{error}");
    }
}
