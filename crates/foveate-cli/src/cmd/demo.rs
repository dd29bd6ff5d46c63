//! `foveate demo`: the main job, with nothing downloaded by hand.

use std::path::PathBuf;

use foveate::eval::score_centres;
use foveate::run::{Follow, follow};
use foveate::scene::synthetic::{Clutter, Drawn};
use foveate::scene::{Digits, FrameSource};
use foveate::{Error, Result};

use super::track::{Outputs, blueprint, observers, run_info};
use crate::terminal;

#[derive(clap::Args)]
pub struct Args {
    /// Folder for the results; open report.html in it
    #[arg(long, short, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// The digit to follow, 0 to 9
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: u8,
    /// Seed of the scene and of the tracker: the same seed gives the same run
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// A configuration file, or the name of one that ships with the program (digits, natural, ...)
    #[arg(long, short, value_name = "FILE|NAME", default_value = "digits-hedge")]
    config: String,
}

pub fn run(args: Args) -> Result<()> {
    let scene = Clutter { digit: args.digit, seed: args.seed, ..Clutter::default() };
    let video = scene.video(&Digits::drawn(args.seed, 20))?;
    let truth = video.truth().to_vec();
    let mut source = video.source();
    let blueprint = blueprint(&args.config)?;
    let mut tracker = blueprint.tracker(args.seed, 0)?;
    let described = format!("a drawn {} among {} other digits", args.digit, scene.distractors);
    let mut info = run_info(&described, source.info(), &args.config, &blueprint, args.seed);
    info.truth = truth.clone();
    let (mut observers, _) = observers(&args.out, &info, Outputs { video: true, report: true, trace: true })?;

    terminal::catch_interrupts();
    let bar = terminal::progress(source.info().frames, "demo");
    let plan = Follow {
        init: Some(truth[0]),
        again: &[],
        from: 0,
        until: usize::MAX,
        stop: &terminal::stopping,
        clock: info.clock.clone(),
        progress: &mut |_| bar.inc(1),
    };
    let (outcome, result) = follow(&mut source, &mut tracker, &mut observers, plan);
    bar.finish_and_clear();
    result?;
    if outcome.boxes.len() < 2 {
        return Err(Error::Invalid("stopped before the second frame: nothing to report".into()));
    }
    let centres = |boxes: &[foveate::geometry::BBox]| boxes.iter().map(|b| b.centre()).collect::<Vec<_>>();
    let score = score_centres(&centres(&outcome.boxes), &centres(&truth[..outcome.boxes.len()]))?;
    let last = tracker_favourite(&tracker);
    say!("Followed {described} through {} frames.", outcome.frames);
    say!("Mean error {:.2} px, median {:.2} px; believed lost on {} frames.", score.mean, score.median, outcome.lost);
    say!("{last}");
    say!("{:.0} frames a second in the tracker.", outcome.frames as f64 / outcome.tracking.as_secs_f64());
    say!("See what it saw, frame by frame: {}", args.out.join("report.html").display());
    Ok(())
}

/// Which gaze the policy has come to prefer, in words.
fn tracker_favourite(tracker: &foveate::tracker::Tracker) -> String {
    use foveate::gaze::Portrait;
    match tracker.parts().policy.portrait() {
        Portrait::Arms { gazes, probabilities } if gazes.len() > 1 => {
            let best = (0..gazes.len()).max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(0);
            let (g, p) = (gazes[best], probabilities[best]);
            format!(
                "It learned to look at ({:+.1}, {:+.1}) of the box (0, 0 is its centre) with probability {p:.2}.",
                g.u, g.v
            )
        }
        _ => "Its policy has nothing to learn.".into(),
    }
}
