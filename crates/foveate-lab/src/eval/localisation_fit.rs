//! Fits how the covariance of the reported place follows from its evidence, on tracks with ground truth.

use super::confidence::{Judged, Judgement, REGIONS, coverage};
use foveate_base::{Error, Result};
use foveate_core::control::{ConfidenceModel, Localisation};

/// The first and the last step of the search, as logarithms of a factor.
const STEPS: [f64; 2] = [1.0, 0.01];
/// Frames are put in this many groups of equal size.
const GROUPS: usize = 20;
/// How much a miss of each of [`REGIONS`] counts: errors of sharp targets are normal, those of others have a Student distribution, and one
/// size of regions serves both at 90 %.
const WEIGHTS: [f64; 2] = [1.0, 4.0];

/// Fits the localisation on these tracks; everything else stays, so that a tracker with the new model makes the same boxes. The 50 and 90 %
/// regions come as close as they can to holding 50 and 90 % of the frames on the target, at every expected error of the box regression and
/// every effective sample size. Without box regression only the localisation noise is fitted.
///
/// # Errors
/// No frame is on the target.
pub fn fit_localisation(tracks: &[&Judgement], model: &ConfidenceModel) -> Result<ConfidenceModel> {
    let on = tracks.iter().flat_map(|t| &t.frames).filter(|j| !j.lost() && j.off.is_some());
    let on: Vec<Judged> = on.copied().collect();
    if on.is_empty() {
        return Err(Error::Invalid("a localisation needs frames on the target; these tracks have none".into()));
    }
    let groups = [groups(&on, expected), groups(&on, |j| j.place.ess)].concat();
    let miss = |model: &ConfidenceModel| -> f64 {
        let of = |group: &Vec<Judged>, p: f64| (coverage(group.iter().map(|j| j.located(model)), p) - p).powi(2);
        groups.iter().flat_map(|group| REGIONS.iter().zip(WEIGHTS).map(move |(&p, weight)| weight * of(group, p))).sum()
    };
    if on.iter().all(|j| j.place.errors == [0.0; 2]) {
        let with = |logs: &[f64; 1]| ConfidenceModel { localisation_noise: rounded(logs[0].exp()), ..model.clone() };
        return Ok(with(&lowest([-2.0], |logs| miss(&with(logs)))));
    }
    let with = |logs: &[f64; 6]| {
        let [belief, borders, pixels, lone, sharp, localisation_noise] = logs.map(|log| rounded(log.exp()));
        // The share of the speed follows from exposure times.
        let speed = model.localisation.speed;
        let localisation = Localisation { belief, borders, pixels, lone, sharp: sharp.min(1.0), speed };
        ConfidenceModel { localisation, localisation_noise, ..model.clone() }
    };
    Ok(with(&lowest([0.0, 1.5, -2.0, -2.0, -3.5, -5.3], |logs| miss(&with(logs)))))
}

/// Returns the expected error of the box regression, half boxes.
fn expected(frame: &Judged) -> f64 {
    frame.place.errors[0].hypot(frame.place.errors[1]) / frame.place.unit.max(1e-6)
}

/// Returns the frames in the order of a number, cut into groups of equal size.
fn groups(frames: &[Judged], by: impl Fn(&Judged) -> f64) -> Vec<Vec<Judged>> {
    let mut sorted = frames.to_vec();
    sorted.sort_by(|a, b| by(a).total_cmp(&by(b)));
    sorted.chunks(sorted.len().div_ceil(GROUPS)).map(<[Judged]>::to_vec).collect()
}

fn rounded(x: f64) -> f64 {
    (10_000.0 * x).round() / 10_000.0
}

/// Descends a function of a few numbers from `start`, one number at a time, in shrinking steps.
fn lowest<const N: usize>(start: [f64; N], value: impl Fn(&[f64; N]) -> f64) -> [f64; N] {
    let (mut at, mut step) = (start, STEPS[0]);
    let mut best = value(&at);
    while step > STEPS[1] {
        let before = best;
        for (k, direction) in (0..N).flat_map(|k| [(k, step), (k, -step)]) {
            let mut next = at;
            next[k] = (next[k] + direction).clamp(-12.0, 4.0);
            let there = value(&next);
            if there < best {
                (at, best) = (next, there);
            }
        }
        if best >= before {
            step *= 0.5;
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::catalogue::origin;
    use foveate_base::rng::Streams;
    use foveate_core::control::{Cues, PlaceEvidence, Status};
    use foveate_core::seen::credible;
    use rand::RngExt;

    /// Frames with errors of the distribution whose regions are reported, by the covariance that this model gives.
    fn tracks(known: &ConfidenceModel, errors: [f64; 3]) -> Vec<Judgement> {
        let mut rng = Streams::new(5, 0).rng(0);
        let mut frame = |i: usize| {
            let (r, turn) = (credible(rng.random::<f64>()).sqrt(), std::f64::consts::TAU * rng.random::<f64>());
            let (spread, error) = ([0.2, 0.4, 0.6][i / 3 % 3], errors[i % 3]);
            let (belief, ess) = ([spread * spread, 0.0, spread * spread], if i.is_multiple_of(7) { 1.0 } else { 20.0 });
            let place = PlaceEvidence { belief, errors: [error, error], ess, unit: 10.0, ..Default::default() };
            let [xx, xy, yy] = known.localisation.place(known.localisation_noise, &place);
            assert_eq!(xy, 0.0, "an upright belief");
            let off = Some([xx.sqrt() * r * turn.cos() / 10.0, yy.sqrt() * r * turn.sin() / 10.0]);
            let (status, cues) = (Status::Tracking, Cues::default());
            Judged { p_lost: 0.0, status, cues, iou: 1.0, off, covariance: [1.0, 0.0, 1.0], place }
        };
        let frames = (0..6000).map(&mut frame).collect();
        vec![Judgement { video: "Coke".into(), origin: origin("Coke"), occluded: false, frames }]
    }

    fn fitted(tracks: &[Judgement]) -> ConfidenceModel {
        fit_localisation(&tracks.iter().collect::<Vec<_>>(), &ConfidenceModel::default()).expect("frames on the target")
    }

    #[test]
    fn what_the_errors_were_made_with_is_found() {
        let localisation = Localisation { belief: 0.6, borders: 2.0, pixels: 0.2, lone: 0.5, sharp: 0.03, speed: 0.0 };
        let known = ConfidenceModel { localisation, localisation_noise: 0.02, ..ConfidenceModel::default() };
        let model = fitted(&tracks(&known, [0.2, 0.3, 1.5]));
        let untouched = ConfidenceModel { localisation, localisation_noise: 0.02, ..model.clone() };
        assert_eq!(untouched, known, "nothing else is touched");
        let (found, noise) = (model.localisation, model.localisation_noise);
        for (name, found, known) in [
            ("borders", found.borders, 2.0),
            ("lone", found.lone, 0.5),
            ("sharp", found.sharp, 0.03),
            ("noise", noise, 0.02),
        ] {
            assert!((found / known).ln().abs() < 0.2, "{name}: {found} for {known}");
        }
    }

    #[test]
    fn without_a_box_regression_it_is_the_noise() {
        let known = ConfidenceModel { localisation_noise: 0.1, ..ConfidenceModel::default() };
        let found = fitted(&tracks(&known, [0.0; 3]));
        assert!((found.localisation_noise / 0.1).ln().abs() < 0.1, "{}", found.localisation_noise);
        assert_eq!(found.localisation, Localisation::default());
        assert!(fit_localisation(&[], &known).is_err(), "no frames");
    }
}
