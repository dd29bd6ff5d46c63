//! One tracker on one synthetic video, a digest of its dependencies, and means with bootstrap intervals.
//!
//! A [`Run`] has the distance of centres in every frame from the second on, as the authors measure it, and the tracker's reports.

use std::time::Instant;

use rand::RngExt;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::centres::{CentreScore, score_centres};
use super::metrics::{centre_error, mean_sd};
use crate::Digits;
use crate::synthetic::{Clutter, Drawn, NOISE};
use foveate_base::Result;
use foveate_base::rng::Streams;
use foveate_core::Tracker;
use foveate_core::config::Blueprint;
use foveate_video::Frame;

/// Centre error in pixels above which the tracker is off the target: half a digit.
pub const OFF: f64 = 14.0;

/// One tracker on one video.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Distance of the estimated centre from the true one in each frame from the second on, pixels.
    pub errors: Vec<f64>,
    /// Whether the tracker reported the target as occluded or lost, in the same frames.
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
                tracker.init(&frame.image, *truth)?;
                continue;
            }
            let began = Instant::now();
            let step = tracker.update(&frame.image)?;
            run.seconds += began.elapsed().as_secs_f64();
            run.errors.push(centre_error(&step.bbox, truth));
            run.lost.push(!step.is_usable());
        }
        Ok(run)
    }

    /// Returns the centre scores.
    ///
    /// # Errors
    /// It has no frame.
    pub fn score(&self) -> Result<CentreScore> {
        let far: Vec<_> = self.errors.iter().map(|&e| (e, 0.0)).collect();
        score_centres(&far, &vec![(0.0, 0.0); far.len()])
    }

    /// Returns whether the results can belong to a video with this number of frames: a check of a file's content.
    pub fn is_of(&self, frames: usize) -> bool {
        self.errors.len() + 1 == frames && self.lost.len() == self.errors.len()
    }
}

/// Returns a digest of the program's results with a configuration on a small fixed video.
///
/// It changes with the model behind the configuration and with the program, so that stored results are not confused with those of another
/// version (except for changes that only affect other videos).
///
/// # Errors
/// The tracker cannot be created.
pub fn fingerprint(blueprint: &Blueprint) -> Result<String> {
    let video = Clutter { digit: 3, seed: 1, frames: 8, noise: NOISE, ..Clutter::default() };
    let run = Run::follow(&video.video(&Digits::drawn(1, 2))?, &mut blueprint.tracker(1)?)?;
    let bytes: Vec<u8> = run.errors.iter().flat_map(|e| e.to_le_bytes()).collect();
    Ok(digest(&[&bytes]))
}

/// Returns a digest of 32 characters of some parts, each with its length.
pub fn digest(parts: &[&[u8]]) -> String {
    let mut sha = Sha256::new();
    for part in parts {
        sha.update((part.len() as u64).to_le_bytes());
        sha.update(part);
    }
    sha.finalize()[..16].iter().map(|byte| format!("{byte:02x}")).collect()
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

/// Returns the fraction of frames reported as occluded or lost: among those on the target (centre error at most [`OFF`]), and among those
/// off it. `None` if there is no such frame.
pub fn reported(runs: &[&Run]) -> [Option<f64>; 2] {
    [false, true].map(|off| {
        let frames = runs.iter().flat_map(|run| run.errors.iter().zip(&run.lost)).filter(|(e, _)| (**e > OFF) == off);
        let (all, lost) = frames.fold((0u64, 0u64), |(all, lost), (_, l)| (all + 1, lost + u64::from(*l)));
        (all > 0).then(|| lost as f64 / all as f64)
    })
}

/// Returns the quantile `q` of at least one value, linear between neighbours.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = q * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    if below == above { below } else { below + (at - at.floor()) * (above - below) }
}

/// Returns the mean of differences, and the percentile bootstrap over them: 10,000 resamples with replacement, always with the same seed.
pub fn paired(differences: &[f64]) -> Paired {
    const DRAWS: usize = 10_000;
    const SEED: u64 = 20_120_301;
    let n = differences.len();
    let mut rng = Streams::new(SEED, 0).rng(0);
    let mut mean = || (0..n).map(|_| differences[rng.random_range(0..n)]).sum::<f64>() / n as f64;
    let means: Vec<f64> = (0..DRAWS).map(|_| mean()).collect();
    Paired { mean: mean_sd(differences).0, low: quantile(&means, 0.025), high: quantile(&means, 0.975) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_summed_up_by_hand() {
        let run = |error: f64, lost: bool| Run { errors: vec![error; 4], lost: vec![lost; 4], seconds: 0.5 };
        let (good, bad) = (run(1.0, false), Run { lost: vec![true, true, true, false], ..run(40.0, true) });
        assert_eq!(reported(&[&good, &bad]), [Some(0.0), Some(0.75)]);
        assert_eq!(reported(&[&good]), [Some(0.0), None]);
        assert!(good.is_of(5) && !good.is_of(4) && bad.score().expect("four frames").off_at_end);
        // Differences −1 and 38: half of the resamples have both, a quarter one of them twice.
        assert_eq!(paired(&[-1.0, 38.0]), Paired { mean: 18.5, low: -1.0, high: 38.0 });
    }

    #[test]
    fn the_interval_covers_the_mean() {
        // 100 samples of 40 uniform numbers of mean 0.5. The interval is nominally 95 %, really about 93 %: fewer than 80
        // hits of 100 have a probability below 1e-4.
        let mut rng = Streams::new(5, 0).rng(0);
        let sample = |rng: &mut foveate_base::rng::Rng| (0..40).map(|_| rng.random::<f64>()).collect::<Vec<_>>();
        let covers = |d: Paired| d.low <= 0.5 && 0.5 <= d.high;
        let hits = (0..100).filter(|_| covers(paired(&sample(&mut rng)))).count();
        assert!(hits >= 80, "{hits} of 100 intervals hold the mean");
    }
}
