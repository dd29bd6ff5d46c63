//! The time of one tracker frame: a figure to compare machines and programs with.
//!
//! N particles on a 640 × 480 grey frame of blurred noise, a target of 48 px, the 144 + 48 + 48 values of a fovea in cells
//! of 1, 3 and 6 px, 500 hidden units of random weights, one look, one thread. States have noise of 2 px in place, 1 px
//! in velocity, 0.01 in log scale and 0.02 in angle. Every timed frame starts alike, all particles on the target; it is a
//! whole `Tracker::update`, the look at the estimate included.
//!
//! `cargo bench -p foveate --features lab --bench frame -- [frames]`;
//! one JSON line a figure. Then 1 to 20 targets with detections, configuration
//! `multi`. Last `natural` and `natural-fast`, one target, by sizes of picture and target, and while the target is lost.

use std::sync::Arc;

use rand::RngExt;
use rand_distr::StandardNormal;

use foveate::config::Config;
use foveate::control::{Autoregressive, Concentration, ConfidenceModel, ConsistencySettings, Prior};
use foveate::files::Nowhere;
use foveate::geometry::{BBox, Gaze, Size};
use foveate::identity::distance::Kind;
use foveate::identity::gaze_appearance::{GazeAppearance, Sharpness};
use foveate::identity::rbm_encoder::{Precision, RbmEncoder};
use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::learn::rbm::{Rbm, Visible};
use foveate::multi::MultiTracker;
use foveate::rng::{Purpose, Rng, Streams};
use foveate::scene::{Detection, Image, Preprocessor};
use foveate::start::StartSpread;
use foveate::{Filter, GazeControl, Monitor, Parts, Result, Tracker, gaze};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const SIDE: f64 = 48.0;
const HIDDEN: usize = 500;

/// Times of one frame, milliseconds of CPU; of the wall clock if the system does not count it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FrameTime {
    /// The median.
    median: f64,
    /// The least.
    best: f64,
}

/// Times `frames` (at least 1) frames of `particles` (at least 1).
fn frame(particles: usize, precision: Precision, frames: usize) -> Result<FrameTime> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    pool.install(|| {
        let mut rng = Streams::new(0, 0).at(0, Purpose::Scene).rng(0);
        let mut tracker = Tracker::from_parts(parts(precision, particles, &mut rng)?, Preprocessor::default(), 0);
        let image = noise(&mut rng)?;
        let target = BBox::around(WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0, SIDE, SIDE);
        let mut once = || -> Result<f64> {
            tracker.init(&image, target)?;
            let begin = now();
            std::hint::black_box(tracker.update(&image)?);
            Ok(1e3 * (now() - begin))
        };
        once()?;
        let mut times = (0..frames.max(1)).map(|_| once()).collect::<Result<Vec<f64>>>()?;
        times.sort_by(f64::total_cmp);
        Ok(FrameTime { median: times[times.len() / 2], best: times[0] })
    })
}

/// Targets of 40 × 48 px, each with a look of its own, go to and fro over a 640 × 480 grey frame of blurred noise, apart from
/// each other, and are detected in every frame. Times of `frames` (at least 1) frames, milliseconds of CPU, after a warm-up.
fn multi(tracker: &mut MultiTracker, targets: usize, frames: usize) -> Result<FrameTime> {
    const TURN: usize = 20;
    let mut rng = Streams::new(0, 0).at(1, Purpose::Scene).rng(0);
    let ground = noise(&mut rng)?;
    let looks: Vec<u8> = (0..targets * 100).map(|_| rng.random()).collect();
    let bbox = |k: usize, t: usize| {
        let (x, y) = (20 + 120 * (k % 5) + 2 * t, 20 + 110 * (k / 5 % 4));
        BBox { x: x as f64, y: y as f64, w: 40.0, h: 48.0 }
    };
    let picture = |t: usize| {
        let mut image = ground.clone();
        for k in 0..targets {
            let b = bbox(k, t);
            for (v, row) in image.plane_mut(0).chunks_exact_mut(WIDTH).skip(b.y as usize).take(48).enumerate() {
                let look = |u: usize| looks[100 * k + 10 * (v / 5) + u / 4];
                row[b.x as usize..][..40].iter_mut().enumerate().for_each(|(u, pixel)| *pixel = look(u));
            }
        }
        image
    };
    let pictures: Vec<Image> = (0..=TURN).map(picture).collect();
    tracker.update(&pictures[0], &[])?;
    for k in 0..targets {
        tracker.add(&pictures[0], None, bbox(k, 0))?;
    }
    let mut times = vec![];
    for index in 1..=frames.max(1) + WARM {
        let t = index % (2 * TURN);
        let t = t.min(2 * TURN - t);
        let detections: Vec<_> = (0..targets).map(|k| Detection::new(bbox(k, t), 1.0)).collect();
        // A picture comes from a decoder, all of it written just now: not one whose few used pixels are in the cache since last time.
        let image = pictures[t].clone();
        let begin = now();
        std::hint::black_box(tracker.update(&image, &detections)?);
        times.push(1e3 * (now() - begin));
    }
    times.drain(..WARM);
    times.sort_by(f64::total_cmp);
    Ok(FrameTime { median: times[times.len() / 2], best: times[0] })
}

/// A target of `side` px goes to and fro in the middle of a picture in colour, or is there in the first frames alone: then only
/// frames count that follow a frame with status lost. Times of `frames` frames, each with the next one, milliseconds of CPU a frame.
fn one(name: &str, Size { width, height }: Size, side: usize, lost: bool, frames: usize) -> Result<FrameTime> {
    const TURN: usize = 12;
    let mut tracker = Tracker::new(name)?;
    let mut rng = Streams::new(0, 0).at(2, Purpose::Scene).rng(0);
    let mut blocks = |n: usize| -> Vec<u8> { (0..n).map(|_| rng.random()).collect() };
    let (ground, look) = (blocks(3 * (width / 7 + 1) * (height / 7 + 1)), blocks(3 * 64));
    let bbox = |t: usize| BBox {
        x: (width / 2 - side / 2 + 2 * t) as f64,
        y: (height / 2 - side / 2) as f64,
        w: side as f64,
        h: side as f64,
    };
    let picture = |t: Option<usize>| {
        let mut data = Vec::with_capacity(3 * width * height);
        for (p, y, x) in (0..3).flat_map(|p| (0..height).flat_map(move |y| (0..width).map(move |x| (p, y, x)))) {
            let inside = t.map(bbox).and_then(|b| {
                let (u, v) = (x.checked_sub(b.x as usize)?, y.checked_sub(b.y as usize)?);
                (u < side && v < side).then(|| look[64 * p + 8 * (8 * v / side) + 8 * u / side])
            });
            data.push(inside.unwrap_or(ground[(p * (height / 7 + 1) + y / 7) * (width / 7 + 1) + x / 7] / 2));
        }
        Image::new(width, height, 3, data)
    };
    let pictures = (0..=TURN).map(|t| picture(Some(t))).collect::<Result<Vec<_>>>()?;
    let empty = picture(None)?;
    tracker.init(&pictures[0], bbox(0))?;
    // A configuration may learn in every second frame: two in a row count together.
    let count = frames.max(1) + 1;
    let (mut times, mut was_lost) = (vec![], false);
    for index in 1..10 * frames + 100 {
        let t = index % (2 * TURN);
        // A picture comes from a decoder.
        let image = if lost && index > TURN { empty.clone() } else { pictures[t.min(2 * TURN - t)].clone() };
        let begin = now();
        let now_lost = !std::hint::black_box(tracker.update(&image)?).is_usable();
        if index > TURN && was_lost == lost && times.len() < count {
            times.push(1e3 * (now() - begin));
        }
        was_lost = now_lost;
        if times.len() == count {
            break;
        }
    }
    let mut times: Vec<f64> = times.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    times.sort_by(f64::total_cmp);
    let median = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
    Ok(FrameTime { median, best: times.first().copied().unwrap_or(f64::NAN) })
}

/// Frames that are not timed.
const WARM: usize = 5;

fn parts(precision: Precision, particles: usize, rng: &mut Rng) -> Result<Parts> {
    let unit = SIDE / 2.0;
    let dynamics = Autoregressive {
        damping: 1.0,
        velocity: 1.0 / unit,
        position: 2.0 / unit,
        scale_pull: 1.0,
        log_scale: 0.01,
        angle_pull: 1.0,
        angle: 0.02,
        ..Autoregressive::default()
    };
    let retina = Foveal::new(FovealConfig { side: SIDE, rings: vec![[12, 1], [24, 3], [48, 6]], colour: vec![] })?;
    let n_v = retina.glimpse_len();
    let mut normals = |n: usize, sd: f32| (0..n).map(|_| sd * rng.sample::<f32, _>(StandardNormal)).collect();
    let rbm = Rbm::new(Visible::Bernoulli, normals(n_v * HIDDEN, 0.05), vec![0.0; n_v], normals(HIDDEN, 0.1))?;
    let encoder = RbmEncoder::new(rbm, &vec![0; n_v]).rounded(precision);
    let appearance =
        GazeAppearance::new(Arc::new(retina), Arc::new(encoder), Kind::BhattacharyyaSquared, Sharpness::Fixed(20.0))?;
    let start = StartSpread { position: 0.0, velocity: 0.0, log_scale: 0.0, angle: 0.0, aspect: 0.0 };
    let filter = Filter::new(Box::new(Prior::new(Arc::new(dynamics))), particles)?.with_start(start);
    let gaze = GazeControl::new(Box::new(gaze::Fixed::new(Gaze::CENTRE)), Box::new(Concentration::new(1.0)?));
    let monitor = Monitor::new(ConsistencySettings::default(), ConfidenceModel::default());
    Ok(Parts::new(filter, gaze, Box::new(appearance), monitor))
}

/// Uniform noise under a Gaussian of 2 px.
fn noise(rng: &mut Rng) -> Result<Image> {
    let bytes: Vec<u8> = (0..WIDTH * HEIGHT).map(|_| rng.random()).collect();
    let weights: Vec<f32> = (-6..=6).map(|i| (-(i * i) as f32 / 8.0).exp()).collect();
    let total: f32 = weights.iter().sum();
    let blur = |from: &[f32], at: &dyn Fn(usize, usize, isize) -> usize| -> Vec<f32> {
        let pixel = |x: usize, y: usize| weights.iter().zip(-6..).map(|(w, i)| w * from[at(x, y, i)]).sum::<f32>();
        (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).map(|(x, y)| pixel(x, y) / total).collect()
    };
    let bytes: Vec<f32> = bytes.into_iter().map(f32::from).collect();
    let across = blur(&bytes, &|x, y, i| y * WIDTH + x.saturating_add_signed(i).min(WIDTH - 1));
    let both = blur(&across, &|x, y, i| y.saturating_add_signed(i).min(HEIGHT - 1) * WIDTH + x);
    Image::new(WIDTH, HEIGHT, 1, both.into_iter().map(|v| v.round() as u8).collect())
}

/// CPU seconds of this thread; of the wall clock where the system has no such clock.
fn now() -> f64 {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    // Linux brings a thread's account up to date when it gives way.
    std::thread::yield_now();
    let nanoseconds = || -> Option<f64> {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split(' ').next()?.parse().ok()
    };
    nanoseconds().map_or_else(|| START.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

fn main() {
    let frames = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(201);
    for (name, precision) in [("f32", Precision::F32), ("bf16", Precision::Bf16), ("int8", Precision::Int8)] {
        for n in [100, 500, 1000] {
            let time = frame(n, precision, frames).expect("the parts fit");
            println!(
                r#"{{"what": "tracker frame", "precision": "{name}", "n": {n}, "ms": {:.4}, "best_ms": {:.4}}}"#,
                time.median, time.best
            );
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    for targets in [1, 5, 10, 20] {
        let config = Config::builtin("multi").expect("it ships").and_then(|c| c.check(&Nowhere)).expect("it fits");
        let mut tracker = config.multi_tracker(1).expect("it fits");
        let time = pool.install(|| multi(&mut tracker, targets, frames)).expect("boxes in the picture");
        println!(
            r#"{{"what": "many targets", "targets": {targets}, "ms": {:.4}, "best_ms": {:.4}}}"#,
            time.median, time.best
        );
    }
    let sizes =
        [(320, 240), (640, 480), (1280, 720)].into_iter().flat_map(|size| [24, 48, 96].map(|side| (size, side)));
    for (name, (size, side)) in
        ["natural", "natural-fast"].into_iter().flat_map(|name| sizes.clone().map(move |s| (name, s)))
    {
        for lost in [false, true] {
            let time = pool.install(|| one(name, size.into(), side, lost, frames)).expect("a box in the picture");
            println!(
                r#"{{"what": "{name}", "picture": "{} x {}", "target": {side}, "lost": {lost}, "ms": {:.4}, "best_ms": {:.4}}}"#,
                size.0, size.1, time.median, time.best
            );
        }
    }
}
