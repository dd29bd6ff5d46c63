//! The library's front door and the program are one tracker: the same boxes, bit for bit.

use foveate::video::{mot::Tracks, open};
use foveate::{BBox, Detection, MultiTracker, Tracker};
use std::path::Path;

use crate::place::Place;

const FRAMES: usize = 25;

/// A folder with a video of a digit among others, `video`.
fn place() -> Place {
    let place = Place::empty();
    place.done(["synth", "clutter", "--frames", &FRAMES.to_string(), "--out", "video"]);
    place
}

/// A user's program.
fn follow(config: &str, video: &Path, first: BBox) -> foveate::Result<Vec<[f64; 5]>> {
    let mut tracker = Tracker::new(config)?;
    let mut rows = vec![];
    for frame in open(video)? {
        let frame = frame?;
        if frame.index == 0 {
            tracker.init(&frame.image, first)?;
        } else {
            let seen = tracker.update(&frame.image)?;
            rows.push([seen.state.x, seen.state.y, seen.bbox.w, seen.bbox.h, seen.p_lost]);
        }
    }
    Ok(rows)
}

/// Columns of a CSV file by name, all lines that have them.
fn columns(text: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at: Vec<usize> =
        names.iter().map(|n| head.iter().position(|h| h == n).unwrap_or_else(|| panic!("{n}"))).collect();
    let numbers = |line: &str| -> Option<Vec<f64>> {
        let cells: Vec<&str> = line.split(',').collect();
        at.iter().map(|i| cells[*i].parse().ok()).collect()
    };
    lines.filter_map(numbers).collect()
}

#[test]
fn one_target_has_the_boxes_of_the_program() {
    let place = place();
    let truth = place.text("video/groundtruth_rect.txt");
    let first: Vec<f64> =
        truth.lines().next().expect("a box").split(',').map(|n| n.parse().expect("a number")).collect();
    let first = BBox::counted_from_1(first[0], first[1], first[2], first[3]);
    for config in ["natural", "natural-fast", "digits"] {
        place.done(["track", "video", "--config", config, "--no-video", "--no-report", "--out", config]);
        let ours = follow(config, &place.path("video"), first).expect("it tracks");
        let theirs = columns(&place.text(&format!("{config}/track.csv")), &["x", "y", "width", "height", "p_lost"]);
        assert_eq!(ours.len(), FRAMES - 1);
        let bits = |rows: &[&[f64]]| -> Vec<Vec<u64>> {
            rows.iter().map(|r| r.iter().map(|v| v.to_bits()).collect()).collect()
        };
        let tracked = &theirs[theirs.len() - ours.len()..];
        let (ours, theirs): (Vec<&[f64]>, Vec<&[f64]>) =
            (ours.iter().map(|r| &r[..]).collect(), tracked.iter().map(|r| &r[..]).collect());
        assert_eq!(bits(&ours), bits(&theirs), "{config}");
    }
}

#[test]
fn many_targets_have_the_boxes_of_the_program() {
    let place = place();
    let truth = place.text("video/groundtruth_rect.txt");
    let lines = truth.lines().enumerate().map(|(t, line)| format!("{},-1,{line},1,-1,-1,-1\n", t + 1));
    place.write("det.txt", lines.collect::<String>());
    place.done("track video --config multi --detections det.txt --no-video --no-report --out multi".split(' '));

    let found = Tracks::read(place.path("det.txt")).expect("just written");
    let mut tracker = MultiTracker::new("multi").expect("it ships");
    let mut ours = vec![];
    for frame in open(place.path("video")).expect("a video") {
        let frame = frame.expect("a picture");
        let here = found.sightings.iter().filter(|s| s.frame == frame.index);
        let here: Vec<Detection> = here.map(|s| Detection::new(s.bbox, s.confidence)).collect();
        for target in tracker.update(&frame.image, &here).expect("pictures of one size") {
            ours.push([
                frame.index as f64 + 1.0,
                target.id as f64,
                target.state.x,
                target.state.y,
                target.consistency.deficit,
                target.p_lost,
            ]);
        }
    }
    assert!(ours.len() > FRAMES / 2, "the detections start a track");
    let theirs = columns(&place.text("multi/tracks.csv"), &["frame", "id", "x", "y", "deficit", "p_lost"]);
    let ours: Vec<Vec<f64>> = ours.iter().map(|row| row.to_vec()).collect();
    assert_eq!(ours, theirs);
}
