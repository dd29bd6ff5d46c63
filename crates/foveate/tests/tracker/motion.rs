//! The motion detector finds digits that move.

use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, Drawn, NOISE, Occlusion};
use foveate::scene::motion::first_box;
use foveate::scene::{Detector, Motion, StillCamera};
use foveate::video::open;
use foveate_testing::{data, need};

/// Share of the frames from `from` on whose best candidate's centre is within 6 pixels of the digit's box's, and
/// candidates a frame.
fn follow(video: impl Drawn, from: usize) -> (f64, f64) {
    let truth = video.truth().to_vec();
    let (mut motion, mut found, mut near, mut count) = (Motion::default(), vec![], 0, 0);
    for frame in video.source() {
        let frame = frame.expect("a frame");
        motion.detect(&frame.image, &mut found);
        if frame.index < from {
            continue;
        }
        count += found.len();
        let (x, y) = truth[frame.index].centre();
        near += usize::from(found.first().is_some_and(|d| {
            let at = d.bbox.centre();
            (at.0 - x).hypot(at.1 - y) <= 6.0
        }));
    }
    let frames = (truth.len() - from) as f64;
    (near as f64 / frames, count as f64 / frames)
}

#[test]
fn the_moving_digit_is_found() {
    let digits = Digits::drawn(1, 2);
    for digit in [2, 3, 5] {
        for noise in [0.0, NOISE] {
            let scene = Clutter { digit, noise, frames: 80, ..Clutter::default() };
            let (near, count) = follow(scene.video(&digits).expect("a video"), 30);
            assert!(near > 0.95 && count < 1.2, "digit {digit}, noise {noise}: near in {near}, {count} candidates");
        }
        let scene = Occlusion { digit, frames: 80, ..Occlusion::default() };
        let (near, count) = follow(scene.video(&digits).expect("a video"), 30);
        // Behind the bars there is nothing to see; beside them a part of it.
        assert!(near > 0.65 && count < 1.2, "digit {digit} behind bars: near in {near}, {count} candidates");
    }
}

#[test]
fn the_first_box_is_where_the_digit_is() {
    let digits = Digits::drawn(1, 2);
    for noise in [0.0, NOISE] {
        let (mut good, mut sum) = (0, 0.0);
        for seed in 0..40 {
            let scene = Clutter { digit: (seed % 10) as u8, seed, noise, frames: 30, ..Clutter::default() };
            let video = scene.video(&digits).expect("a video");
            let found = first_box(&video.render(0), &video.render(1), Some((28.0, 28.0)));
            let iou = found.map_or(0.0, |b| b.iou(&video.truth()[0]));
            sum += iou;
            good += usize::from(iou > 0.5);
        }
        assert!(good >= 36 && sum / 40.0 > 0.7, "noise {noise}: {good} of 40 overlap, mean {}", sum / 40.0);
    }
}

/// In TUD-Campus people of half the picture's height walk past a camera that stands still to a pixel.
#[test]
fn cameras_of_real_videos_stand_or_move() {
    for (video, moves) in [
        ("mot/TUD-Campus/img1", false),
        ("mot/PETS09-S2L1/img1", false),
        ("tracking/Crossing/img", false),
        ("tracking/Couple/img", true),
        ("tracking-wide/BlurBody/img", true),
        ("tracking-wide/Traffic/img", true),
    ] {
        let folder = need!(data(video));
        let mut camera = StillCamera::default();
        for frame in open(&folder).expect("pictures").take(60) {
            camera.look(&frame.expect("a picture").image, false);
        }
        assert_eq!(camera.moves().is_some(), moves, "{video}: {:?}", camera.moves());
    }
}
