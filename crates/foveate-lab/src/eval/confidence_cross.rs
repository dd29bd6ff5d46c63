//! P(lost) tested on tracks that it was not fitted on: each group of videos (a half, a source) with a model fitted without it.

use super::choice::GroupOf;
use super::confidence::Judgement;
use super::confidence::{ConfidenceScore, Judged};
use super::table::aligned;
use foveate_base::Result;
use foveate_core::control::ConfidenceModel;
use rayon::prelude::*;

/// A fitting function: `confidence_fit::fit`, or a part of it.
pub type Fitting = fn(&[&Judgement], &ConfidenceModel) -> Result<ConfidenceModel>;

/// Returns the tracks, in their order, with the reports of a model that was fitted without the videos of their group. Boxes and searches
/// are those of the tracked model.
///
/// # Errors
/// As the fitting: there is only one group, or the others have no lost frame or no frame on the target.
pub fn cross_fit(
    tracks: &[Judgement],
    confidence: &ConfidenceModel,
    fit: Fitting,
    group: GroupOf,
) -> Result<Vec<Vec<Judged>>> {
    let mut groups: Vec<&str> = tracks.iter().map(|t| group(&t.origin)).collect();
    groups.sort();
    groups.dedup();
    let mut judged = vec![vec![]; tracks.len()];
    let without =
        |left_out: &&str| fit(&tracks.iter().filter(|t| group(&t.origin) != *left_out).collect::<Vec<_>>(), confidence);
    let models = groups.par_iter().map(without).collect::<Result<Vec<_>>>()?;
    for (left_out, model) in groups.into_iter().zip(models) {
        for (track, judged) in tracks.iter().zip(&mut judged).filter(|(t, _)| group(&t.origin) == left_out) {
            *judged = ConfidenceScore::rejudged(&track.frames, &model);
        }
    }
    Ok(judged)
}

/// Formats the scores of P(lost) as aligned text, one line for each group of tracks or fitting method, with `first` above the names.
pub fn text(first: &str, lines: &[(String, ConfidenceScore)]) -> String {
    let heads = [
        first,
        "frames",
        "lost",
        "calibration error",
        "lost where P(lost) < 10 %",
        "false alarms per 1000",
        "lost frames reported",
        "at 40 per 1000",
        "in 50 / 90 % region",
    ];
    let or = |v: Option<String>| v.unwrap_or_else(|| "-".into());
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    let line = |(name, s): &(String, ConfidenceScore)| {
        vec![
            name.clone(),
            s.frames.to_string(),
            s.lost.to_string(),
            format!("{:.3}", s.ece),
            or(s.lost_below_tenth().map(percent)),
            or(s.false_alarms.map(|f| format!("{f:.1}"))),
            or(s.reported.map(percent)),
            or(s.reported_at.map(percent)),
            or(s.coverage.map(|c| c.map(|v| format!("{v:.2}")).join(" / "))),
        ]
    };
    let all: Vec<Vec<String>> =
        std::iter::once(heads.map(String::from).to_vec()).chain(lines.iter().map(line)).collect();
    aligned(&all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::catalogue::origin;
    use crate::eval::choice::{by_half, by_source};
    use crate::eval::confidence_fit::fit;
    use foveate_core::control::{Cues, Status};

    /// A hundred frames, with the last twenty lost. The first cue is 1 if the target is lost, times `sign`.
    fn track(video: &str, sign: f64) -> Judgement {
        let frame = |i: usize| {
            let lost = i >= 80;
            let mut cues = Cues::default();
            cues[0] = if lost { sign } else { -sign };
            let (p_lost, iou) = (0.5, if lost { 0.0 } else { 1.0 });
            Judged {
                p_lost,
                status: Status::Tracking,
                cues,
                iou,
                off: Some([0.0, 0.0]),
                covariance: [1.0, 0.0, 1.0],
                place: Default::default(),
            }
        };
        Judgement { video: video.into(), origin: origin(video), occluded: false, frames: (0..100).map(frame).collect() }
    }

    /// In half b (Couple, Crossing) the cue means the opposite of its meaning in half a (Coke, Bag). A model fitted on the other half is
    /// therefore wrong in every frame; a model with one source left out was fitted on both.
    #[test]
    fn what_is_judged_was_not_fitted_on() {
        let tracks = [("Coke", 1.0), ("Couple", -1.0), ("Bag", 1.0), ("Crossing", -1.0)].map(|(v, s)| track(v, s));
        let model = ConfidenceModel::default();
        let halves = cross_fit(&tracks, &model, fit, by_half).expect("both kinds of frames");
        for (track, judged) in tracks.iter().zip(&halves) {
            assert_eq!(judged.len(), 100);
            assert!(judged.iter().all(|j| (j.p_lost > 0.5) != j.lost()), "{}", track.video);
        }
        let same = [track("Coke", 1.0), track("Couple", 1.0), track("Jogging", 1.0), track("Jogging-2", -1.0)];
        let sources = cross_fit(&same, &model, fit, by_source).expect("both kinds of frames");
        assert!(sources[2].iter().all(|j| (j.p_lost > 0.5) == j.lost()), "fitted on Coke and Couple alone");
        assert!(sources[3].iter().all(|j| (j.p_lost > 0.5) != j.lost()), "its source is left out as a whole");
        assert!(cross_fit(&tracks[..1], &model, fit, by_half).is_err(), "nothing to fit on");

        let tracks: Vec<&[Judged]> = sources[2..3].iter().map(Vec::as_slice).collect();
        let score = ConfidenceScore::of(&tracks);
        assert_eq!(score.lost_below_tenth(), Some(0.0));
        let said = text("fitted on", &[("by source".into(), score)]);
        assert!(said.lines().nth(1).is_some_and(|l| l.starts_with("by source") && l.contains(" 100    20 ")), "{said}");
    }
}
