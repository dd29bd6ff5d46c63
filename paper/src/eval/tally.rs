//! One line of a results table: one measurement per video, summarised over videos and by digit, as the paper prints it.
//!
//! The measurement is the mean centre error in pixels, or the percentage of frames recognised.

use serde::{Deserialize, Serialize};

use super::recognised::Recognised;
use foveate::lab::eval::experiment::{Paired, Run, paired, quantile};
use foveate::lab::eval::metrics::mean_sd;
use foveate::report::chart::{Axis, Chart, Mark, render};
use foveate::{Error, Result};

/// The measurement of one video.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Figure {
    /// Class of the target.
    pub digit: u8,
    /// The value.
    pub value: f64,
    /// Standard deviation over time of the values averaged in `value`; 0 if `value` is no mean.
    pub spread: f64,
    /// Whether the video ends off the target: the last 20 frames are more than 15 px off on average.
    pub off_at_end: bool,
}

impl Figure {
    /// Returns the mean centre error of a run, pixels.
    ///
    /// # Errors
    /// The run has no frame.
    pub(crate) fn error(digit: u8, run: &Run) -> Result<Self> {
        let score = run.score()?;
        Ok(Self { digit, value: score.mean, spread: score.sd, off_at_end: score.off_at_end })
    }
    /// Returns the percentage of frames with the right decision over all frames so far.
    ///
    /// # Errors
    /// The run has no frame.
    pub(crate) fn accuracy(run: &Recognised) -> Result<Self> {
        let track = Run { errors: run.errors.clone(), ..Run::default() };
        let off_at_end = track.score()?.off_at_end;
        Ok(Self { digit: run.digit, value: 100.0 * run.accuracy(), spread: 0.0, off_at_end })
    }
}

/// The statistics of many videos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tally {
    /// Number of videos.
    pub videos: usize,
    /// Mean over videos.
    pub mean: f64,
    /// Its 95 % bootstrap interval over videos.
    pub interval: [f64; 2],
    /// Standard deviation over videos.
    pub sd: f64,
    /// Median over videos.
    pub median: f64,
    /// Fraction of videos that end off the target, 0 to 1.
    pub off_at_end: f64,
    /// The statistics by digit.
    pub digits: Vec<OfDigit>,
    /// The paired difference from the line it is compared with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub against: Option<Paired>,
}

/// The videos of one digit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct OfDigit {
    /// The digit.
    pub digit: u8,
    /// Mean over its videos.
    pub mean: f64,
    /// Mean over its videos of the standard deviation over time: the paper's brackets.
    pub spread: f64,
}

impl Tally {
    /// Summarises videos, and compares them with `other` measurements of the same videos in the same order.
    ///
    /// # Errors
    /// There is no video, or the numbers of videos differ.
    pub(crate) fn of(figures: &[Figure], other: Option<&[Figure]>) -> Result<Self> {
        if figures.is_empty() || other.is_some_and(|other| other.len() != figures.len()) {
            let others = other.map_or(0, <[Figure]>::len);
            return Err(Error::Invalid(format!("{} videos to sum up and {others} to compare with", figures.len())));
        }
        let values: Vec<f64> = figures.iter().map(|f| f.value).collect();
        let ((mean, sd), all) = (mean_sd(&values), paired(&values));
        let mut names: Vec<u8> = figures.iter().map(|f| f.digit).collect();
        names.sort();
        names.dedup();
        let of_digit = |digit: u8| {
            let over = |of: &dyn Fn(&Figure) -> f64| {
                mean_sd(&figures.iter().filter(|f| f.digit == digit).map(of).collect::<Vec<_>>()).0
            };
            OfDigit { digit, mean: over(&|f| f.value), spread: over(&|f| f.spread) }
        };
        let differences =
            |other: &[Figure]| -> Vec<f64> { figures.iter().zip(other).map(|(a, b)| a.value - b.value).collect() };
        Ok(Self {
            videos: figures.len(),
            mean,
            interval: [all.low, all.high],
            sd,
            median: quantile(&values, 0.5),
            off_at_end: figures.iter().filter(|f| f.off_at_end).count() as f64 / figures.len() as f64,
            digits: names.into_iter().map(of_digit).collect(),
            against: other.map(|other| paired(&differences(other))),
        })
    }
}

/// Plots means of lines with their intervals below each other: name, mean, low, high, colour. Returns SVG text.
pub(crate) fn plot(x_label: &str, rows: &[(String, [f64; 3], &'static str)]) -> String {
    let (mut marks, mut names) = (vec![], vec![]);
    for (i, (name, [mean, low, high], colour)) in rows.iter().enumerate() {
        let y = -(i as f64);
        names.push((y, name.clone()));
        marks.extend([Mark::line(colour, 1.5, [(*low, y), (*high, y)]), Mark::dots(colour, 4.0, [(*mean, y)])]);
    }
    let y = Axis { names, ..Axis::default() }.between(0.5 - rows.len() as f64, 0.5);
    let chart = Chart { x: Axis::new(x_label), y, marks, ..Chart::default() };
    render(&[chart], 1, [900.0, 70.0 + 26.0 * rows.len() as f64])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn videos_summed_up_by_hand() {
        let figure = |digit, value, spread, off_at_end| Figure { digit, value, spread, off_at_end };
        let figures = [figure(3, 1.0, 0.5, false), figure(1, 2.0, 1.0, false), figure(3, 9.0, 4.5, true)];
        let same = [figure(3, 0.0, 0.0, false), figure(1, 1.0, 0.0, false), figure(3, 8.0, 0.0, false)];
        let tally = Tally::of(&figures, Some(&same)).expect("three videos");
        assert_eq!((tally.videos, tally.mean, tally.median), (3, 4.0, 2.0));
        assert!((tally.off_at_end - 1.0 / 3.0).abs() < 1e-15);
        let [one, three] = [tally.digits[0], tally.digits[1]];
        assert_eq!((one.digit, one.mean, one.spread), (1, 2.0, 1.0));
        assert_eq!((three.digit, three.mean, three.spread), (3, 5.0, 2.5));
        // Every video is worse by 1: so is every resample.
        assert_eq!(tally.against, Some(Paired { mean: 1.0, low: 1.0, high: 1.0 }));
        // The mean of a resample of three values lies between the smallest and the largest value.
        assert!(tally.interval[0] >= 1.0 && tally.interval[1] <= 9.0 && tally.interval[0] < tally.interval[1]);
        assert!(Tally::of(&[], None).is_err() && Tally::of(&figures, Some(&same[1..])).is_err());
    }

    #[test]
    fn a_line_a_row() {
        let rows = [("one".to_owned(), [1.0, 0.5, 2.0], "#0072B2"), ("two".to_owned(), [3.0, 2.5, 4.0], "#D55E00")];
        let svg = plot("px", &rows);
        assert!(svg.contains("one") && svg.contains("two"));
        let other = [rows[0].clone(), (rows[1].0.clone(), rows[1].1, "#0072B2")];
        assert_ne!(plot("px", &other), svg, "colours are seen");
    }

    #[test]
    fn figures_of_runs() {
        let run = Run { errors: vec![2.0, 4.0], lost: vec![false; 2], seconds: 1.0 };
        let figure = Figure::error(7, &run).expect("two frames");
        assert_eq!((figure.value, figure.spread, figure.off_at_end), (3.0, 1.0, false));
        assert!(Figure::error(7, &Run::default()).is_err());
        let (decided, own, probability) = (vec![7, 7, 7, 1], vec![7; 4], vec![1.0; 4]);
        let run = Recognised { digit: 7, errors: vec![20.0; 4], decided, own, probability };
        let figure = Figure::accuracy(&run).expect("four frames");
        assert_eq!((figure.digit, figure.value, figure.off_at_end), (7, 75.0, true));
    }
}
