//! `foveate demo`: the main job, and what learning where to look is worth, with nothing downloaded by hand.

use std::path::PathBuf;
use std::time::Instant;

use foveate::config::{Config, PolicyConfig};
use foveate::gaze::PolicySnapshot;
use foveate::geometry::BBox;
use foveate::lab::Digits;
use foveate::lab::eval::score_centres;
use foveate::lab::synthetic::{Clutter, Drawn, Occlusion, Synthetic};
use foveate::report::run::{SingleRun, Span, follow};
use foveate::report::{Baseline, SideBySide, Summary, SurfacePicture};
use foveate::video::{Frame, FrameSource};
use foveate::{Error, Result};

use super::configure::{Changes, read};
use super::results::{Ended, Results};
use super::track::outputs::{Outputs, run_info};
use super::track::spared::Lost;
use crate::terminal;

#[derive(clap::Args)]
pub struct Args {
    /// Folder for the results; open report.html in it
    #[arg(long, short, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// What is drawn
    #[arg(long, value_enum, default_value_t = Scene::Closeup)]
    scene: Scene,
    /// The digit to follow, 0 to 9 [default: 0 in a close-up, 3 in clutter]
    #[arg(long, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: Option<u8>,
    /// Seed of the scene and of the tracker: the same seed gives the same run
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// A configuration file, or the name of one that ships with the program and is for digits [default: digits-closeup in a
    /// close-up, digits-hedge in clutter]
    #[arg(long, short, value_name = "FILE|NAME")]
    config: Option<String>,
    #[command(flatten)]
    changes: Changes,
    /// Write trace.jsonl too: every intermediate quantity of every frame
    #[arg(long)]
    trace: bool,
}

#[derive(clap::ValueEnum, Clone, Copy)]
enum Scene {
    /// One large digit whose middle is hidden; a look sees a 12th of it
    Closeup,
    /// A digit among digits
    Clutter,
}

impl Scene {
    /// The scene itself, what it shows in words, and the configuration for it.
    fn draw(self, digit: Option<u8>, seed: u64) -> (Synthetic, String, &'static str) {
        match self {
            Self::Closeup => {
                let digit = digit.unwrap_or(0);
                let scene = Occlusion {
                    bars: 0,
                    patch: 8,
                    noise: 0.02,
                    ..Occlusion { digit, seed, side: 56, width: 256, height: 256, ..Occlusion::default() }
                };
                let words =
                    format!("a drawn {digit} of {} px, its middle hidden, by looks of a 12th of it", scene.side);
                (Synthetic::Occlusion(scene), words, "digits-closeup")
            }
            Self::Clutter => {
                let scene = Clutter { digit: digit.unwrap_or(3), seed, ..Clutter::default() };
                let words = format!("a drawn {} among {} other digits", scene.digit, scene.distractors);
                (Synthetic::Clutter(scene), words, "digits-hedge")
            }
        }
    }
}

pub fn run(args: Args) -> Result<()> {
    let (scene, described, fitting) = args.scene.draw(args.digit, args.seed);
    let config_name = args.config.as_deref().unwrap_or(fitting);
    fits(config_name)?;
    let (config, folder) = read(config_name, &args.changes)?;
    let (policy, learning) = (config.policy_kind(), learns(&config.policy));
    let centred = if policy == "fixed" { None } else { Some(config.set("policy.kind=fixed")?.check(&folder)?) };
    let blueprint = config.check(&folder)?;
    let video = scene.video(&Digits::drawn(args.seed, 20))?;
    let truth = video.truth().to_vec();
    let mut source = video.source();
    let mut tracker = blueprint.tracker(args.seed)?;
    let mut info = run_info(&described, source.info(), &args.changes.describe(config_name), &blueprint, args.seed);
    info.truth = truth.iter().copied().map(Some).collect();
    info.baseline = centred.as_ref().map(|_| Baseline::new("fixed centre"));
    let surface = SurfacePicture::shows(tracker.parts().gaze.policy().snapshot());
    let film = centred.is_none();
    let outputs = Outputs { video: film, report: true, surface, trace: args.trace, regret: false, endless: false };
    let mut names = outputs.names();
    if !film {
        names.push("annotated.mp4");
    }
    terminal::catch_interrupts();
    let results = Results::begin(&args.out, &names, &[config_name.as_ref()])?;
    let lost = Lost::default();
    let mut observers = outputs.observers(results.folder(), &info, &lost)?;
    // The same tracker with its gaze held at the centre, on the same frames: what the learned gaze is compared with.
    if let (Some(centred), Some(baseline)) = (&centred, &info.baseline) {
        let (path, name) = (
            results.folder().join("annotated.mp4"),
            format!("{}gaze: {policy}", if learning { "learned " } else { "" }),
        );
        let film = SideBySide::create(path, &info, name, centred.tracker(args.seed)?, baseline.clone())?;
        observers.push(Box::new(lost.spare(&["annotated.mp4"], film)));
    }

    let began = Instant::now();
    let bar = terminal::progress(source.info().frames, "demo");
    let mut progress = |_: &Frame| bar.inc(1);
    let (stop, clock, progress) =
        (&terminal::stopping, info.clock.clone(), Some(&mut progress as &mut dyn FnMut(&Frame)));
    let run = SingleRun { init: Some(truth[0]), span: Span { stop, clock, progress, ..Span::default() }, again: &[] };
    let (outcome, result) = follow(&mut source, &mut tracker, &mut observers, run);
    bar.finish_and_clear();
    drop(observers);
    result.and(lost.check().map_err(|error| results.told(&error)))?;
    if outcome.tracked == 0 {
        let out = args.out.display();
        return Err(Error::Invalid(format!(
            "stopped before the second frame: nothing was tracked; {out} was left as it was"
        )));
    }
    let ended = if outcome.frames.stopped { Ended::Stopped } else { Ended::Finished };
    results.keep(ended, outcome.frames.count, Ok(()))?;
    let frames = outcome.frames.count;
    say!("Followed {described}, through {frames} frames.");
    tell(&policy, &outcome.boxes, &truth, outcome.values / outcome.tracked)?;
    if let Some(baseline) = &info.baseline {
        tell(baseline.name(), &baseline.boxes(), &truth, baseline.values() / outcome.tracked)?;
    }
    say!("Reported as occluded in {} frames, as lost in {}.", outcome.occluded, outcome.lost);
    let learned = learning.then(|| favourite(tracker.parts().gaze.policy().snapshot())).flatten();
    let nothing = || format!("Its policy, {policy}, has nothing to learn; try --policy hedge or --policy gp-ucb.");
    say!("{}", learned.unwrap_or_else(nothing));
    if matches!(args.scene, Scene::Closeup) && args.digit.is_none() {
        say!("The centre of this 0 tells nothing. Where it does, the fixed centre is as good: --scene clutter.");
    }
    let tracking = Summary::rate(frames, outcome.frames.spent.as_secs_f64());
    let whole = Summary::rate(frames, began.elapsed().as_secs_f64());
    say!("{tracking:.0} frames a second in the tracker, {whole:.0} end to end.");
    let beside = if film { "" } else { "; both side by side: annotated.mp4" };
    say!("See what it saw, frame by frame: {}{beside}", args.out.join("report.html").display());
    if outcome.frames.stopped {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}

/// How a track compares with the truth.
fn tell(policy: &str, boxes: &[BBox], truth: &[BBox], values: usize) -> Result<()> {
    let centres = |boxes: &[BBox]| boxes.iter().map(BBox::centre).collect::<Vec<_>>();
    let (ours, real) = (centres(boxes), centres(&truth[..boxes.len()]));
    let score = score_centres(&ours, &real)?;
    // Half a side: farther off than this, the centre is off the digit.
    let most = truth[0].w / 2.0;
    let off = ours.iter().zip(&real).filter(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1) > most).count();
    let (mean, median) = (score.mean, score.median);
    say!(
        "  {policy:<12} mean error {mean:.2} px, median {median:.2}; more than {most} px off in {off} frames; {values} values read a frame"
    );
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

/// Whether a policy learns where to look.
fn learns(policy: &PolicyConfig) -> bool {
    match policy {
        PolicyConfig::Fixed { .. } | PolicyConfig::Random { .. } | PolicyConfig::Circular { .. } => false,
        PolicyConfig::Anchor { policy } => learns(policy),
        _ => true,
    }
}

/// Which gaze the policy has come to prefer, in words; none where it has no choice.
fn favourite(learned: PolicySnapshot<'_>) -> Option<String> {
    let place = |u: f64, v: f64| format!("({u:+.1}, {v:+.1}) of the box (0, 0 is its centre, 1 its edge)");
    match learned {
        PolicySnapshot::Arms { gazes, probabilities } if gazes.len() > 1 => {
            let best = (0..gazes.len()).max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(0);
            let (g, p) = (gazes[best], probabilities[best]);
            Some(format!("It learned to look at {} with probability {p:.2}.", place(g.u, g.v)))
        }
        PolicySnapshot::Surface(surface) => Some(match surface.best() {
            Some(g) => {
                let (mean, sd) = surface.at(g.u, g.v);
                let looks = surface.fixations().len();
                let place = place(g.u, g.v);
                format!("It learned from {looks} looks that {place} is worth most: a reward of {mean:.3} ± {sd:.3}.")
            }
            None => "It has not learned yet where to look.".into(),
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_policies_learn_nothing() {
        for (name, expected) in
            [("fixed", false), ("random", false), ("circular", false), ("hedge", true), ("gp-ucb", true)]
        {
            let changes = Changes { policy: Some(name.into()), set: vec![] };
            let policy = read("digits-closeup", &changes).expect("it ships").0.policy;
            assert_eq!(learns(&policy), expected, "{name}");
            assert_eq!(learns(&PolicyConfig::Anchor { policy: policy.into() }), expected, "{name}, anchored");
        }
    }
}
