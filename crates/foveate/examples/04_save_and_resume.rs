//! A tracker saved in mid-video goes on as if nothing had happened, to the last bit.
//!
//! One tracker runs through; another is saved as JSON text after frame 20, thrown away, and loaded into a new one.
//! `cargo run --release -p foveate --example 04_save_and_resume`

use foveate::config::Config;
use foveate::geometry::State;
use foveate::scene::synthetic::{Clutter, ClutterVideo, Drawn};
use foveate::scene::{Digits, Frame, Scene};
use foveate::tracker::Tracker;
use std::path::Path;

fn main() -> foveate::Result<()> {
    let video = Clutter { digit: 5, seed: 2, frames: 40, ..Clutter::default() }.video(&Digits::drawn(2, 20))?;
    let config = Config::builtin("digits").expect("digits ships with the library")?;
    let blueprint = config.check(Path::new("."))?;
    let new = || blueprint.tracker(1, 0);

    let mut through = new()?;
    through.start(&frame(&video, 0), video.truth()[0])?;
    let uninterrupted = follow(&mut through, &video, 1..40);

    let mut before = new()?;
    before.start(&frame(&video, 0), video.truth()[0])?;
    let mut resumed = follow(&mut before, &video, 1..20);
    let saved = before.save().to_string();
    drop(before);

    let mut after = new()?;
    after.load(&serde_json::from_str(&saved).expect("what save gives is JSON"))?;
    resumed.extend(follow(&mut after, &video, 20..40));

    println!("saved after frame 20: {} KiB of JSON", saved.len() / 1024);
    println!("last estimate, uninterrupted: {:?}", uninterrupted[38]);
    println!("last estimate, resumed:       {:?}", resumed[38]);
    assert_eq!(uninterrupted, resumed, "a resumed run must be the same, bit for bit");
    assert_eq!(through.save().to_string(), after.save().to_string(), "and so must be what is remembered");
    Ok(())
}

fn frame(video: &ClutterVideo, index: usize) -> Frame {
    Frame { index, time: index as f64 / 30.0, image: video.render(index) }
}

fn follow(tracker: &mut Tracker, video: &ClutterVideo, frames: std::ops::Range<usize>) -> Vec<State> {
    frames.map(|i| tracker.step(Scene { frame: &frame(video, i), detections: &[] }).estimate).collect()
}
