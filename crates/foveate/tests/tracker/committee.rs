//! Several trackers of one target: each gives its result alone, and the vote is the result of all.

use crate::common::{INIT, frame, natural, truth};
use foveate::config::{Blueprint, Config};
use foveate::control::{Ballot, Vote};
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::{Error, Status, Tracker};

const FRAMES: usize = 16;
const SEED: u64 = 5;
const MEMBERS: usize = 3;

fn of(members: usize) -> Blueprint {
    let config = Config { committee: members, ..natural(150).config().clone() };
    config.check(&Folder::here()).expect("parts that fit")
}

/// The frame in which the target is given again, by hand.
const BY_HAND: usize = 8;

/// Boxes, P(lost) and status.
fn track(mut tracker: Tracker) -> Vec<(BBox, f64, Status)> {
    tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
    let step = |i| {
        let frame = frame(i, 3);
        if i == BY_HAND {
            tracker.reset_at(truth(i - 1)).expect("a box with an area");
        }
        let seen = tracker.update(&frame.image).expect("a picture of the first size");
        (seen.bbox, seen.p_lost, seen.status)
    };
    (1..FRAMES).map(step).collect()
}

/// On a target that no member loses, each member tracks as it would alone.
#[test]
fn the_members_are_trackers_alone_and_vote() {
    let together = track(of(MEMBERS).tracker(SEED).expect("parts that fit"));
    let alone: Vec<_> =
        (0..MEMBERS as u64).map(|k| track(of(1).tracker_of(SEED, k << 56).expect("parts that fit"))).collect();
    assert!(alone[0] != alone[1] && alone[1] != alone[2], "they share no draw");
    for (i, (bbox, p_lost, status)) in together.iter().enumerate() {
        let ballots: Vec<Ballot> =
            alone.iter().map(|track| Ballot { bbox: track[i].0, p_lost: track[i].1, is_searching: false }).collect();
        let (elected, lost) = Vote::elect(&ballots);
        assert_eq!((bbox, p_lost, *status), (&ballots[elected].bbox, &lost, Status::Tracking), "frame {i}");
        assert!(bbox.iou(&truth(i + 1)) > 0.5, "frame {i}: {bbox:?}");
    }
}

/// Values that several members read are counted once.
#[test]
fn what_they_read_is_counted_once() {
    let reads = |members| {
        let config = Config::builtin("natural-middle").expect("it ships").expect("it is right");
        let config = Config { committee: members, ..config }.check(&Folder::here()).expect("parts that fit");
        let mut tracker = config.tracker(SEED).expect("parts that fit");
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        let frame = frame(1, 3);
        tracker.update(&frame.image).expect("a picture of the first size").values
    };
    let (one, three) = (reads(1), reads(MEMBERS));
    assert!(one <= three && three < 2 * one, "one reads {one}, three {three}");
}

#[test]
fn one_cannot_go_on_as_several() {
    let saved = |members| {
        let mut tracker = of(members).tracker(SEED).expect("parts that fit");
        tracker.init(&frame(0, 3).image, INIT).expect("a box in the picture");
        tracker.save()
    };
    let refused = |members, saved: &foveate::extend::SavedState| {
        let mut tracker = of(members).tracker(SEED).expect("parts that fit");
        match tracker.load(saved).expect_err("another committee") {
            Error::Invalid(why) => why,
            other => panic!("{other}"),
        }
    };
    let error = refused(MEMBERS, &saved(1));
    assert!(error.contains("committee is ") && error.contains("and 3 in this tracker"), "{error}");
    let error = refused(MEMBERS, &saved(2));
    assert!(error.contains("committee is 2 in the state and 3 in this tracker"), "{error}");
    refused(1, &saved(2));
}
