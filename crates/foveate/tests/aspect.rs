//! A shape that follows the target, in the whole tracker: something square that grows wide, and narrow again.

use std::path::Path;

use foveate::config::{Blueprint, Config};
use foveate::geometry::BBox;
use foveate::rng::Streams;
use foveate::scene::{Frame, Image, Scene};
use foveate::tracker::Tracker;
use rand::RngExt;

const FRAMES: usize = 160;

/// Wider by exp(0.3) and lower by as much in 60 frames, so for 40 more, and back in 60.
fn truth(index: usize) -> BBox {
    let t = index as f64;
    let a = 0.3 * (t / 60.0).min(1.0).min((160.0 - t) / 60.0);
    BBox::around(60.0 + 0.2 * t, 50.0, 32.0 * a.exp(), 32.0 * (-a).exp())
}

/// A texture stretched over the box, on another one, both under noise.
fn frame(index: usize) -> Frame {
    let (b, mut noise) = (truth(index), Streams::new(index as u64, 9).rng(0));
    let pixel = |i: usize| {
        let (x, y) = ((i % 160) as f64, (i / 160) as f64);
        let (u, v) = ((x - b.x) / b.w, (y - b.y) / b.h);
        let inside = (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v);
        let texture = match inside {
            true => 130.0 + 40.0 * (9.0 * u + 3.0 * v).sin() + 40.0 * (8.0 * v - 4.0 * u * u).cos(),
            false => 90.0 + 30.0 * (0.3 * x + 0.1 * y).sin() + 30.0 * (0.25 * y - 0.15 * x).cos(),
        };
        (texture + noise.random_range(-10.0..10.0)) as u8
    };
    Frame { index, time: 0.0, image: Image::new(160, 100, 1, (0..16_000).map(pixel).collect()).expect("160 x 100") }
}

fn blueprint(aspect: &str) -> Blueprint {
    let text = format!(
        "seed = 1\nparticles = 300\n[dynamics]\nkind = \"autoregressive\"\nscale_pull = 1.0\n{aspect}\n\
         [retina]\nkind = \"foveal\"\nside = 16\nrings = [[18, 1]]\n[encoder]\nkind = \"raw\"\n\
         [likelihood]\ndistance = \"cosine\"\nsharpness = 60\n[policy]\nkind = \"fixed\"\n"
    );
    Config::parse(&text, "test").and_then(|c| c.check(Path::new("."))).expect("a good configuration")
}

fn started(blueprint: &Blueprint, seed: u64) -> Tracker {
    let mut tracker = blueprint.tracker(seed, 0).expect("parts that fit");
    tracker.start(&frame(0), truth(0)).expect("a box in the picture");
    tracker
}

fn boxes(tracker: &mut Tracker, frames: std::ops::Range<usize>) -> Vec<BBox> {
    frames.map(|i| tracker.step(Scene { frame: &frame(i), detections: &[] }).bbox()).collect()
}

/// Five seeds each.
#[test]
fn the_shape_follows_the_target() {
    let (fixed, shaped) = (blueprint(""), blueprint("[aspect]\nrate = 0.3\npull = 0.0"));
    for seed in 0..5 {
        let [fixed, shaped] = [&fixed, &shaped].map(|b| boxes(&mut started(b, seed), 1..FRAMES));
        let worst = |boxes: &[BBox]| (80..100).map(|i| boxes[i - 1].iou(&truth(i))).fold(1.0, f64::min);
        let (without, with) = (worst(&fixed), worst(&shaped));
        assert!(without < 0.65 && with > 0.85, "seed {seed}: IoU {without:.2} without, {with:.2} with");
        let [wide, again] = [99, 159].map(|i| 0.5 * (shaped[i - 1].w / shaped[i - 1].h).ln());
        assert!((wide - 0.3).abs() < 0.06 && again.abs() < 0.06, "seed {seed}: {wide:.3}, then {again:.3}");
    }
}

#[test]
fn a_saved_tracker_goes_on_and_a_shape_is_kept_to_one_target() {
    let blueprint = blueprint("[aspect]");
    let bits = |boxes: &[BBox]| boxes.iter().flat_map(|b| [b.x, b.y, b.w, b.h]).map(f64::to_bits).collect::<Vec<_>>();
    let mut whole = started(&blueprint, 1);
    let first = boxes(&mut whole, 1..40);
    assert!(first[38].w / first[38].h > 1.05, "it has begun to widen: {:?}", first[38]);
    let mut resumed = blueprint.tracker(1, 0).expect("parts that fit");
    resumed.load(&whole.save()).expect("it was saved");
    assert!(bits(&boxes(&mut whole, 40..60)) == bits(&boxes(&mut resumed, 40..60)));
    let mut plain = crate::blueprint("").tracker(1, 0).expect("parts that fit");
    assert!(plain.load(&whole.save()).expect_err("it has none").to_string().contains("aspect"));
    whole.start(&frame(0), truth(0)).expect("a box in the picture");
    assert_eq!(whole.extent(), started(&blueprint, 1).extent(), "another target has a shape of its own");
}
