//! A target that leaps farther than the particles reach is followed.

use crate::common::natural;
use foveate::BBox;
use foveate::config::Config;
use foveate::files::Folder;
use foveate::scene::Image;

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
