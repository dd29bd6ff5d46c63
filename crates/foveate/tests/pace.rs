//! Motion noise that adapts, in the whole tracker: targets that stand, run, and stand again.

use std::path::Path;

use foveate::config::{Blueprint, Config};
use foveate::geometry::BBox;
use foveate::rng::Streams;
use foveate::scene::{Frame, Image, Scene};
use foveate::tracker::Tracker;
use rand::RngExt;

const SIDE: f64 = 20.0;
/// Where the target stands at first.
const START: BBox = BBox { x: 20.0, y: 40.0, w: SIDE, h: SIDE };

/// A textured square with its corner at x, 40, on another texture, both under noise.
fn frame(index: usize, x: usize) -> Frame {
    let mut noise = Streams::new(index as u64, 9).rng(0);
    let pixel = |i: usize| {
        let (column, row) = (i % 320, i / 320);
        let (u, v) = (column.wrapping_sub(x), row.wrapping_sub(40));
        let texture = if u < 20 && v < 20 {
            80 + (37 * (u / 3) * (v / 3)) % 120
        } else {
            (column * row / 3 + 13 * (column / 9)) % 97
        };
        (texture + noise.random_range(0..40)) as u8
    };
    let image = Image::new(320, 100, 1, (0..320 * 100).map(pixel).collect()).expect("320 x 100");
    Frame { index, time: index as f64 / 30.0, image }
}

/// A configuration of this motion noise, with or without a pace.
fn blueprint(noise: f64, pace: &str) -> Blueprint {
    let text = format!(
        "seed = 1\nparticles = 300\n[dynamics]\nkind = \"autoregressive\"\ndamping = 0.5\nvelocity = {noise}\nposition = {noise}\n{pace}\n\
         [retina]\nkind = \"foveal\"\nside = 20\nrings = [[20, 1]]\n[encoder]\nkind = \"raw\"\n\
         [likelihood]\ndistance = \"cosine\"\nsharpness = 40\n[policy]\nkind = \"fixed\"\n"
    );
    Config::parse(&text, "test").and_then(|c| c.check(Path::new("."))).expect("a good configuration")
}

/// Stands for 40 frames, runs, from standing to `speed` within 10 frames, for 25, and stands again for 60.
fn path(speed: f64) -> Vec<usize> {
    let mut x = START.x;
    let speed_at = |t: usize| match t {
        40..50 => speed * (t - 39) as f64 / 10.0,
        50..65 => speed,
        _ => 0.0,
    };
    let along = |t: usize| {
        x += speed_at(t);
        x.round() as usize
    };
    (0..125).map(along).collect()
}

/// The factor of the noises, from what was saved.
fn factor(tracker: &Tracker) -> f64 {
    tracker.save()["proposal"]["square"].as_f64().unwrap_or(1.0).sqrt()
}

/// Distances from the truth in pixels, and the factors, frame by frame.
fn follow(blueprint: &Blueprint, path: &[usize], seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut tracker = blueprint.tracker(seed, 0).expect("parts that fit");
    tracker.start(&frame(0, path[0]), START).expect("a box in the picture");
    let step = |index: usize| {
        let frame = frame(index, path[index]);
        let (x, y) = tracker.step(Scene { frame: &frame, detections: &[] }).bbox().centre();
        let there = BBox { x: path[index] as f64, ..START }.centre();
        ((x - there.0).hypot(y - there.1), factor(&tracker))
    };
    (1..path.len()).map(step).unzip()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Ten seeds each of noise for a target that stands, for one that runs, and of the first with a pace. In a run of 8 pixels a
/// frame the dynamics expect half of it, which leaves 6 deviations of the first noise.
#[test]
fn the_noise_follows_the_target() {
    let pace = "[pace]\nleast = 0.2\nmost = 10.0\nusual = 0.7\nrate = 0.3";
    let path = path(8.0);
    let [mut narrow, mut wide, mut paced] = [(0.0, 0); 3];
    for (blueprint, (still, kept)) in
        [(blueprint(0.05, ""), &mut narrow), (blueprint(0.4, ""), &mut wide), (blueprint(0.05, pace), &mut paced)]
    {
        for seed in 0..10 {
            let (errors, factors) = follow(&blueprint, &path, seed);
            *still += mean(&errors[20..39]) / 10.0;
            *kept += usize::from(errors[70] < 3.0);
            let [standing, running, again] = [35, 60, 124].map(|t| factors[t - 1]);
            if blueprint.config().pace.is_some() {
                assert!(standing < 0.7 && running > 4.0 && again < 0.7, "{seed}: {standing} {running} {again}");
            } else {
                assert!(factors.iter().all(|f| *f == 1.0), "nothing adapts unless it is told to");
            }
        }
    }
    assert_eq!((narrow.1, wide.1, paced.1), (0, 10, 10), "of ten are kept through the run");
    assert!(paced.0 < 0.5 * wide.0, "the target that stands is {} px off, with noise for the run {}", paced.0, wide.0);
}
