//! Centre errors of one video, as the paper's tables give them.

use serde::Serialize;

use super::metrics::mean_sd;
use foveate_base::{Error, Result};

/// Number of frames at the end of a video, and the mean error in pixels over them above which it ends off the target.
const END: (usize, f64) = (20, 15.0);

/// Centre errors of one video, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CentreScore {
    /// Mean over time.
    pub mean: f64,
    /// Median over time.
    pub median: f64,
    /// Standard deviation over time (n in the denominator): the brackets of the paper's first table.
    pub sd: f64,
    /// Whether the mean of the last 20 frames is above 15 pixels.
    pub off_at_end: bool,
}

/// Scores the estimated centres of a video against the true ones, frame by frame, in pixels. The authors leave out frame 1, whose box is
/// given: pass the frames from 2 on to do the same.
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
    Ok(CentreScore { mean, median: median(&errors), sd, off_at_end: end > END.1 })
}

/// Returns the middle value, or the mean of the two in the middle. Panics without a value.
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
        let of = |far: f64| score_centres(&track(far), &truth).expect("lengths agree");
        assert_eq!(of(5.0), CentreScore { mean: 5.0, median: 5.0, sd: 0.0, off_at_end: false });
        assert_eq!(of(16.0), CentreScore { mean: 10.5, median: 10.5, sd: 5.5, off_at_end: true });
        assert!(of(f64::NAN).mean.is_infinite() && of(f64::NAN).off_at_end);
        assert!(score_centres(&truth, &truth[1..]).is_err() && score_centres(&[], &[]).is_err());
    }
}
