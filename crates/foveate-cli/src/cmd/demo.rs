//! Implements `foveate demo`: tracks a drawn digit and compares a learned gaze policy with fixed and random gazes. It needs no download.

use std::path::PathBuf;
use std::time::Instant;

use foveate::config::{Config, PolicyConfig};
use foveate::gaze::PolicySnapshot;
use foveate::geometry::BBox;
use foveate::lab::Digits;
use foveate::lab::eval::score_centres;
use foveate::lab::synthetic::{Clutter, Drawn, GLIMPSE, Occlusion, Synthetic};
use foveate::report::run::{self, RunPlan};
use foveate::report::{Baseline, SideBySide, SurfacePicture};
use foveate::text::counted;
use foveate::video::{Frame, FrameSource};
use foveate::{Error, Result};

use super::configure::{Changes, read};
use super::results::{Ended, Results};
use super::track::outputs::{Outputs, run_info};
use super::track::tolerant::FailedOutputs;
use crate::terminal;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Output folder; open report.html in it
    #[arg(long, short, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Scene to draw
    #[arg(long, value_enum, default_value_t = Scene::Glimpse)]
    scene: Scene,
    /// Digit to follow, 0 to 9 [default: 2 with small glimpses, 3 in clutter]
    #[arg(long, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: Option<u8>,
    /// Random seed of the scene and the tracker; the same seed gives the same run
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Configuration file, or the name of a shipped configuration for digits [default: digits-partial with a smaller glimpse, digits-hedge
    /// in clutter]
    #[arg(long, short, value_name = "FILE|NAME")]
    config: Option<String>,
    #[command(flatten)]
    changes: Changes,
    /// Also write trace.jsonl: every intermediate quantity of every frame
    #[arg(long)]
    trace: bool,
}

/// The digit of the glimpse scene: few places of a 2 locate it, and its centre is not one of them.
const DIGIT: u8 = 2;

/// Target bit rate of the film, bits per second.
const BIT_RATE: f64 = 6e6;

impl Args {
    /// Returns whether [`TEN_SEEDS`] summarises runs with these arguments.
    fn is_usual(&self) -> bool {
        let Self { scene, digit, config, changes, .. } = self;
        let as_shipped = config.is_none() && changes.policy.is_none() && changes.set.is_empty();
        *scene == Scene::Glimpse && digit.is_none_or(|digit| digit == DIGIT) && as_shipped
    }
}

#[derive(clap::ValueEnum, Clone, Copy, PartialEq)]
enum Scene {
    /// A digit behind bars under 30 % noise; a glimpse covers 25 of its 784 pixels
    Glimpse,
    /// A digit among digits
    Clutter,
}

/// Mean error of ten runs of the default scene of `foveate demo`, and its standard deviation over the runs. The section "The demo" of
/// docs/looking.md has the command.
const TEN_SEEDS: &str =
    "Over ten runs of this scene GP-UCB is 4.5 ± 5.6 px off, the fixed centre 7.1 ± 5.4 px, random gazes 10.6 ± 9.7 px";

impl Scene {
    /// Returns the scene, its description, and its configuration with the changes to it.
    fn draw(self, digit: Option<u8>, seed: u64) -> (Synthetic, String, &'static str, &'static [&'static str]) {
        match self {
            Self::Glimpse => {
                // The canvas is small and shown enlarged. The film has two thirds of the usual length, because three panes take time to
                // draw.
                let (digit, side) = (digit.unwrap_or(DIGIT), 160);
                let scene = Occlusion { digit, seed, frames: 200, width: side, height: side, ..Occlusion::default() };
                let words = format!(
                    "a drawn {} of {} px behind bars and under {:.0} % noise, by looks of 5 x 5 pixels",
                    scene.digit,
                    scene.side,
                    100.0 * scene.noise
                );
                (Synthetic::Occlusion(scene), words, "digits-partial", &GLIMPSE)
            }
            Self::Clutter => {
                let scene = Clutter { digit: digit.unwrap_or(3), seed, ..Clutter::default() };
                let words = format!("a drawn {} among {} other digits", scene.digit, scene.distractors);
                (Synthetic::Clutter(scene), words, "digits-hedge", &[])
            }
        }
    }
}

/// Baseline policies without learning, and the names of their gazes.
const UNLEARNED: [(&str, &str); 2] = [("fixed", "fixed centre"), ("random", "random gazes")];

pub(crate) fn run(args: Args) -> Result<()> {
    let (scene, described, fitting, usual) = args.scene.draw(args.digit, args.seed);
    let config_name = args.config.as_deref().unwrap_or(fitting);
    fits(config_name)?;
    let usual = if args.config.is_some() { &[] } else { usual };
    let set = usual.iter().map(ToString::to_string).chain(args.changes.set.clone()).collect();
    let changes = Changes { policy: args.changes.policy.clone(), set };
    let (config, folder) = read(config_name, &changes)?;
    let (policy, learning) = (config.policy_kind(), learns(&config.policy));
    let mut others = vec![];
    for (kind, name) in UNLEARNED.into_iter().filter(|(kind, _)| *kind != policy) {
        others.push((config.clone().with_policy(kind)?.check(&folder)?.tracker(args.seed)?, Baseline::new(name)));
    }
    let blueprint = config.check(&folder)?;
    let video = scene.video(&Digits::drawn(args.seed, 20))?;
    let truth = video.truth().to_vec();
    let mut source = video.source();
    let mut tracker = blueprint.tracker(args.seed)?;
    let mut info = run_info(&described, source.info(), &changes.describe(config_name), &blueprint, args.seed);
    info.truth = truth.iter().copied().map(Some).collect();
    // Noise compresses badly: without a target bit rate the film is ten times as large.
    info.bit_rate = Some(BIT_RATE);
    info.baselines = others.iter().map(|(_, baseline)| baseline.clone()).collect();
    let surface = SurfacePicture::shows(tracker.parts().gaze.policy().snapshot());
    let outputs = Outputs { report: true, surface, trace: args.trace, ..Outputs::default() };
    let names = [&outputs.names()[..], &["annotated.mp4"]].concat();
    terminal::catch_interrupts();
    let results = Results::begin(&args.out, &names, &[config_name.as_ref()])?;
    let failed = FailedOutputs::default();
    let mut observers = outputs.observers(results.folder(), &info, &failed)?;
    // Run the same tracker with policies that learn nothing on the same frames.
    let path = results.folder().join("annotated.mp4");
    let name = format!("{}gaze: {policy}", if learning { "learned " } else { "" });
    let film = SideBySide::create(path, &info, name, others)?;
    observers.push(failed.tolerate(&["annotated.mp4"], film, usize::MAX));

    let began = Instant::now();
    let bar = terminal::progress(source.info().frames, "demo");
    let mut progress = |_: &Frame| bar.inc(1);
    let (stop, clock, progress) =
        (&terminal::stopping, info.clock.clone(), Some(&mut progress as &mut dyn FnMut(&Frame)));
    let plan = RunPlan { init: Some(truth[0]), stop, clock, progress, ..RunPlan::default() };
    let (summary, result) = run::run(&mut source, &mut tracker, &mut observers, plan);
    bar.finish_and_clear();
    drop(observers);
    result.and(failed.check(&[]).map_err(|error| results.with_final_path(&error)))?;
    if summary.tracked == 0 {
        let out = args.out.display();
        return Err(Error::Invalid(format!(
            "stopped before the second frame: nothing was tracked; {out} is unchanged"
        )));
    }
    let ended = if summary.stopped { Ended::Stopped } else { Ended::Finished };
    results.keep(ended, summary.frames, None)?;
    let frames = summary.frames;
    say!("Followed {described}, through {}.", counted(frames, "frame"));
    tell(&policy, &summary.boxes, &truth, summary.values / summary.tracked)?;
    for baseline in &info.baselines {
        tell(baseline.name(), &baseline.boxes(), &truth, baseline.values() / summary.tracked)?;
    }
    if args.is_usual() {
        say!("One run is luck. {TEN_SEEDS} (docs/looking.md).");
    }
    say!("Reported as occluded in {}, as lost in {}.", counted(summary.occluded, "frame"), summary.lost);
    let learned = learning.then(|| favourite(tracker.parts().gaze.policy().snapshot())).flatten();
    let nothing = || format!("Its policy, {policy}, has nothing to learn; try --policy hedge or --policy gp-ucb.");
    say!("{}", learned.unwrap_or_else(nothing));
    if args.scene == Scene::Glimpse {
        say!("A larger window covers most of the digit at any gaze, and the fixed centre is as good: --scene clutter.");
    }
    let tracking = summary.fps(summary.spent.as_secs_f64());
    let whole = summary.fps(began.elapsed().as_secs_f64());
    say!("{} a second in the tracker, {whole:.0} end to end.", counted(tracking.round() as usize, "frame"));
    say!("Frame by frame: {}; all side by side: annotated.mp4", args.out.join("report.html").display());
    if summary.stopped {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}

/// Prints the comparison of a track with the ground truth.
fn tell(policy: &str, boxes: &[BBox], truth: &[BBox], values: usize) -> Result<()> {
    let centres = |boxes: &[BBox]| boxes.iter().map(BBox::centre).collect::<Vec<_>>();
    let (ours, real) = (centres(boxes), centres(&truth[..boxes.len()]));
    let score = score_centres(&ours, &real)?;
    // Half a side: at a larger distance the estimated centre is off the digit.
    let most = truth[0].w / 2.0;
    let off = ours.iter().zip(&real).filter(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1) > most).count();
    let (mean, median) = (score.mean, score.median);
    say!(
        "  {policy:<12} mean error {mean:.2} px, median {median:.2}; more than {most} px off in {}; {values} values read a frame",
        counted(off, "frame")
    );
    Ok(())
}

/// Refuses configurations for real video: they lose digits made of strokes on black.
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

/// Returns whether a policy learns where to look.
fn learns(policy: &PolicyConfig) -> bool {
    match policy {
        PolicyConfig::Fixed { .. } | PolicyConfig::Random { .. } | PolicyConfig::Circular { .. } => false,
        PolicyConfig::Anchor { policy } => learns(policy),
        _ => true,
    }
}

/// Describes the gaze that the policy prefers; `None` if it has no choice.
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
    use foveate::lab::eval::experiment::Run;

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

    /// The demo's claim: over three seeds the learned gaze has a smaller error than both baselines.
    #[test]
    fn a_learned_gaze_is_ahead_of_both_others() {
        let error = |policy: &str, seed: u64| {
            let (scene, _, name, changes) = Scene::Glimpse.draw(None, seed);
            let set = changes.iter().map(ToString::to_string).collect();
            let (config, folder) = read(name, &Changes { policy: Some(policy.into()), set }).expect("it ships");
            let mut tracker = config.check(&folder).expect("it fits").tracker(seed).expect("a tracker");
            let video = scene.video(&Digits::drawn(seed, 20)).expect("a scene");
            Run::follow(&*video, &mut tracker).expect("it tracks").score().expect("frames").mean
        };
        let of = |policy: &str| [1, 2, 3].map(|seed| error(policy, seed));
        let [learned, fixed, random] = ["gp-ucb", "fixed", "random"].map(of);
        let mean = |errors: [f64; 3]| errors.iter().sum::<f64>() / 3.0;
        let ahead = mean(learned) < mean(fixed) && mean(learned) < mean(random);
        assert!(ahead, "learned {learned:?}, fixed {fixed:?}, random {random:?}");
    }
}
