//! The whole loop on the paper's first experiment: a digit moves among static ones, and Hedge learns where to look.
//!
//! `cargo run --release -p foveate --features lab --example 03_track_a_digit`

use foveate::config::Config;
use foveate::files::Folder;
use foveate::gaze::PolicySnapshot;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, Drawn};

const FRAMES: usize = 60;

fn main() -> foveate::Result<()> {
    // The world: frame 1 and FRAMES more, with the true box of each.
    let video = Clutter { digit: 3, seed: 7, frames: FRAMES + 1, ..Clutter::default() }.video(&Digits::drawn(7, 20))?;
    let truth = video.truth().to_vec();
    let mut frames = video.source();

    // The tracker: the configuration that `foveate demo` uses.
    let config = Config::builtin("digits").expect("digits ships with the library")?;
    let mut tracker = config.check(&Folder::here())?.tracker(1)?;

    // Frame 1 gives the box; from then on only pixels are seen.
    let first = frames.next().expect("the video has frames")?;
    tracker.init(&first.image, truth[0])?;
    let mut errors = vec![];
    println!("frame   truth (x, y)    estimate     error   ESS");
    for frame in frames {
        let frame = frame?;
        let step = tracker.update(&frame.image)?;
        let ((x, y), estimate) = (truth[frame.index].centre(), step.state);
        errors.push((estimate.x - x).hypot(estimate.y - y));
        if frame.index % 10 == 0 {
            let (i, error) = (frame.index, errors[errors.len() - 1]);
            println!("{i:5}  {x:6.1} {y:6.1}  {:6.1} {:6.1}  {error:5.2}  {:5.1}", estimate.x, estimate.y, step.ess);
        }
    }

    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    println!("mean error over {} frames: {mean:.2} px", errors.len());
    if let PolicySnapshot::Arms { gazes, probabilities } = tracker.parts().gaze.policy().snapshot() {
        for (gaze, p) in gazes.iter().zip(probabilities) {
            println!("gaze ({:+.1}, {:+.1})  probability {p:.3}", gaze.u, gaze.v);
        }
    }
    assert_eq!(errors.len(), FRAMES);
    assert!(mean < 2.0, "the target must be held");
    Ok(())
}
