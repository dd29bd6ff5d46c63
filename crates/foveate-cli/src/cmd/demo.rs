//! `foveate demo`: the main job, with nothing downloaded by hand.

use std::path::PathBuf;
use std::time::Instant;

use foveate::config::Config;
use foveate::gaze::PolicySnapshot;
use foveate::lab::Digits;
use foveate::lab::eval::score_centres;
use foveate::lab::synthetic::{Clutter, Drawn};
use foveate::report::run::{SingleRun, Span, follow};
use foveate::report::{Summary, SurfacePicture};
use foveate::video::{Frame, FrameSource};
use foveate::{Error, Result};

use super::configure::{Changes, policy_kind, read};
use super::results::Results;
use super::track::outputs::{Outputs, run_info};
use super::track::spared::Lost;
use crate::terminal;

/// A centre farther off than this, in pixels, is off the digit: half its side.
const OFF: f64 = 14.0;

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
    /// A configuration file, or the name of one that ships with the program and is for digits (digits, digits-rbm, ...)
    #[arg(long, short, value_name = "FILE|NAME", default_value = "digits-hedge")]
    config: String,
    #[command(flatten)]
    changes: Changes,
    /// Write trace.jsonl too: every intermediate quantity of every frame
    #[arg(long)]
    trace: bool,
}

pub fn run(args: Args) -> Result<()> {
    fits(&args.config)?;
    let (config, folder) = read(&args.config, &args.changes)?;
    let blueprint = config.check(&folder)?;
    let scene = Clutter { digit: args.digit, seed: args.seed, ..Clutter::default() };
    let video = scene.video(&Digits::drawn(args.seed, 20))?;
    let truth = video.truth().to_vec();
    let mut source = video.source();
    let mut tracker = blueprint.tracker(args.seed)?;
    let described = format!("a drawn {} among {} other digits", args.digit, scene.distractors);
    let name = args.changes.describe(&args.config);
    let mut info = run_info(&described, source.info(), &name, &blueprint, args.seed);
    info.truth = truth.clone();
    let surface = SurfacePicture::shows(tracker.parts().gaze.policy().snapshot());
    let outputs = Outputs { video: true, report: true, surface, trace: args.trace, regret: false, endless: false };
    terminal::catch_interrupts();
    let results = Results::begin(&args.out, &outputs.names(), &[args.config.as_ref()])?;
    let lost = Lost::default();
    let mut observers = outputs.observers(results.folder(), &info, &lost)?;

    let began = Instant::now();
    let bar = terminal::progress(source.info().frames, "demo");
    let mut progress = |_: &Frame| bar.inc(1);
    let (stop, clock, progress) =
        (&terminal::stopping, info.clock.clone(), Some(&mut progress as &mut dyn FnMut(&Frame)));
    let run = SingleRun { init: Some(truth[0]), span: Span { stop, clock, progress, ..Span::default() }, again: &[] };
    let (outcome, result) = follow(&mut source, &mut tracker, &mut observers, run);
    bar.finish_and_clear();
    drop(observers);
    result.and(lost.check())?;
    if outcome.tracked == 0 {
        let out = args.out.display();
        return Err(Error::Invalid(format!(
            "stopped before the second frame: nothing was tracked; {out} was left as it was"
        )));
    }
    results.keep()?;
    let centres = |boxes: &[foveate::geometry::BBox]| boxes.iter().map(|b| b.centre()).collect::<Vec<_>>();
    let (ours, real) = (centres(&outcome.boxes), centres(&truth[..outcome.boxes.len()]));
    let score = score_centres(&ours, &real)?;
    let off = ours.iter().zip(&real).filter(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1) > OFF).count();
    let frames = outcome.frames.count;
    match off {
        0 => say!("Followed {described} through {frames} frames."),
        _ => say!(
            "Tried to follow {described} through {frames} frames, and was off it by more than {OFF} px in {off} of them."
        ),
    }
    say!("Mean error {:.2} px, median {:.2} px.", score.mean, score.median);
    say!("Reported as uncertain in {} frames, as lost in {}.", outcome.uncertain, outcome.lost);
    say!("{}", favourite(tracker.parts().gaze.policy().snapshot(), &policy_kind(blueprint.config())));
    let tracking = Summary::rate(frames, outcome.frames.time().as_secs_f64());
    let whole = Summary::rate(frames, began.elapsed().as_secs_f64());
    say!("{tracking:.0} frames a second in the tracker, {whole:.0} end to end.");
    say!("See what it saw, frame by frame: {}", args.out.join("report.html").display());
    if outcome.frames.stopped {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}

/// Refuses configurations that ship for real video: on strokes on black they lose the digit.
fn fits(name: &str) -> Result<()> {
    let real = |name: &str| name.starts_with("natural") || name.starts_with("multi");
    let mut fitting = Config::names();
    if !(fitting.contains(&name) && real(name)) {
        return Ok(());
    }
    fitting.retain(|name| name.starts_with("digits"));
    Err(Error::Config(format!(
        "{name} is a configuration for real video, and the demo draws digits on black; give --config one of {}, or use {name} \
         on a video of yours: foveate track VIDEO --init x,y,w,h --config {name}",
        fitting.join(", ")
    )))
}

/// Which gaze the policy has come to prefer, in words.
fn favourite(learned: PolicySnapshot<'_>, policy: &str) -> String {
    let place = |u: f64, v: f64| format!("({u:+.1}, {v:+.1}) of the box (0, 0 is its centre, 1 its edge)");
    match learned {
        PolicySnapshot::Arms { gazes, probabilities } if gazes.len() > 1 => {
            let best = (0..gazes.len()).max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(0);
            let (g, p) = (gazes[best], probabilities[best]);
            format!("It learned to look at {} with probability {p:.2}.", place(g.u, g.v))
        }
        PolicySnapshot::Surface(surface) => match surface.best() {
            Some(g) => {
                let (mean, sd) = surface.at(g.u, g.v);
                let looks = surface.fixations().len();
                let place = place(g.u, g.v);
                format!("It learned from {looks} looks that {place} is worth most: a reward of {mean:.3} ± {sd:.3}.")
            }
            None => "It has not learned yet where to look.".into(),
        },
        _ => format!("Its policy, {policy}, has nothing to learn; try --policy hedge or --policy gp-ucb."),
    }
}
