//! Recognition along real tracks (the paper's table 2): how often the decision is right, frame by frame.

use serde::{Deserialize, Serialize};

use super::experiment::OFF;
use super::metrics::{centre_error, mean_sd};
use super::table::aligned;
use crate::scene::synthetic::Drawn;
use crate::scene::{Frame, Scene};
use crate::tracker::Tracker;
use crate::{Error, Result};

/// What the paper has, to print below the table.
pub const PAPER: &str = "\
The paper (table 2, one video a digit): learned policy 98.01 %, deterministic 57.88 %, random 65.96 % of frames right.";

/// One tracker with a recogniser on one video, from the second frame on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recognised {
    /// What the target is.
    pub digit: u8,
    /// Distance of the estimated centre from the true one, pixels.
    pub errors: Vec<f64>,
    /// The likeliest class over all frames so far.
    pub decided: Vec<u8>,
    /// The likeliest class by each frame's own decision.
    pub own: Vec<u8>,
    /// The probability of the true class over all frames so far.
    pub probability: Vec<f32>,
}

impl Recognised {
    /// Follows a video's target from its true first box.
    ///
    /// # Errors
    /// The tracker has no recogniser of ten classes or more, or refuses the first box.
    pub fn follow(video: &dyn Drawn, tracker: &mut Tracker) -> Result<Self> {
        let digit = video.label();
        let mut run = Self { digit, ..Self::default() };
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            if index == 0 {
                tracker.start(&frame, *truth)?;
                continue;
            }
            let step = tracker.step(Scene { frame: &frame, detections: &[] });
            let (Some((decided, _)), Some((own, _)), true) = (step.class(), step.own_class(), step.classes.len() == 10)
            else {
                return Err(Error::Config(
                    "to recognise digits the configuration needs a recogniser of ten classes".into(),
                ));
            };
            run.errors.push(centre_error(&step.bbox(), truth));
            run.decided.push(decided as u8);
            run.own.push(own as u8);
            run.probability.push(step.classes[usize::from(digit)] as f32);
        }
        Ok(run)
    }

    /// Whether these could be the results of a video of so many frames: a check of what was read from a file.
    pub fn is_of(&self, frames: usize) -> bool {
        let n = self.errors.len();
        n + 1 == frames && [self.decided.len(), self.own.len(), self.probability.len()] == [n; 3]
    }

    /// Share of frames whose decision over all frames so far is right.
    pub fn accuracy(&self) -> f64 {
        self.decided.iter().filter(|c| **c == self.digit).count() as f64 / self.decided.len().max(1) as f64
    }
}

/// One line of the table: a configuration and a way to look for recognition, on all videos of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// The configuration.
    pub configuration: String,
    /// Its policy, which looks for tracking.
    pub policy: String,
    /// The policy that looks for recognition.
    pub looks: String,
    /// Density of salt and pepper, 0 to 1.
    pub noise: f64,
    /// Videos.
    pub videos: usize,
    /// Share of frames whose decision over all frames so far is right: mean over videos, and its spread.
    pub accuracy: f64,
    /// Standard deviation over videos.
    pub accuracy_sd: f64,
    /// Share of frames whose own decision, on the last Δ looks, is right.
    pub single: f64,
    /// The same among frames on the target (centre error at most [`OFF`]).
    pub single_on_target: f64,
    /// Share of videos that are right at the end.
    pub at_end: f64,
    /// Share of frames off the target.
    pub off: f64,
    /// `accuracy` of each digit; none where no video has it.
    pub digits: [Option<f64>; 10],
}

impl Line {
    /// Sums up runs. `None` without any.
    pub fn of(configuration: &str, policy: &str, looks: &str, noise: f64, runs: &[&Recognised]) -> Option<Self> {
        let all: Vec<f64> = runs.iter().map(|run| run.accuracy()).collect();
        if all.is_empty() {
            return None;
        }
        let (accuracy, accuracy_sd) = mean_sd(&all);
        let frames = || runs.iter().flat_map(|r| r.own.iter().zip(&r.errors).map(|(c, e)| (*c == r.digit, *e <= OFF)));
        let share = |such: &dyn Fn((bool, bool)) -> bool, of: &dyn Fn((bool, bool)) -> bool| {
            frames().filter(|f| such(*f) && of(*f)).count() as f64 / frames().filter(|f| of(*f)).count().max(1) as f64
        };
        let of_digit = |digit: usize| {
            let (sum, n) = (runs.iter().zip(&all).filter(|(run, _)| usize::from(run.digit) == digit))
                .fold((0.0, 0), |(sum, n), (_, a)| (sum + a, n + 1));
            (n > 0).then(|| sum / f64::from(n))
        };
        let right = runs.iter().filter(|run| run.decided.last() == Some(&run.digit)).count();
        Some(Self {
            configuration: configuration.into(),
            policy: policy.into(),
            looks: looks.into(),
            noise,
            videos: runs.len(),
            accuracy,
            accuracy_sd,
            single: share(&|f| f.0, &|_| true),
            single_on_target: share(&|f| f.0, &|f| f.1),
            at_end: right as f64 / runs.len() as f64,
            off: share(&|f| !f.1, &|_| true),
            digits: std::array::from_fn(of_digit),
        })
    }
}

/// Aligned text with its explanations, and what the paper has.
pub fn text(lines: &[Line]) -> String {
    let heads = [
        "configuration",
        "tracking looks",
        "recognition looks",
        "noise",
        "videos",
        "all frames %",
        "sd",
        "single %",
        "on target %",
        "at end %",
        "off %",
    ];
    let mut table = vec![heads.map(String::from).to_vec()];
    table.extend(lines.iter().map(|l| {
        let mut row =
            vec![l.configuration.clone(), l.policy.clone(), l.looks.clone(), l.noise.to_string(), l.videos.to_string()];
        row.extend(
            [l.accuracy, l.accuracy_sd, l.single, l.single_on_target, l.at_end, l.off]
                .map(|x| format!("{:.2}", 100.0 * x)),
        );
        row
    }));
    let mut digits = vec![
        ["recognition looks", "noise"]
            .into_iter()
            .map(String::from)
            .chain((0..10).map(|d| d.to_string()))
            .collect::<Vec<_>>(),
    ];
    digits.extend(lines.iter().map(|l| {
        let cell = |a: &Option<f64>| a.map_or("-".into(), |a| format!("{:.1}", 100.0 * a));
        [l.looks.clone(), l.noise.to_string()].into_iter().chain(l.digits.iter().map(cell)).collect()
    }));
    format!(
        "{}\nall frames: share of frames whose decision over all frames so far is right, mean over videos; sd over videos\n\
         single: share of frames right by their own looks alone; on target: the same where the track is at most {OFF} px off\n\
         at end: share of videos right in the last frame; off: share of frames more than {OFF} px off\n\nAll frames, digit by digit, %\n{}\n{PAPER}\n",
        aligned(&table),
        aligned(&digits)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_counts_frames_and_videos() {
        let run = |digit: u8, decided: [u8; 4], own: [u8; 4], errors: [f64; 4]| Recognised {
            digit,
            errors: errors.to_vec(),
            decided: decided.to_vec(),
            own: own.to_vec(),
            probability: vec![0.5; 4],
        };
        let a = run(3, [3, 3, 3, 3], [3, 3, 8, 3], [1.0; 4]);
        let b = run(5, [1, 5, 5, 1], [1, 5, 1, 1], [1.0, 2.0, 20.0, 30.0]);
        assert!(a.is_of(5) && !a.is_of(4) && b.accuracy() == 0.5);
        let line = Line::of("c", "hedge", "random", 0.0, &[&a, &b]).expect("two runs");
        assert_eq!((line.accuracy, line.at_end, line.videos), (0.75, 0.5, 2));
        assert_eq!((line.single, line.single_on_target, line.off), (0.5, 4.0 / 6.0, 0.25));
        assert_eq!((line.digits[3], line.digits[5], line.digits[0]), (Some(1.0), Some(0.5), None));
        assert!(Line::of("c", "hedge", "random", 0.0, &[]).is_none());
        assert!(text(&[line]).contains("75.00"));
    }
}
