//! Centre errors, as the paper's tables give them, and whether a video was lost.

use serde::Serialize;

use super::metrics::mean_sd;
use crate::{Error, Result};

/// Frames at the end of a video, and the mean error in pixels over them above which it is lost.
const END: (usize, f64) = (20, 15.0);
/// The mean error over a whole video, pixels, above which it is lost: the side of a digit.
const WHOLE: f64 = 28.0;

/// Centre errors of one video, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CentreScore {
    /// Mean over time.
    pub mean: f64,
    /// Median over time.
    pub median: f64,
    /// Standard deviation over time (n in the denominator): the brackets of the paper's first table.
    pub sd: f64,
    /// Largest.
    pub max: f64,
    /// Lost: the mean of the last 20 frames is above 15 pixels.
    pub lost_at_end: bool,
    /// Lost: the mean of all frames is above 28 pixels.
    pub lost_on_average: bool,
}

/// Scores the estimated centres of a video against the true ones, frame by frame, in pixels.
/// The authors leave out frame 1, which is given: pass the frames from 2 on to do as they do.
///
/// # Errors
/// The lengths differ, or there is no frame.
pub fn score_centres(estimates: &[(f64, f64)], truth: &[(f64, f64)]) -> Result<CentreScore> {
    if estimates.len() != truth.len() || truth.is_empty() {
        return Err(Error::Invalid(format!("{} estimates for {} true centres", estimates.len(), truth.len())));
    }
    let distance = |(e, t): (&(f64, f64), &(f64, f64))| (e.0 - t.0).hypot(e.1 - t.1);
    let far = |d: f64| if d.is_nan() { f64::INFINITY } else { d };
    let errors: Vec<f64> = estimates.iter().zip(truth).map(distance).map(far).collect();
    let (mean, sd) = mean_sd(&errors);
    let end = mean_sd(&errors[errors.len().saturating_sub(END.0)..]).0;
    Ok(CentreScore {
        mean,
        median: median(&errors),
        sd,
        max: errors.iter().copied().fold(0.0, f64::max),
        lost_at_end: end > END.1,
        lost_on_average: mean > WHOLE,
    })
}

/// Many videos together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CentreSummary {
    /// Number of videos.
    pub videos: usize,
    /// Mean over videos of their mean errors, pixels.
    pub mean: f64,
    /// Standard deviation over videos of their mean errors (n in the denominator), pixels.
    pub sd: f64,
    /// Median over videos of their mean errors, pixels.
    pub median: f64,
    /// Share of videos lost at the end, 0 to 1.
    pub lost_at_end: f64,
    /// Share of videos lost on average, 0 to 1.
    pub lost_on_average: f64,
}

impl CentreSummary {
    /// Sums up videos; `None` without one.
    pub fn of(videos: &[CentreScore]) -> Option<Self> {
        let means: Vec<f64> = videos.iter().map(|v| v.mean).collect();
        let (mean, sd) = mean_sd(&means);
        let share = |lost: &dyn Fn(&CentreScore) -> bool| {
            videos.iter().filter(|v| lost(v)).count() as f64 / videos.len() as f64
        };
        (!videos.is_empty()).then(|| Self {
            videos: videos.len(),
            mean,
            sd,
            median: median(&means),
            lost_at_end: share(&|v| v.lost_at_end),
            lost_on_average: share(&|v| v.lost_on_average),
        })
    }
}

/// The middle value, or the mean of the two in the middle. Panics without a value.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let half = sorted.len() / 2;
    if sorted.len() % 2 == 1 { sorted[half] } else { (sorted[half - 1] + sorted[half]) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_scored_by_hand() {
        let truth = vec![(0.0, 0.0); 40];
        let track = |far: f64| (0..40).map(|t| if t < 20 { (3.0, 4.0) } else { (far, 0.0) }).collect::<Vec<_>>();
        let s = score_centres(&track(5.0), &truth).expect("lengths agree");
        assert_eq!(
            (s.mean, s.median, s.sd, s.max, s.lost_at_end, s.lost_on_average),
            (5.0, 5.0, 0.0, 5.0, false, false)
        );
        let s = score_centres(&track(16.0), &truth).expect("lengths agree");
        assert_eq!((s.mean, s.median, s.sd, s.lost_at_end, s.lost_on_average), (10.5, 10.5, 5.5, true, false));
        let s = score_centres(&track(f64::NAN), &truth).expect("lengths agree");
        assert!(s.mean.is_infinite() && s.lost_at_end && s.lost_on_average);
        assert!(score_centres(&truth, &truth[1..]).is_err() && score_centres(&[], &[]).is_err());
    }

    #[test]
    fn videos_are_summed_up() {
        let video = |mean, lost| CentreScore {
            mean,
            median: 0.0,
            sd: 0.0,
            max: 0.0,
            lost_at_end: lost,
            lost_on_average: false,
        };
        let s = CentreSummary::of(&[video(1.0, false), video(2.0, false), video(9.0, true)]).expect("three");
        assert_eq!((s.videos, s.mean, s.median, s.lost_on_average), (3, 4.0, 2.0, 0.0));
        assert!((s.lost_at_end - 1.0 / 3.0).abs() < 1e-15 && CentreSummary::of(&[]).is_none());
    }
}
