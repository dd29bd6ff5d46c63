//! Many targets: identities through crossings, initiation, termination, re-identification, and targets far away that change
//! nothing.

use crate::common::json;
use foveate::files::Folder;

use foveate::Seen;
use foveate::config::Config;
use foveate::control::CameraMotion;
use foveate::extend::SavedState;
use foveate::geometry::BBox;
use foveate::multi::{MultiTracker, Phase};
use foveate::rng::{Purpose, Streams};
use foveate::scene::{Detection, Image};
use rand::RngExt;

const W: usize = 240;
const H: usize = 120;
const SIDE: usize = 24;

fn tracker(seed: u64) -> MultiTracker {
    let config = Config::builtin("multi").expect("it ships with the library").expect("it is right");
    let config = Config { particles: 300, ..config };
    config.check(&Folder::here()).expect("parts that fit").multi_tracker(seed).expect("trackers")
}

fn at(x: f64, y: f64) -> BBox {
    BBox { x, y, w: SIDE as f64, h: SIDE as f64 }
}

/// Squares of 24 px, each with a pattern named by its number, over a faint pattern; the last ones are in front.
fn picture(squares: &[(u64, BBox)]) -> Image {
    let mut ground = Streams::new(7, 0).at(0, Purpose::Scene).rng(0);
    let coarse: Vec<u8> = (0..60 * 30).map(|_| ground.random_range(90..130)).collect();
    let mut pixels: Vec<u8> = (0..W * H).map(|k| coarse[k / W / 4 * 60 + k % W / 4]).collect();
    for (name, b) in squares {
        let mut rng = Streams::new(8, *name).at(0, Purpose::Scene).rng(0);
        let look: Vec<u8> = (0..36).map(|_| rng.random()).collect();
        for (v, u) in (0..SIDE).flat_map(|v| (0..SIDE).map(move |u| (v, u))) {
            let (x, y) = (b.x as isize + u as isize, b.y as isize + v as isize);
            if (0..W as isize).contains(&x) && (0..H as isize).contains(&y) {
                pixels[y as usize * W + x as usize] = look[v / 4 * 6 + u / 4];
            }
        }
    }
    Image::new(W, H, 1, pixels).expect("a byte a pixel")
}

fn found(b: BBox) -> Detection {
    Detection::new(b, 1.0)
}

fn off(seen: &Seen<'_>, b: &BBox) -> f64 {
    (seen.bbox.centre().0 - b.centre().0).hypot(seen.bbox.centre().1 - b.centre().1)
}

/// Where two squares are that pass each other at half their height, the second one in front.
fn passing(t: usize) -> [(u64, BBox); 2] {
    let t = t as f64;
    [(1, at(20.0 + 3.0 * t, 40.0)), (2, at(190.0 - 3.0 * t, 48.0))]
}

#[test]
fn two_that_cross_keep_their_ids() {
    // Five seeds, all of which must keep both ids; without boxes after the first, and with detections of both where both
    // are in view.
    for (seed, detected) in [(1, false), (2, false), (3, false), (4, true), (5, true)] {
        let mut tracker = tracker(seed);
        let mut hidden = 0;
        for t in 0..56usize {
            let squares = passing(t);
            let apart = squares[0].1.intersection(&squares[1].1) == 0.0;
            let detections: Vec<_> = squares.iter().map(|s| found(s.1)).collect();
            let detections = if detected && apart { &detections[..] } else { &[] };
            tracker.update(&picture(&squares), detections).expect("a picture of the first size");
            if t == 0 {
                for (id, b) in squares {
                    tracker.add(&picture(&squares), Some(id), b).expect("a box in the picture");
                }
            }
            hidden += tracker.targets().iter().filter(|s| s.visible < 0.5).count();
        }
        assert_eq!(tracker.targets().iter().map(|s| s.id).collect::<Vec<_>>(), [1, 2], "seed {seed}");
        for (seen, (id, b)) in tracker.targets().iter().zip(passing(55)) {
            assert!(off(seen, &b) < 5.0, "seed {seed}: {id} is {:.1} px off", off(seen, &b));
        }
        assert!(hidden > 0, "seed {seed}: nobody hides");
    }
}

/// A square comes in frame 5, leaves at 40 and is back at 60; detected whenever it is there, and noise now and then.
fn visits(t: usize) -> (Vec<(u64, BBox)>, Vec<Detection>) {
    let place = match t {
        5..40 => Some(at(10.0 + 2.0 * t as f64, 30.0)),
        60.. => Some(at(200.0 - 2.0 * (t - 60) as f64, 70.0)),
        _ => None,
    };
    let squares: Vec<_> = place.into_iter().map(|b| (9, b)).collect();
    let mut detections: Vec<_> = squares.iter().map(|s| found(s.1)).collect();
    if t.is_multiple_of(11) {
        detections.push(found(at((37 * t % 200) as f64, 5.0)));
    }
    (squares, detections)
}

#[test]
fn who_comes_is_initiated_who_leaves_is_terminated_and_who_returns_is_reidentified() {
    let mut tracker = tracker(1);
    let mut phases = vec![];
    for t in 0..80usize {
        let (squares, detections) = visits(t);
        let seen = tracker.update(&picture(&squares), &detections).expect("a picture of the first size");
        assert!(seen.len() <= 1, "frame {t}: noise is nobody: {seen:?}");
        phases.extend(
            seen.iter().map(|s| (t, s.id, s.phase)).filter(|p| matches!(p.2, Phase::Initiated | Phase::ReIdentified)),
        );
        if let (Some(seen), [(_, b)]) = (seen.first(), &squares[..]) {
            assert!(off(seen, b) < 6.0, "frame {t}: {:.1} px off", off(seen, b));
        }
        if t == 59 {
            assert!(tracker.targets().is_empty(), "it is gone: {:?}", tracker.targets());
        }
    }
    assert_eq!(phases, [(7, 1, Phase::Initiated), (62, 1, Phase::ReIdentified)]);
}

/// An id leaves room for ids derived from it, and a policy that needs the whole first picture is one target's.
#[test]
fn what_many_targets_cannot_have_is_refused() {
    let picture = picture(&[]);
    let mut tracker = tracker(1);
    let said = tracker.add(&picture, Some(u64::MAX), at(20.0, 20.0)).expect_err("too large").to_string();
    assert!(said.contains("9223372036854775808"), "{said}");
    assert_eq!(tracker.add(&picture, Some(7), at(20.0, 20.0)).expect("a box in the picture"), 7);
    for policy in ["policy.kind=explore-then-commit", "policy={ kind = \"fixed\", u = 0.3 }"] {
        let config = Config::builtin("multi").expect("it ships").and_then(|config| config.set(policy)).expect("fits");
        let said = MultiTracker::new(&config).expect_err("it settles elsewhere").to_string();
        assert!(said.contains("policy") && said.contains("whole first picture"), "{said}");
    }
}

#[test]
fn a_cut_is_the_end_and_boxes_that_are_none_are_refused() {
    let mut tracker = tracker(1);
    let first = picture(&passing(0));
    tracker.update(&first, &[]).expect("the first picture");
    assert_eq!(tracker.add(&first, Some(5), passing(0)[0].1).expect("a box"), 5);
    assert_eq!(tracker.add(&first, None, passing(0)[1].1).expect("a box"), 6);
    assert_eq!(tracker.add(&first, Some(5), at(50.0, 50.0)).expect("it starts again"), 5);
    assert_eq!(tracker.targets().len(), 2);
    for bad in [BBox { w: 0.0, ..at(1.0, 1.0) }, BBox { x: f64::NAN, ..at(1.0, 1.0) }, at(500.0, 1.0)] {
        assert!(tracker.add(&first, None, bad).is_err(), "{bad:?}");
    }
    // Detections outside the picture belong to no target; an error names invalid boxes, and nothing changes.
    tracker.update(&first, &[found(at(500.0, 1.0)); 4]).expect("a picture of the first size");
    let before = tracker.save();
    for (bad, said) in [
        (BBox { w: 0.0, ..at(1.0, 1.0) }, "detection 1 (from 0): width is 0"),
        (BBox { h: -24.0, ..at(1.0, 1.0) }, "detection 1 (from 0): height is -24"),
        (BBox { x: f64::NAN, ..at(1.0, 1.0) }, "detection 1 (from 0): left is NaN"),
    ] {
        let error = tracker.update(&first, &[found(at(1.0, 1.0)), found(bad)]).expect_err("no box").to_string();
        assert!(error.contains(said), "{error}");
    }
    assert_eq!(tracker.save(), before);
    let has = |id| tracker.targets().iter().any(|target| target.id == id);
    assert!(has(5) && !has(7));
    tracker.cut();
    assert!(tracker.targets().is_empty());
}

/// All that is known of one target, frame by frame.
fn life(id: u64, seed: u64, others: &[(u64, BBox)]) -> Vec<Seen<'_>> {
    let mut tracker = tracker(seed);
    let mut life = vec![];
    for t in 0..25usize {
        let mut squares = vec![(3, at(10.0 + 2.0 * t as f64, 80.0))];
        squares.extend_from_slice(others);
        let detections: Vec<_> = squares.iter().filter(|_| !t.is_multiple_of(3)).map(|s| found(s.1)).collect();
        let picture = picture(&squares);
        tracker.update(&picture, &detections).expect("a picture of the first size");
        if t == 0 {
            squares.iter().for_each(|(id, b)| assert_eq!(tracker.add(&picture, Some(*id), *b).expect("a box"), *id));
        }
        life.extend(tracker.targets().iter().filter(|s| s.id == id));
    }
    life
}

#[test]
fn others_far_away_and_threads_change_no_bit() {
    let others = [(1, at(20.0, 8.0)), (8, at(180.0, 12.0)), (9, at(120.0, 20.0))];
    // The picture is the same: the others are drawn, but not followed in the first run.
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
    let together = pool(1).install(|| life(3, 5, &others));
    assert_eq!(pool(4).install(|| life(3, 5, &others)), together);
    assert_ne!(life(3, 6, &others), together, "another seed is another track");
    let mut alone = tracker(5);
    let mut seen = vec![];
    for t in 0..25usize {
        let own = at(10.0 + 2.0 * t as f64, 80.0);
        let mut squares = vec![(3, own)];
        squares.extend_from_slice(&others);
        let (picture, detections) = (picture(&squares), [found(own)]);
        let detections = if t.is_multiple_of(3) { &[] } else { &detections[..] };
        alone.update(&picture, detections).expect("a picture of the first size");
        if t == 0 {
            alone.add(&picture, Some(3), own).expect("a box");
        }
        seen.extend_from_slice(alone.targets());
    }
    assert_eq!(seen, together);
}

#[test]
fn saved_targets_go_on_bit_for_bit() {
    let mut one = tracker(2);
    for t in 0..45 {
        let (squares, detections) = visits(t);
        one.update(&picture(&squares), &detections).expect("a picture of the first size");
    }
    let saved = one.save();
    let text = serde_json::to_string(&saved).expect("JSON");
    let mut two = tracker(2);
    two.load(&serde_json::from_str(&text).expect("JSON")).expect("it was saved");
    two.skip(&picture(&visits(44).0)); // camera motion compares pictures, and is not saved
    for t in 45..80 {
        let (squares, detections) = visits(t);
        let picture = picture(&squares);
        let [one, two] = [&mut one, &mut two].map(|tracker| tracker.update(&picture, &detections).expect("a picture"));
        assert_eq!(one, two, "frame {t}");
    }
    assert!(tracker(2).load(&SavedState::new(&serde_json::json!({ "format": 99 }))).is_err());
    let mut damaged = json(&saved);
    damaged["active"][0]["track"]["covariance"][0][0] = serde_json::json!(-25.0);
    let error = tracker(2).load(&SavedState::new(&damaged)).expect_err("no variance").to_string();
    assert!(error.contains("less than 0"), "{error}");
}

#[test]
fn saved_frame_numbers_that_cannot_be_are_refused() {
    let mut one = tracker(1);
    for t in 0..12 {
        let (squares, detections) = visits(t);
        one.update(&picture(&squares), &detections).expect("a picture of the first size");
    }
    let saved = one.save();
    for (key, value, said) in [
        ("/next", 1u64 << 60, "`next` is frame 1152921504606846976; expected a number up to 2147483648"),
        ("/active/0/track/born", 13, "`born` of target 1 is frame 13; expected one up to `next`, 12"),
        ("/active/0/terminated", 99, "`terminated` of target 1 is frame 99"),
        ("/active/0/unseen", u64::MAX, "target 1 was unseen for 18446744073709551615 frames"),
        ("/tentative/candidates/0/last", 1u64 << 60, "expected first <= last <= `next`, 12"),
        ("/tentative/candidates/0/hits", 0, "0 detections"),
    ] {
        let mut damaged = json(&saved);
        *damaged.pointer_mut(key).unwrap_or_else(|| panic!("{key} in {saved}")) = value.into();
        let said_instead = tracker(1).load(&SavedState::new(&damaged)).expect_err(key).to_string();
        assert!(said_instead.contains(said), "{key}: {said_instead}");
    }
    tracker(1).load(&saved).expect("undamaged");
}

/// A camera that shakes by up to 20 px a frame before two that cross: ids are kept, boxes stay. Seeds 1 to 3, all must.
#[test]
fn ids_are_kept_before_a_shaking_camera() {
    for seed in 1..=3 {
        let mut tracker = tracker(seed);
        let mut ids = vec![];
        for t in 0..56usize {
            let mut rng = Streams::new(seed, 9).at(t as u64, Purpose::Scene).rng(0);
            let (dx, dy) = (rng.random_range(0..=10usize), rng.random_range(0..=10usize));
            let squares = passing(t);
            let whole = picture(&squares);
            let (w, h) = (W - 10, H - 10);
            let row = |y: usize| &whole.plane(0)[(y + dy) * W + dx..(y + dy) * W + dx + w];
            let window = Image::new(w, h, 1, (0..h).flat_map(row).copied().collect()).expect("a byte a pixel");
            let moved = |b: &BBox| BBox { x: b.x - dx as f64, y: b.y - dy as f64, ..*b };
            let apart = squares[0].1.intersection(&squares[1].1) == 0.0;
            let found: Vec<_> = squares.iter().filter(|_| apart).map(|s| found(moved(&s.1))).collect();
            tracker.update(&window, &found).expect("a picture of the first size");
            if t >= 2 {
                ids.extend(tracker.targets().iter().map(|s| s.id));
            }
            if t == 55 {
                for (seen, square) in tracker.targets().iter().zip(&squares) {
                    assert!(off(seen, &moved(&square.1)) < 5.0, "seed {seed}: {seen:?}");
                }
            }
        }
        assert_eq!((ids.len(), ids.iter().max()), (2 * 54, Some(&2)), "seed {seed}: {ids:?}");
    }
}

/// With camera motion, which needs the last picture again. One that is skipped after it counts.
#[test]
fn the_picture_shown_again_after_loading_is_not_counted_twice() {
    let config = Config::builtin("multi").expect("it ships with the library").expect("it is right");
    let config = Config { particles: 100, camera_motion: Some(CameraMotion::default()), ..config };
    let blueprint = config.check(&Folder::here()).expect("parts that fit");
    let run = |tracker: &mut MultiTracker, frames: std::ops::Range<usize>| -> Vec<Seen<'_>> {
        let step = |t| {
            let (squares, detections) = visits(t);
            tracker.update(&picture(&squares), &detections).expect("a picture of the first size").to_vec()
        };
        frames.flat_map(step).collect()
    };
    for pause in [3, 19] {
        let mut whole = blueprint.multi_tracker(2).expect("trackers");
        run(&mut whole, 0..pause);
        let mut resumed = blueprint.multi_tracker(2).expect("trackers");
        resumed.load(&whole.save()).expect("it was saved");
        resumed.skip(&picture(&visits(pause - 1).0));
        let missed = picture(&visits(pause).0);
        whole.skip(&missed);
        resumed.skip(&missed);
        let (one, two) = (run(&mut whole, pause + 1..25), run(&mut resumed, pause + 1..25));
        assert_eq!(one, two, "paused before frame {pause}");
        assert!(one.iter().all(|target| target.born == 7) && one.len() >= 5, "{one:?}");
    }
    // Before the first update they count.
    let mut late = blueprint.multi_tracker(2).expect("trackers");
    (0..5).for_each(|t| late.skip(&picture(&visits(t).0)));
    assert_eq!(run(&mut late, 5..8).last().map(|target| target.born), Some(7));
}

/// Boxes in every fifth frame: a track starts from the third, is followed by its looks in between, and ends when these find nothing for
/// ten frames.
#[test]
fn frames_without_a_detector_are_bridged() {
    let base = || Config::builtin("multi").expect("it ships with the library").expect("it is right");
    let config = ["particles=300", "multi_target.every=5"];
    let config = config.iter().fold(base(), |config, setting| config.set(setting).expect("a key"));
    let mut tracker = config.check(&Folder::here()).expect("parts that fit").multi_tracker(1).expect("trackers");
    let place = |t: usize| at(20.0 + 2.0 * t as f64, 40.0);
    for t in 0..60 {
        let image = picture(&[(1, place(t))][..usize::from(t <= 30)]);
        let detections = if t <= 30 && t % 5 == 0 { vec![found(place(t))] } else { vec![] };
        tracker.update(&image, &detections).expect("a picture of the first size");
        let targets = tracker.targets();
        assert_eq!(targets.len(), usize::from((10..40).contains(&t)), "frame {t}");
        if (10..=30).contains(&t) {
            assert!(off(&targets[0], &place(t)) < 2.0, "frame {t}: {:?}", targets[0].bbox);
            assert!(t == 10 || targets[0].phase == Phase::Tracked, "frame {t}: {:?}", targets[0].phase);
        }
    }
}

/// Two that were given boxes cross, and one overtakes the other and hides it: of different looks, or of the same. Nobody is given up, and
/// the two boxes do not end on one of them. Of the same looks one that was hidden for long may come out as the other.
#[test]
fn two_given_boxes_do_not_end_on_one_target() {
    type Paths = fn(f64) -> [BBox; 2];
    let cross: Paths = |t| [at(20.0 + 2.0 * t, 12.0 + 0.8 * t), at(20.0 + 2.0 * t, 84.0 - 0.8 * t)];
    let head_on: Paths = |t| [at(10.0 + 2.2 * t, 44.0), at(205.0 - 2.2 * t, 50.0)];
    let overtake: Paths = |t| [at(20.0 + 1.7 * t, 40.0), at(65.0 + 0.7 * t, 46.0)];
    for (path, swaps) in [(cross, false), (head_on, false), (overtake, true)] {
        for (seed, looks) in [(1, [1, 2]), (2, [3, 4]), (3, [5, 5]), (4, [6, 6])] {
            let mut tracker = MultiTracker::new(Config { seed, ..builtin("multi-boxes") }).expect("parts that fit");
            for t in 0..90 {
                let [a, b] = path(t as f64);
                let image = picture(&[(looks[1], b), (looks[0], a)]);
                tracker.update(&image, &[]).expect("a picture of the first size");
                if t == 0 {
                    [a, b].into_iter().for_each(|b| assert!(tracker.add(&image, None, b).is_ok()));
                }
            }
            let ([a, b], targets) = (path(89.0), tracker.targets());
            assert_eq!(targets.iter().map(|t| t.id).collect::<Vec<_>>(), [1, 2], "looks {looks:?}: one is given up");
            let ends = |a: &BBox, b: &BBox| off(&targets[0], a).max(off(&targets[1], b));
            let swapped = if swaps && looks[0] == looks[1] { ends(&b, &a) } else { f64::INFINITY };
            assert!(ends(&a, &b).min(swapped) < 5.0, "looks {looks:?} end at {targets:?}, not at {a:?} and {b:?}");
        }
    }
}

fn builtin(name: &str) -> Config {
    Config::builtin(name).expect("it ships with the library").expect("it is right")
}

/// The detection that was assigned to a target, and its class, which stays in frames without one.
#[test]
fn a_target_names_its_detection_and_class() {
    let mut tracker = tracker(1);
    let places = |t: usize| [at(10.0 + 2.0 * t as f64, 30.0), at(200.0 - 2.0 * t as f64, 70.0)];
    for t in 0..12 {
        let [a, b] = places(t);
        let of = |b: BBox, class, score| Detection { class: Some(class), score, ..found(b) };
        // The order changes from frame to frame, and there is noise in front.
        let mut all = vec![of(at((50 * t % 200) as f64, 2.0), 9, 0.5), of(a, 4, 0.9), of(b, 6, 0.8)];
        if t % 2 == 1 {
            all.swap(1, 2);
        }
        let all = if t == 11 { vec![] } else { all };
        let seen = tracker.update(&picture(&[(1, a), (2, b)]), &all).expect("a picture of the first size");
        if t < 2 {
            continue;
        }
        assert_eq!(seen.len(), 2, "frame {t}: {seen:?}");
        for target in seen {
            let (place, class) = if off(target, &a) < 6.0 { (a, 4) } else { (b, 6) };
            let index = all.iter().position(|d| d.bbox == place);
            assert_eq!((target.detection_index, target.detected_class), (index, Some(class)), "frame {t}");
            assert_eq!(target.detection, index.map(|k| all[k]), "frame {t}");
        }
    }
}

/// A target that is not to be seen becomes a guess: `update` leaves it out, `targets` has it.
#[test]
fn guesses_are_no_results() {
    let mut tracker = tracker(1);
    let mut guesses = 0;
    for t in 0..30 {
        let here: Vec<_> = (t < 12).then(|| at(60.0 + 2.0 * t as f64, 40.0)).into_iter().collect();
        let squares: Vec<_> = here.iter().map(|b| (1, *b)).collect();
        let detections: Vec<_> = here.iter().map(|b| found(*b)).collect();
        let results = tracker.update(&picture(&squares), &detections).expect("a picture of the first size").to_vec();
        assert!(results.iter().all(|target| target.phase != Phase::Lost && (0.0..=1.0).contains(&target.p_lost)));
        let sure: Vec<_> = tracker.targets().iter().filter(|target| target.is_usable()).copied().collect();
        assert_eq!(results, sure, "frame {t}");
        guesses += tracker.targets().len() - results.len();
    }
    assert!(guesses > 5, "{guesses}");
}

#[test]
fn a_target_is_found_by_its_id_and_removed_for_good() {
    let mut tracker = tracker(1);
    for t in 0..10 {
        let squares = passing(t);
        tracker.update(&picture(&squares), &squares.map(|s| found(s.1))).expect("a picture of the first size");
    }
    let place = tracker.target(2).expect("it is active").bbox;
    assert!(tracker.target(7).is_none());
    assert!(tracker.remove(2) && !tracker.remove(2) && !tracker.remove(7));
    assert!(tracker.target(2).is_none() && tracker.targets().len() == 1);
    // A detection there starts a new track, which is not compared with it.
    for t in 10..20 {
        let squares = passing(t);
        tracker.update(&picture(&squares), &squares.map(|s| found(s.1))).expect("a picture of the first size");
    }
    let ids: Vec<u64> = tracker.targets().iter().map(|target| target.id).collect();
    assert!(ids == [1, 3] && place.x > 100.0, "{ids:?}");
}

/// Beside a target lies a box that covers half of it, as weak boxes of a detector do. Without scores it starts no track, as with low ones.
#[test]
fn detections_without_scores_start_no_track_beside_a_target() {
    for scores in [[0.9, 0.1], [f64::NAN; 2], [1.0; 2]] {
        let mut tracker = tracker(1);
        for t in 0..20 {
            let [(_, a), (_, b)] = passing(0).map(|(k, b)| (k, BBox { x: b.x + t as f64, ..b }));
            let beside = |b: BBox| BBox { x: b.x + 6.0, y: b.y - 6.0, ..b };
            let [sure, unsure] = scores.map(|score| move |bbox| Detection { score, ..found(bbox) });
            let all = [sure(a), sure(b), unsure(beside(a))];
            tracker.update(&picture(&[(1, a), (2, b)]), &all).expect("a picture of the first size");
        }
        assert_eq!(tracker.targets().len(), 2, "scores {scores:?}: {:?}", tracker.targets());
    }
}
