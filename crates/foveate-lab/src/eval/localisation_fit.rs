//! Fits how the covariance of the reported place follows from its evidence, on tracks with ground truth.

use super::confidence::{Judged, Judgement, REGIONS, coverage};
use foveate_base::{Error, Result};
use foveate_core::control::{ConfidenceModel, Localisation};
use foveate_core::seen::log_density;

/// The first and the last step of the search, as logarithms of a factor.
const STEPS: [f64; 2] = [1.0, 0.01];

/// Fits the localisation on these tracks; everything else stays, so that a tracker with the new model makes the same boxes. Without box
/// regression that is the localisation noise; with box regression, the localisation under which the true centres are most likely, times a
/// factor. Noise and factor are those for which the 50 and 90 % regions come closest to holding 50 and 90 % of the frames on the target.
///
/// # Errors
/// No frame is on the target.
pub fn fit_localisation(tracks: &[&Judgement], model: &ConfidenceModel) -> Result<ConfidenceModel> {
    let on = tracks.iter().flat_map(|t| &t.frames).filter(|j| !j.lost() && j.off.is_some());
    let on: Vec<Judged> = on.copied().collect();
    if on.is_empty() {
        return Err(Error::Invalid("a localisation needs frames on the target; these tracks have none".into()));
    }
    let miss = |model: &ConfidenceModel| -> f64 {
        REGIONS.iter().map(|p| (coverage(on.iter().map(|j| j.located(model)), *p) - p).powi(2)).sum()
    };
    // A factor of 2 % a step.
    let factors = |from: i32, to: i32| (from..=to).map(|k| (0.02 * f64::from(k)).exp());
    if on.iter().all(|j| j.place.errors == [0.0; 2]) {
        let with = |localisation_noise| ConfidenceModel { localisation_noise, ..model.clone() };
        let noises = std::iter::once(0.0).chain(factors(-230, 70)).map(rounded);
        return Ok(closest(noises.map(with), miss));
    }
    let of = |logs: &[f64; 5]| ConfidenceModel {
        localisation: localisation(logs, model.localisation.speed),
        localisation_noise: 0.0,
        ..model.clone()
    };
    let likelihood = |logs: &[f64; 5]| {
        let model = of(logs);
        let terms = on.iter().filter_map(|j| j.located(&model).squares());
        terms.map(|(squares, determinant)| log_density(squares) - 0.5 * determinant.ln()).sum::<f64>()
    };
    let best = highest([0.0f64, 1.0, -1.0, -2.0, -3.5], likelihood);
    let with = |factor: f64| ConfidenceModel { localisation: scaled(&of(&best).localisation, factor), ..of(&best) };
    Ok(closest(factors(-50, 50).map(with), miss))
}

/// Returns the model with the smallest miss.
fn closest(models: impl Iterator<Item = ConfidenceModel>, miss: impl Fn(&ConfidenceModel) -> f64) -> ConfidenceModel {
    let judged = models.map(|model| (miss(&model), model));
    judged.min_by(|a, b| a.0.total_cmp(&b.0)).expect("a hundred models").1
}

fn rounded(x: f64) -> f64 {
    (1000.0 * x).round() / 1000.0
}

/// Returns the localisation of these logarithms. The share of the speed follows from exposure times and is not fitted.
fn localisation(logs: &[f64; 5], speed: f64) -> Localisation {
    let [belief, borders, pixels, lone, sharp] = logs.map(f64::exp);
    Localisation { belief, borders, pixels, lone, sharp: sharp.min(1.0), speed }
}

/// Returns the localisation with this many times the variances, in thousandths.
fn scaled(it: &Localisation, factor: f64) -> Localisation {
    let root = factor.sqrt();
    Localisation {
        belief: rounded(factor * it.belief),
        borders: rounded(factor * it.borders),
        pixels: rounded(root * it.pixels),
        lone: rounded(root * it.lone),
        sharp: rounded(it.sharp),
        ..*it
    }
}

/// Climbs a function of a few numbers from `start`, one number at a time, in shrinking steps.
fn highest<const N: usize>(start: [f64; N], value: impl Fn(&[f64; N]) -> f64) -> [f64; N] {
    let (mut at, mut step) = (start, STEPS[0]);
    let mut best = value(&at);
    while step > STEPS[1] {
        let before = best;
        for (k, direction) in (0..N).flat_map(|k| [(k, step), (k, -step)]) {
            let mut next = at;
            next[k] = (next[k] + direction).clamp(-12.0, 4.0);
            let there = value(&next);
            if there > best {
                (at, best) = (next, there);
            }
        }
        if best <= before {
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
        let known = ConfidenceModel { localisation, ..ConfidenceModel::default() };
        let found = fitted(&tracks(&known, [0.25, 0.5, 1.5]));
        assert_eq!(ConfidenceModel { localisation, ..found.clone() }, known, "nothing else is touched");
        let found = found.localisation;
        for (name, found, known) in
            [("borders", found.borders, 2.0), ("lone", found.lone, 0.5), ("sharp", found.sharp, 0.03)]
        {
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
