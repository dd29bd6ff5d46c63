//! A target that leaps farther than the particles reach is followed.

use crate::common::natural;
use foveate::BBox;
use foveate::config::Config;
use foveate::files::Folder;
use foveate::scene::Image;
use foveate::video::{Frame, annotation};
use foveate_testing::{data, need};

const SIDE: f64 = 24.0;

/// A patch with a texture of its own at a place of another texture.
fn picture(x: f64, y: f64) -> Image {
    let (w, h) = (320, 160);
    let pixel = |px: usize, py: usize, plane: usize| {
        let (u, v) = (px as f64 - x, py as f64 - y);
        if (0.0..SIDE).contains(&u) && (0.0..SIDE).contains(&v) {
            let (u, v) = ((u / 3.0) as usize, (v / 3.0) as usize);
            (60 + 40 * plane + (53 * (u * u + 3 * v + u * v)) % 110) as u8
        } else {
            (40 + (px / 5 * 31 + py / 7 * 17 + px / 5 * (py / 7)) % 60) as u8
        }
    };
    let data = (0..3 * w * h).map(|i| pixel(i % w, i / w % h, i / (w * h))).collect();
    Image::new(w, h, 3, data).expect("320 x 160")
}

/// The error of each frame after the first, in boxes.
fn follow(config: &Config, path: &[(f64, f64)], seed: u64) -> Vec<f64> {
    let mut tracker = config.clone().check(&Folder::here()).and_then(|c| c.tracker(seed)).expect("parts that fit");
    tracker.init(&picture(path[0].0, path[0].1), BBox::new(path[0].0, path[0].1, SIDE, SIDE)).expect("a box");
    let error = |&(x, y): &(f64, f64)| {
        let picture = picture(x, y);
        let (cx, cy) = tracker.update(&picture).expect("a picture of the first size").bbox.centre();
        (cx - x - 0.5 * SIDE).hypot(cy - y - 0.5 * SIDE) / SIDE
    };
    path[1..].iter().map(error).collect()
}

/// It stands for twelve frames, then stands two boxes farther on, or two and a half where places are searched as far. Without the search
/// it is lost for some frames, until it is looked for in the whole picture.
#[test]
fn a_leap_is_followed_in_the_frame_itself() {
    let natural = natural(300).config().clone();
    let farther = natural.set("distractors.reach=6.0").expect("it is in range");
    for (with, to) in [(natural, (168.0, 80.0)), (farther, (180.0, 84.0))] {
        let path: Vec<_> = (0..14).map(|i| if i < 12 { (120.0, 60.0) } else { to }).collect();
        let without = Config { local_search: None, ..with.clone() };
        let followed = |config: &Config| (0..10).filter(|seed| follow(config, &path, *seed)[11] < 0.2).count();
        assert_eq!((followed(&without), followed(&with)), (0, 10), "to {to:?}");
    }
}

/// Real: a runner passes behind a pole, which the short-term memory learns while it hides him. When he comes out he is found beside it, because the pole
/// does not count then; otherwise he is found again when the box has left the picture.
#[test]
fn what_hid_the_target_has_no_say_in_doubt() {
    let folder = need!(data("tracking/Jogging"));
    let truth = annotation::read_truth(folder.join("groundtruth_rect.txt")).expect("its truth");
    let back = |doubt: f64, seed: u64| {
        let mut config = Config::builtin("natural").expect("it ships").expect("it is right");
        config.local_search.iter_mut().for_each(|search| search.doubt = doubt);
        (config.box_regression, config.variation) = (None, None); // with them he is found either way
        let mut tracker = config.check(&Folder::here()).and_then(|c| c.tracker(seed)).expect("parts that fit");
        let mut found = false;
        for frame in foveate::video::open(folder.join("img")).expect("pictures").take(90) {
            let Frame { index, image, .. } = frame.expect("a picture");
            let bbox = truth[index].expect("a box in each frame");
            match index {
                0 => tracker.init(&image, bbox).expect("a box in the picture"),
                _ => found = tracker.update(&image).expect("a picture of the first size").bbox.iou(&bbox) > 0.5,
            }
        }
        found
    };
    let found = |doubt: f64| (1..=3).filter(|seed| back(doubt, *seed)).count();
    let (before, now) = (found(1.0), found(0.2));
    assert!(now > before, "{now} of 3, {before} with what was learned for now");
}
