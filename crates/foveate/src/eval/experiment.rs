//! The paper's experiments on synthetic digits as tables (sections 6.1 and 6.2): policy by policy on the same videos.
//!
//! A [`Run`] is one tracker on one synthetic video: the distance of centres in every frame from the second on,
//! as the authors measure it. A [`Line`] sums up the runs of one configuration and policy, beside those of the
//! fixed centre on the same videos: the paper lacks that baseline, and spread.

use std::time::Instant;

use rand::RngExt;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::centres::{CentreScore, CentreSummary, score_centres};
use super::metrics::{centre_error, mean_sd};
use super::table::aligned;
use crate::config::Blueprint;
use crate::rng::Streams;
use crate::scene::synthetic::{Clutter, Drawn, NOISE};
use crate::scene::{Digits, Frame, Scene};
use crate::tracker::Tracker;
use crate::{Error, Result};

/// A centre error above this, pixels, is off the target: half a digit.
pub const OFF: f64 = 14.0;

/// What others have on videos of digits among distractors, to print below the table.
pub const CLUTTER_PEERS: &str = "\
Others, on ten videos of the same kind (noise 30 % | none; mean error of upper-left corners, lost = mean above 28 px):
  dlib correlation_tracker   6.7 px, median 0.8, 1 of 10 lost  |  0.7 px, 0 of 10 lost
  OpenCV CSRT                6.2 px, median 0.8, 1 of 10 lost  |  10.8 px, median 0.8, 2 of 10 lost
  OpenCV KCF                 43 px, 7 of 10 lost               |  48 px, 8 of 10 lost
  the authors' parts         fixed centre 16 and 36 px, 3 and 7 of 10 lost; Hedge 43 to 52 px, 5 to 8 of 10 lost
Theirs are other videos, and ten videos hardly tell 1 lost from 3.";

/// One tracker on one video.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Distance of the estimated centre from the true one in each frame from the second on, pixels.
    pub errors: Vec<f64>,
    /// Whether the tracker believed the target lost, in the same frames.
    pub lost: Vec<bool>,
    /// Time in the tracker for these frames, seconds.
    pub seconds: f64,
}

impl Run {
    /// Follows a video's target from its true first box.
    ///
    /// # Errors
    /// The tracker refuses the first box.
    pub fn follow(video: &dyn Drawn, tracker: &mut Tracker) -> Result<Self> {
        let mut run = Self::default();
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            if index == 0 {
                tracker.start(&frame, *truth)?;
                continue;
            }
            let began = Instant::now();
            let step = tracker.step(Scene { frame: &frame, detections: &[] });
            run.seconds += began.elapsed().as_secs_f64();
            run.errors.push(centre_error(&step.bbox(), truth));
            run.lost.push(step.lost());
        }
        Ok(run)
    }

    /// Its figures.
    ///
    /// # Errors
    /// It has no frame.
    pub fn score(&self) -> Result<CentreScore> {
        let far: Vec<_> = self.errors.iter().map(|&e| (e, 0.0)).collect();
        score_centres(&far, &vec![(0.0, 0.0); far.len()])
    }

    /// Whether these could be the results of a video of so many frames: a check of what was read from a file.
    pub fn is_of(&self, frames: usize) -> bool {
        self.errors.len() + 1 == frames && self.lost.len() == self.errors.len()
    }
}

/// A name for what the program does with a configuration: a digest of its results on a small fixed video.
///
/// It changes with the model behind the configuration and with the program, so that results kept in files are not
/// taken for those of another one (but for changes that show on other videos only).
///
/// # Errors
/// The tracker cannot be made.
pub fn fingerprint(blueprint: &Blueprint) -> Result<String> {
    let video = Clutter { digit: 3, seed: 1, frames: 8, noise: NOISE, ..Clutter::default() };
    let run = Run::follow(&video.video(&Digits::drawn(1, 2))?, &mut blueprint.tracker(1, 0)?)?;
    let bytes: Vec<u8> = run.errors.iter().flat_map(|e| e.to_le_bytes()).collect();
    Ok(digest(&[&bytes]))
}

/// A name of 32 characters for some parts, each with its length.
pub fn digest(parts: &[&[u8]]) -> String {
    let mut sha = Sha256::new();
    for part in parts {
        sha.update((part.len() as u64).to_le_bytes());
        sha.update(part);
    }
    sha.finalize()[..16].iter().map(|byte| format!("{byte:02x}")).collect()
}

/// One line of the table: a configuration with a policy, on all videos of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// The configuration.
    pub configuration: String,
    /// Its policy.
    pub policy: String,
    /// Whether that is the configuration's own.
    pub own: bool,
    /// Density of salt and pepper, 0 to 1.
    pub noise: f64,
    /// Mean over videos and their spread.
    #[serde(flatten)]
    pub videos: CentreSummary,
    /// 90 % of the videos have a mean error of at most this, pixels (between two videos: linear).
    pub quantile90: f64,
    /// This policy's mean error less the fixed centre's on the same video; none for the fixed centre itself.
    pub against_fixed: Option<Paired>,
    /// Share of frames believed lost among those on the target (centre error at most [`OFF`]); should be small.
    pub flagged_on: Option<f64>,
    /// Share of frames believed lost among those off the target; should be large. None where there is no such frame.
    pub flagged_off: Option<f64>,
    /// Frames a second in the tracker, in one thread.
    pub fps: Option<f64>,
}

/// A mean over pairs with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Paired {
    /// Mean difference, pixels.
    pub mean: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Line {
    /// Sums up the runs over the same videos in the same order: `runs`, and those of the `fixed` centre unless this is
    /// it.
    ///
    /// # Errors
    /// There is no run, a run has no frame, or the numbers of runs differ.
    pub fn of(configuration: &str, policy: &str, noise: f64, runs: &[&Run], fixed: Option<&[&Run]>) -> Result<Self> {
        let scores = |runs: &[&Run]| runs.iter().map(|run| run.score()).collect::<Result<Vec<_>>>();
        let scored = scores(runs)?;
        let videos = CentreSummary::of(&scored).ok_or_else(|| Error::Invalid("no run to sum up".into()))?;
        let means: Vec<f64> = scored.iter().map(|s| s.mean).collect();
        let against_fixed = match fixed {
            Some(fixed) if fixed.len() != runs.len() => {
                return Err(Error::Invalid(format!("{} runs to compare with {}", fixed.len(), runs.len())));
            }
            Some(fixed) => Some(paired(
                &scores(fixed)?.iter().zip(&means).map(|(fixed, mean)| mean - fixed.mean).collect::<Vec<_>>(),
            )),
            None => None,
        };
        let (frames, seconds) = runs.iter().fold((0, 0.0), |(n, s), run| (n + run.errors.len(), s + run.seconds));
        Ok(Self {
            configuration: configuration.into(),
            policy: policy.into(),
            own: false,
            noise,
            videos,
            quantile90: quantile(&means, 0.9),
            against_fixed,
            flagged_on: flagged(runs, |error| error <= OFF),
            flagged_off: flagged(runs, |error| error > OFF),
            fps: (seconds > 0.0).then(|| frames as f64 / seconds),
        })
    }
}

/// Share of frames believed lost among those whose error is `such`.
fn flagged(runs: &[&Run], such: impl Fn(f64) -> bool) -> Option<f64> {
    let frames = runs.iter().flat_map(|run| run.errors.iter().zip(&run.lost)).filter(|(e, _)| such(**e));
    let (all, lost) = frames.fold((0u64, 0u64), |(all, lost), (_, l)| (all + 1, lost + u64::from(*l)));
    (all > 0).then(|| lost as f64 / all as f64)
}

/// The quantile `q` of at least one value, linear between neighbours.
pub(super) fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = q * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    if below == above { below } else { below + (at - at.floor()) * (above - below) }
}

/// The mean of differences, and the percentile bootstrap over them: they are drawn with replacement 10,000 times, always
/// by the same seed.
pub fn paired(differences: &[f64]) -> Paired {
    const DRAWS: usize = 10_000;
    const SEED: u64 = 20_120_301;
    let n = differences.len();
    let mut rng = Streams::new(SEED, 0).rng(0);
    let mut mean = || (0..n).map(|_| differences[rng.random_range(0..n)]).sum::<f64>() / n as f64;
    let means: Vec<f64> = (0..DRAWS).map(|_| mean()).collect();
    Paired { mean: mean_sd(differences).0, low: quantile(&means, 0.025), high: quantile(&means, 0.975) }
}

/// Aligned text with its explanations, and what others have.
pub fn text(lines: &[Line], peers: &str) -> String {
    let heads = [
        "configuration",
        "policy",
        "noise",
        "videos",
        "mean px",
        "sd",
        "median",
        "90 %",
        "lost at end",
        "lost in mean",
        "against fixed px [95 %]",
        "flagged on",
        "flagged off",
        "frames/s",
    ];
    let mut rows = vec![heads.map(String::from).to_vec()];
    rows.extend(lines.iter().map(cells));
    format!(
        "{}\n{}\n{peers}\n",
        aligned(&rows),
        "Errors are distances of centres in px from frame 2 on, averaged over a video first; mean, sd, median and 90 % are over videos.\n\
         lost at end: the last 20 frames are more than 15 px off on average; lost in mean: all frames are more than 28 px off.\n\
         against fixed: this policy less the fixed centre, video by video, with a 95 % bootstrap interval; below 0 is better.\n\
         flagged: frames believed lost among those on the target (at most 14 px off; should be 0 %), and off it (should be 100 %).\n\
         frames/s: in the tracker alone, one thread a video. * the configuration's own policy.\n"
    )
}

fn cells(line: &Line) -> Vec<String> {
    let percent = |share: Option<f64>| share.map_or("-".into(), |s| format!("{:.1} %", 100.0 * s));
    let v = &line.videos;
    vec![
        line.configuration.clone(),
        format!("{}{}", line.policy, if line.own { "*" } else { " " }),
        format!("{:.0} %", 100.0 * line.noise),
        v.videos.to_string(),
        format!("{:.2}", v.mean),
        format!("{:.2}", v.sd),
        format!("{:.2}", v.median),
        format!("{:.2}", line.quantile90),
        percent(Some(v.lost_at_end)),
        percent(Some(v.lost_on_average)),
        line.against_fixed.map_or("-".into(), |d| format!("{:+.2} [{:+.2}, {:+.2}]", d.mean, d.low, d.high)),
        percent(line.flagged_on),
        percent(line.flagged_off),
        line.fps.map_or("-".into(), |fps| format!("{fps:.0}")),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_summed_up_by_hand() {
        let run = |error: f64, lost: bool| Run { errors: vec![error; 4], lost: vec![lost; 4], seconds: 0.5 };
        let (good, bad) = (run(1.0, false), Run { lost: vec![true, true, true, false], ..run(40.0, true) });
        let fixed = run(2.0, true);
        let line = Line::of("c", "hedge", 0.3, &[&good, &bad], Some(&[&fixed, &fixed])).expect("two runs");
        assert_eq!((line.videos.mean, line.videos.median, line.videos.lost_on_average), (20.5, 20.5, 0.5));
        assert!((line.quantile90 - 36.1).abs() < 1e-12);
        assert_eq!((line.flagged_on, line.flagged_off, line.fps), (Some(0.0), Some(0.75), Some(8.0)));
        // Differences −1 and 38: half of the resamples have both, a quarter one of them twice.
        assert_eq!(line.against_fixed, Some(Paired { mean: 18.5, low: -1.0, high: 38.0 }));
        assert!(text(&[line], "").contains("+18.50 [-1.00, +38.00]"));
        let alone = Line::of("c", "fixed", 0.0, &[&good], None).expect("one run");
        assert_eq!((alone.against_fixed, alone.flagged_off), (None, None));
        assert!(Line::of("c", "fixed", 0.0, &[], None).is_err() && good.is_of(5) && !good.is_of(4));
    }

    #[test]
    fn the_interval_covers_the_mean() {
        // 100 samples of 40 uniform numbers of mean 0.5. The interval is nominally 95 %, really about 93 %: fewer than 80
        // hits of 100 have a probability below 1e-4.
        let mut rng = Streams::new(5, 0).rng(0);
        let sample = |rng: &mut crate::rng::Rng| (0..40).map(|_| rng.random::<f64>()).collect::<Vec<_>>();
        let covers = |d: Paired| d.low <= 0.5 && 0.5 <= d.high;
        let hits = (0..100).filter(|_| covers(paired(&sample(&mut rng)))).count();
        assert!(hits >= 80, "{hits} of 100 intervals hold the mean");
    }
}
