//! Many targets: ids through crossings, births and deaths, finding again, and that nobody disturbs who is far away.

use std::path::Path;

use foveate::config::Config;
use foveate::geometry::BBox;
use foveate::many::Many;
use foveate::observe::{Phase, Seen};
use foveate::rng::{Purpose, Streams};
use foveate::scene::{Detection, Frame, Image};
use rand::RngExt;

const W: usize = 240;
const H: usize = 120;
const SIDE: usize = 24;

fn many(seed: u64) -> Many {
    let config = Config::builtin("many").expect("it ships with the library").expect("it is right");
    let config = Config { particles: 300, ..config };
    config.check(Path::new(".")).expect("parts that fit").many(seed).expect("trackers")
}

fn at(x: f64, y: f64) -> BBox {
    BBox { x, y, w: SIDE as f64, h: SIDE as f64 }
}

/// Squares of 24 px, each with a pattern named by its number, over a faint pattern; the last ones are in front.
fn frame(index: usize, squares: &[(u64, BBox)]) -> Frame {
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
    Frame { index, time: index as f64 / 30.0, image: Image::new(W, H, 1, pixels).expect("a byte a pixel") }
}

fn found(b: BBox) -> Detection {
    Detection { bbox: b, score: 1.0 }
}

fn off(seen: &Seen, b: &BBox) -> f64 {
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
        let mut many = many(seed);
        let mut hidden = 0;
        for t in 0..56usize {
            let squares = passing(t);
            let apart = squares[0].1.intersection(&squares[1].1) == 0.0;
            let detections: Vec<_> = squares.iter().map(|s| found(s.1)).collect();
            many.step(&frame(t, &squares), if detected && apart { &detections } else { &[] });
            if t == 0 {
                for (id, b) in squares {
                    many.give(&frame(0, &squares), Some(id), b).expect("a box in the picture");
                }
            }
            hidden += many.seen().iter().filter(|s| s.visible < 0.5).count();
        }
        assert_eq!(many.seen().iter().map(|s| s.id).collect::<Vec<_>>(), [1, 2], "seed {seed}");
        for (seen, (id, b)) in many.seen().iter().zip(passing(55)) {
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
fn who_comes_is_born_who_leaves_dies_and_who_returns_is_known() {
    let mut many = many(1);
    let mut phases = vec![];
    for t in 0..80usize {
        let (squares, detections) = visits(t);
        let seen = many.step(&frame(t, &squares), &detections);
        assert!(seen.len() <= 1, "frame {t}: noise is nobody: {seen:?}");
        phases.extend(seen.iter().map(|s| (t, s.id, s.phase)).filter(|p| matches!(p.2, Phase::Born | Phase::Found)));
        if let (Some(seen), [(_, b)]) = (seen.first(), &squares[..]) {
            assert!(off(seen, b) < 6.0, "frame {t}: {:.1} px off", off(seen, b));
        }
        if t == 59 {
            assert!(many.seen().is_empty(), "it is gone: {:?}", many.seen());
        }
    }
    assert_eq!(phases, [(7, 1, Phase::Born), (62, 1, Phase::Found)]);
}

#[test]
fn a_cut_is_the_end_and_boxes_that_are_none_are_refused() {
    let mut many = many(1);
    let first = frame(0, &passing(0));
    many.step(&first, &[]);
    assert_eq!(many.give(&first, Some(5), passing(0)[0].1).expect("a box"), 5);
    assert_eq!(many.give(&first, None, passing(0)[1].1).expect("a box"), 6);
    assert_eq!(many.give(&first, Some(5), at(50.0, 50.0)).expect("it starts again"), 5);
    assert_eq!(many.seen().len(), 2);
    for bad in [BBox { w: 0.0, ..at(1.0, 1.0) }, BBox { x: f64::NAN, ..at(1.0, 1.0) }, at(500.0, 1.0)] {
        assert!(many.give(&first, None, bad).is_err(), "{bad:?}");
        many.step(&first, &[found(bad); 4]);
    }
    assert!(many.tracker(5).is_some() && many.tracker(7).is_none());
    many.cut(4);
    assert!(many.seen().is_empty());
}

/// All that is known of one target, frame by frame.
fn life(id: u64, seed: u64, others: &[(u64, BBox)]) -> Vec<Seen> {
    let mut many = many(seed);
    let mut life = vec![];
    for t in 0..25usize {
        let mut squares = vec![(3, at(10.0 + 2.0 * t as f64, 80.0))];
        squares.extend_from_slice(others);
        let detections: Vec<_> = squares.iter().filter(|_| !t.is_multiple_of(3)).map(|s| found(s.1)).collect();
        let frame = frame(t, &squares);
        many.step(&frame, &detections);
        if t == 0 {
            squares.iter().for_each(|(id, b)| assert_eq!(many.give(&frame, Some(*id), *b).expect("a box"), *id));
        }
        life.extend(many.seen().iter().filter(|s| s.id == id));
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
    let mut alone = many(5);
    let mut seen = vec![];
    for t in 0..25usize {
        let own = at(10.0 + 2.0 * t as f64, 80.0);
        let mut squares = vec![(3, own)];
        squares.extend_from_slice(&others);
        let (frame, detections) = (frame(t, &squares), [found(own)]);
        alone.step(&frame, if t.is_multiple_of(3) { &[] } else { &detections });
        if t == 0 {
            alone.give(&frame, Some(3), own).expect("a box");
        }
        seen.extend_from_slice(alone.seen());
    }
    assert_eq!(seen, together);
}

#[test]
fn saved_targets_go_on_bit_for_bit() {
    let mut one = many(2);
    for t in 0..45 {
        let (squares, detections) = visits(t);
        one.step(&frame(t, &squares), &detections);
    }
    let saved = one.save();
    let text = serde_json::to_string(&saved).expect("JSON");
    let mut two = many(2);
    two.load(&serde_json::from_str(&text).expect("JSON")).expect("it was saved");
    for t in 45..80 {
        let (squares, detections) = visits(t);
        let frame = frame(t, &squares);
        assert_eq!(one.step(&frame, &detections), two.step(&frame, &detections), "frame {t}");
    }
    assert!(many(2).load(&serde_json::json!({ "format": 99 })).is_err());
}
