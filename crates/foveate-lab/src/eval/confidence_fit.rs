//! Fits a [`ConfidenceModel`] on tracks with ground truth. `confidence_cross.rs` tests it on others.

use super::confidence::{Judged, Judgement};
use super::localisation_fit::fit_localisation;
use crate::hide::Hide;
use foveate_base::Result;
use foveate_base::rows::Rows;
use foveate_core::Tracker;
use foveate_core::control::{ABSENCE, AGREEMENT, ConfidenceModel, LEAP, OWN, SecondTrackerWeights};
use foveate_core::geometry::BBox;
use foveate_core::scene::Image;
use foveate_learn::softmax::{Fit, Softmax};

/// L2 penalty of the weights, in standard deviations of the cues. A weaker penalty fits the training tracks better, but a tracker that
/// searches with the result loses the target more often.
const L2: f64 = 0.03;

/// For videos with an inserted occlusion, only one of this many frames counts.
const RARER: usize = 5;

/// Follows a video with random access to frames up to `last`, with or without an inserted occlusion; the truth is that of the resulting
/// video.
///
/// # Errors
/// A picture cannot be read, or the tracker refuses the first box.
pub fn follow(
    truth: &[Option<BBox>],
    last: usize,
    hide: Option<&Hide>,
    picture: &dyn Fn(usize) -> Result<Image>,
    tracker: &mut Tracker,
) -> Result<Vec<Judged>> {
    let mut frames = vec![];
    for (index, &there) in truth.iter().enumerate().take(last + 1) {
        let image = picture(index)?;
        let (image, there) = match hide {
            Some(hide) => (hide.apply(index, &image, there), hide.truth(index, there)),
            None => (image, there),
        };
        if index == 0 {
            let absent =
                || foveate_base::Error::Invalid("the target is absent in frame 1, where a tracker starts".into());
            tracker.init(&image, there.ok_or_else(absent)?)?;
            continue;
        }
        frames.push(Judged::of(&tracker.update(&image)?, there));
    }
    Ok(frames)
}

/// Fits weights, bias, second-tracker weights and localisation on these tracks; everything else stays. Videos without an inserted
/// occlusion count 3 to 7 times as much as those with one, if neither kind has more than ten times the frames of the other: few videos
/// contain a loss, and a model fitted mostly on occlusions overestimates P(lost).
///
/// # Errors
/// There is no frame, or none of one of the two kinds.
pub fn fit(tracks: &[&Judgement], confidence: &ConfidenceModel) -> Result<ConfidenceModel> {
    let (weights, bias) = logistic(tracks, |j| std::array::from_fn::<f64, OWN, _>(|k| j.cues[k]), L2)?;
    fit_second_opinion(tracks, &ConfidenceModel { weights, bias, ..fit_localisation(tracks, confidence)? })
}

/// Fits the second-tracker weights on these tracks, and leaves them unchanged if there was no second tracker. Everything else stays, so
/// that a tracker with the new model makes the same boxes.
///
/// # Errors
/// As [`fit`].
pub fn fit_second_opinion(tracks: &[&Judgement], confidence: &ConfidenceModel) -> Result<ConfidenceModel> {
    if !tracks.iter().flat_map(|t| &t.frames).any(|j| j.cues[AGREEMENT] >= 0.0) {
        return Ok(confidence.clone());
    }
    let row = |j: &Judged| [confidence.own_logit(&j.cues), j.cues[AGREEMENT], j.cues[LEAP], j.cues[ABSENCE]];
    let ([own, agreement, leap, absence], bias) = logistic(tracks, row, 0.0)?;
    let second_opinion = SecondTrackerWeights { own, agreement, leap, absence, bias };
    Ok(ConfidenceModel { second_opinion, ..confidence.clone() })
}

/// Fits weights and bias of the logit of a lost frame, linear in the features from `row`.
fn logistic<const N: usize>(
    tracks: &[&Judgement],
    row: impl Fn(&Judged) -> [f64; N],
    l2: f64,
) -> Result<([f64; N], f64)> {
    let count =
        |occluded: bool| tracks.iter().filter(|t| t.occluded == occluded).map(|t| t.frames.len()).sum::<usize>();
    let more = |of: bool| (count(!of) as f64 / count(of).max(1) as f64).round().clamp(1.0, 10.0) as usize;
    let (times, every) = ([more(false), more(true)], [1, RARER]);
    let frames = || {
        tracks.iter().flat_map(|t| {
            let k = usize::from(t.occluded);
            std::iter::repeat_n(t.frames.iter().step_by(every[k]), times[k]).flatten()
        })
    };
    let rows: Vec<f32> = frames().flat_map(|j| row(j).map(|c| c as f32)).collect();
    let labels: Vec<u8> = frames().map(|j| u8::from(j.lost())).collect();
    if !(labels.contains(&0) && labels.contains(&1)) {
        return Err(foveate_base::Error::Invalid(format!(
            "a confidence model needs frames on the target and lost ones; these {} are all of one kind",
            labels.len()
        )));
    }
    // Each feature is divided by its standard deviation, so that the penalty is the same for all.
    let scales: [f64; N] = deviations(&rows);
    let rows: Vec<f32> =
        rows.iter().zip(scales.iter().cycle()).map(|(c, scale)| (f64::from(*c) / scale) as f32).collect();
    let (model, _) = Softmax::fit(Rows::new(&rows, N), &labels, 2, Fit { l2, steps: 500, tolerance: 1e-6 })?;
    // The model is linear in the logit: read off the coefficients at 0 and at each unit vector.
    let log_odds = |at: usize| {
        let (mut row, mut log_p) = ([0f32; N], [0.0; 2]);
        row.iter_mut().enumerate().for_each(|(k, c)| *c = f32::from(u8::from(k == at)));
        model.log_probabilities(Rows::new(&row, N), &mut log_p);
        log_p[1] - log_p[0]
    };
    let bias = log_odds(N);
    Ok((std::array::from_fn(|k| (log_odds(k) - bias) / scales[k]), bias))
}

/// Returns the standard deviation of each of `N` values per row; 1 for a constant value.
fn deviations<const N: usize>(rows: &[f32]) -> [f64; N] {
    let n = (rows.len() / N).max(1) as f64;
    std::array::from_fn(|k| {
        let values = || rows.iter().skip(k).step_by(N).map(|c| f64::from(*c));
        let mean = values().sum::<f64>() / n;
        let deviation = (values().map(|c| (c - mean).powi(2)).sum::<f64>() / n).sqrt();
        if deviation > 1e-6 { deviation } else { 1.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::catalogue::origin;
    use foveate_core::control::{Cues, Status};

    /// A thousand frames for each logit of the own cues, overlap and leap, with the number of lost frames that a known model gives.
    fn tracks(known: &SecondTrackerWeights) -> Vec<Judgement> {
        let mut frames = vec![];
        let both = |z: i32| [0.0, 0.5, 1.0].map(|agreement| (f64::from(z), agreement));
        for ((z, agreement), leap) in (-4..=4).flat_map(both).flat_map(|of| [0.0, 2.0].map(|leap| (of, leap))) {
            let odds = known.own * z + known.agreement * agreement + known.leap * leap + known.bias;
            let lost = (1000.0 / (1.0 + (-odds).exp())).round() as usize;
            let mut cues = Cues::default();
            (cues[0], cues[AGREEMENT], cues[LEAP]) = (z, agreement, leap);
            frames.extend((0..1000).map(|i| {
                let (p_lost, iou) = (0.5, if i < lost { 0.0 } else { 1.0 });
                Judged {
                    p_lost,
                    status: Status::Tracking,
                    cues,
                    iou,
                    off: None,
                    covariance: [1.0, 0.0, 1.0],
                    place: Default::default(),
                }
            }));
        }
        vec![Judgement { video: "Coke".into(), origin: origin("Coke"), occluded: false, frames }]
    }

    #[test]
    fn what_a_second_opinion_counts_for_is_found_and_nothing_else_is_touched() {
        let known = SecondTrackerWeights { own: 0.5, agreement: -3.0, leap: 0.7, absence: 0.0, bias: 1.0 };
        let mut before = ConfidenceModel { bias: 0.0, ..ConfidenceModel::default() };
        before.weights = std::array::from_fn(|k| f64::from(u8::from(k == 0)));
        let mut tracks = tracks(&known);
        let fitted = fit_second_opinion(&tracks.iter().collect::<Vec<_>>(), &before).expect("both kinds of frames");
        let found = fitted.second_opinion;
        let all = |it: SecondTrackerWeights| [it.own, it.agreement, it.leap, it.bias];
        for (found, known) in all(found).into_iter().zip(all(known)) {
            assert!((found - known).abs() < 0.02, "{found} for {known}");
        }
        assert_eq!(ConfidenceModel { second_opinion: before.second_opinion, ..fitted }, before);

        tracks[0].frames.iter_mut().for_each(|j| j.cues[AGREEMENT] = -1.0);
        let without = fit_second_opinion(&tracks.iter().collect::<Vec<_>>(), &before).expect("nothing to fit");
        assert_eq!(without, before, "without a second opinion");
    }
}
