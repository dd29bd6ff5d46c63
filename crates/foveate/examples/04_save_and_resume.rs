//! A tracker saved in mid-video continues bit for bit.
//!
//! One tracker runs through; another is saved as JSON text after frame 20, thrown away, and loaded into a new one.
//! `cargo run --release -p foveate --features lab --example 04_save_and_resume`

use foveate::Tracker;
use foveate::config::Config;
use foveate::files::Folder;
use foveate::geometry::State;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, ClutterVideo, Drawn};
use std::ops::Range;

fn main() -> foveate::Result<()> {
    let video = Clutter { digit: 5, seed: 2, frames: 40, ..Clutter::default() }.video(&Digits::drawn(2, 20))?;
    let config = Config::builtin("digits").expect("digits ships with the library")?;
    let blueprint = config.check(&Folder::here())?;
    let new = || blueprint.tracker(1);

    let mut through = new()?;
    through.init(&video.render(0), video.truth()[0])?;
    let uninterrupted = follow(&mut through, &video, 1..40)?;

    let mut before = new()?;
    before.init(&video.render(0), video.truth()[0])?;
    let mut resumed = follow(&mut before, &video, 1..20)?;
    let saved = before.save().to_string();
    drop(before);

    let mut after = new()?;
    after.load(&saved.parse()?)?;
    resumed.extend(follow(&mut after, &video, 20..40)?);

    println!("saved after frame 20: {} KiB of JSON", saved.len() / 1024);
    println!("last estimate, uninterrupted: {:?}", uninterrupted[38]);
    println!("last estimate, resumed:       {:?}", resumed[38]);
    assert_eq!(uninterrupted, resumed, "a resumed run must be the same, bit for bit");
    assert_eq!(through.save().to_string(), after.save().to_string(), "and so must be what is remembered");
    Ok(())
}

fn follow(tracker: &mut Tracker, video: &ClutterVideo, frames: Range<usize>) -> foveate::Result<Vec<State>> {
    frames.map(|i| Ok(tracker.update(&video.render(i))?.state)).collect()
}
