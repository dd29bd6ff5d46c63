//! The time of a frame with many targets and few looks: it should be that of the looks, however many targets there are.
//!
//! Digits of 28 px as in `paper reproduce objects`, drawn by a pen, on a canvas as dense as there; so many looks a frame, one thread.
//!
//! `cargo bench --features lab --bench attention -- [frames]`; one JSON line a figure.

use std::time::Instant;

use foveate::config::Config;
use foveate::files::Nowhere;
use foveate::lab::Digits;
use foveate::lab::synthetic::Multi;
use foveate::{MultiTracker, Result};

/// Milliseconds of a frame, the median of `frames`.
fn time(targets: usize, budget: usize, frames: usize) -> Result<f64> {
    let side = |of_1000: f64| (of_1000 * (targets as f64 / 1000.0).sqrt()).max(120.0) as usize;
    let settings = Multi {
        targets,
        frames: frames + 1,
        width: side(2400.0),
        height: side(1800.0),
        scale: [1.0, 1.0],
        turn: 0.0,
        speed: [0.05, 1.0],
        crossings: 0,
        ..Multi::default()
    };
    let video = settings.video(&Digits::drawn(3, 2))?;
    let changes = [
        "particles=300".into(),
        "dynamics.velocity=0.002".into(),
        "dynamics.position=0.002".into(),
        "start.velocity=0.05".into(),
        "redetection.every=1000000".into(),
        "multi_target.occlusion.explain=0.0".into(),
        format!("multi_target.attention.budget={budget}"),
    ];
    let config = Config::builtin("digits-multi").expect("it ships")?;
    let config = changes.iter().try_fold(config, |config, change| config.set(change))?;
    let mut tracker: MultiTracker = config.check(&Nowhere)?.multi_tracker(1)?;
    let first = video.render(0);
    tracker.update(&first, &[])?;
    for mover in video.movers() {
        tracker.add(&first, None, mover.bbox(0))?;
    }
    let mut times = vec![];
    for t in 1..=frames {
        let image = video.render(t);
        let begin = Instant::now();
        std::hint::black_box(tracker.update(&image, &[])?);
        times.push(1e3 * begin.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

fn main() {
    let frames = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(41);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    for budget in [10, 50] {
        for targets in [10, 30, 100, 300, 1000] {
            let ms = pool.install(|| time(targets, budget, frames)).expect("room for all");
            println!(r#"{{"what": "attention", "looks": {budget}, "targets": {targets}, "ms": {ms:.3}}}"#);
        }
    }
}
