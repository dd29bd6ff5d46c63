//! Priors of where to look: the most salient or most informative part of the target is looked at first, and a saved
//! tracker remembers it.

use crate::common::blueprint;
use foveate::geometry::{BBox, Gaze};
use foveate::scene::Image;
use foveate::video::Frame;

const INIT: BBox = BBox { x: 40.0, y: 30.0, w: 64.0, h: 64.0 };

/// An even target of 64 × 64 px on an even ground, with a bright square of 16 px in its lower right quarter.
fn frame(index: usize) -> Frame {
    let (w, h) = (160, 120);
    let pixel = |x: usize, y: usize| match (x, y) {
        (76..92, 66..82) => 250,
        (40..104, 30..94) => 100,
        _ => 90,
    };
    let data = (0..w * h).map(|i| pixel(i % w, i / w)).collect();
    Frame { index, time: index as f64 / 30.0, image: Image::new(w, h, 1, data).expect("160 x 120") }
}

fn tracker(prior: &str, weight: f64) -> foveate::Tracker {
    let policy = format!("{{ kind = \"gp-ucb\", {prior} = {weight:?} }}");
    blueprint(&policy, false, 0.5, false, 50).tracker(1).expect("a tracker")
}

fn looks(tracker: &mut foveate::Tracker, frames: std::ops::Range<usize>) -> Vec<Gaze> {
    frames.map(|t| tracker.update(&frame(t).image).expect("a frame").plan.chosen()).collect()
}

#[test]
fn what_stands_out_or_tells_is_looked_at_first() {
    let first = |prior, weight| {
        let mut tracker = tracker(prior, weight);
        tracker.init(&frame(0).image, INIT).expect("a box");
        looks(&mut tracker, 1..11)
    };
    let there = |gazes: Vec<Gaze>| gazes.iter().filter(|g| g.u > 0.1 && g.v > 0.1).count();
    // A gaze a little away from the square still has its edges in view, and is as informative.
    for (prior, least) in [("saliency", 10), ("rehearsal", 8)] {
        assert!(there(first(prior, 10.0)) >= least, "{prior}: {least} of the first ten");
        assert!(there(first(prior, 0.0)) < 6, "about the centre, in any direction");
    }
}

#[test]
fn a_saved_tracker_remembers_its_prior() {
    for prior in ["saliency", "rehearsal"] {
        let mut whole = tracker(prior, 1.0);
        whole.init(&frame(0).image, INIT).expect("a box");
        looks(&mut whole, 1..4);
        let saved = whole.save();
        let mut loaded = tracker(prior, 1.0);
        loaded.load(&saved).expect("the same settings");
        assert_eq!(looks(&mut loaded, 4..20), looks(&mut whole, 4..20), "{prior}");
    }
}
