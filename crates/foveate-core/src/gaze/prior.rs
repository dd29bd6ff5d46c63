//! The prior mean of a gaze's reward: saliency, which the paper's last section proposes, or a rehearsal on the first picture.

use crate::geometry::Gaze;
use crate::saved_state::{Valid, Validate, ensure};
use foveate_base::rng::Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Gazes along a side of the square at which the prior is evaluated.
const SIDE: usize = 15;

/// Saliency or rehearsal over the square of gazes, with mean 0 and deviation 1; or no prior.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Prior {
    /// Row by row from −reach to reach; empty for a prior of 0 everywhere.
    values: Vec<f64>,
}

impl Validate for Prior {
    fn validate(&self, (): &()) -> Valid {
        ensure(
            [0, SIDE * SIDE].contains(&self.values.len()) && self.values.iter().all(|v| v.abs() <= SIDE as f64),
            || format!("its prior is not {} standardised values", SIDE * SIDE),
        )
    }
}

impl Prior {
    /// Evaluates the whole square of half side `reach`. If all values are equal, the prior is empty.
    pub(super) fn of(reach: f64, worth: &mut dyn FnMut(Gaze) -> f64) -> Self {
        let values: Vec<f64> = (0..SIDE * SIDE).map(|i| worth(gaze(reach, i))).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        // This comparison is also false for NaN.
        match deviation > 1e-6 {
            true => Self { values: values.iter().map(|v| (v - mean) / deviation).collect() },
            false => Self::default(),
        }
    }
    /// Returns the prior at (u, v) of a square of half side `reach`, interpolated between the evaluated gazes.
    pub(super) fn at(&self, reach: f64, u: f64, v: f64) -> f64 {
        if self.values.is_empty() {
            return 0.0;
        }
        let last = (SIDE - 1) as f64;
        let [x, y] = [u, v].map(|c| (0.5 * last * (c / reach + 1.0)).clamp(0.0, last));
        let [i, j] = [x, y].map(|c| (c as usize).min(SIDE - 2));
        let (right, below) = (x - i as f64, y - j as f64);
        let row = |j: usize| {
            let k = j * SIDE + i;
            (1.0 - right) * self.values[k] + right * self.values[k + 1]
        };
        (1.0 - below) * row(j) + below * row(j + 1)
    }
    /// Draws a gaze with a probability in proportion to the exponential of `weight` times its prior. Returns `None` if the prior is empty;
    /// no random number is drawn then, so that later draws are those without a prior.
    pub(super) fn draw(&self, reach: f64, weight: f64, rng: &mut Rng) -> Option<Gaze> {
        if self.values.is_empty() {
            return None;
        }
        // The largest exponent is 0, so that large deviations do not overflow.
        let largest = self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let share = |value: &f64| (weight * (value - largest)).exp();
        let mut left = rng.random::<f64>() * self.values.iter().map(share).sum::<f64>();
        let drawn = self.values.iter().position(|value| {
            left -= share(value);
            left < 0.0
        });
        Some(gaze(reach, drawn.unwrap_or(SIDE * SIDE - 1)))
    }
}

/// The gaze at `i`, row after row.
fn gaze(reach: f64, i: usize) -> Gaze {
    let along = |k: usize| reach * (2.0 * k as f64 / (SIDE - 1) as f64 - 1.0);
    Gaze { u: along(i % SIDE), v: along(i / SIDE), arm: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};

    #[test]
    fn it_has_mean_0_and_deviation_1_and_is_linear_between() {
        let prior = Prior::of(0.5, &mut |gaze| 3.0 + 2.0 * gaze.u - gaze.v);
        let n = prior.values.len() as f64;
        assert!(prior.values.iter().sum::<f64>().abs() < 1e-9);
        assert!((prior.values.iter().map(|v| v * v).sum::<f64>() - n).abs() < 1e-9);
        // A plane is interpolated exactly, by its slope from the centre, where it is 0.
        let slope = prior.at(0.5, 0.5, 0.0) / 0.5;
        for (u, v) in [(0.13, -0.4), (-0.5, 0.5), (0.499, 0.01)] {
            assert!((prior.at(0.5, u, v) - slope * (u - 0.5 * v)).abs() < 1e-9, "at {u}, {v}");
        }
    }

    #[test]
    fn equal_values_give_an_empty_prior() {
        for value in [0.3, f64::NAN] {
            let prior = Prior::of(0.5, &mut |_| value);
            assert_eq!(prior, Prior::default());
            assert_eq!(prior.at(0.5, 0.2, 0.1), 0.0);
            assert_eq!(prior.draw(0.5, 1.0, &mut Streams::new(1, 0).at(0, Purpose::Look).rng(0)), None);
        }
    }

    /// 2000 draws with seed 1, two halves, one with e² times the other's probability: 88 % ± 4 standard deviations of 0.7 %.
    #[test]
    fn salient_gazes_are_drawn_more_often() {
        let prior = Prior::of(1.0, &mut |gaze| f64::from(u8::from(gaze.u >= 0.0)));
        let mut rng = Streams::new(1, 0).at(0, Purpose::Look).rng(0);
        let right = (0..2000).filter(|_| prior.draw(1.0, 1.0, &mut rng).expect("not all alike").u >= 0.0).count();
        // 8 of 15 columns, standardised: the halves differ by 1 / √(8·7)/15.
        let apart = 15.0 / 56f64.sqrt();
        let expected = 8.0 * apart.exp() / (8.0 * apart.exp() + 7.0);
        assert!((right as f64 / 2000.0 - expected).abs() < 0.03, "{right} of 2000, expected a share of {expected:.3}");
    }

    #[test]
    fn values_that_no_prior_has_are_refused() {
        assert_eq!(Prior::of(0.5, &mut |gaze| gaze.u * gaze.v).validate(&()), Ok(()));
        assert!(Prior { values: vec![0.0; 7] }.validate(&()).is_err());
        assert!(Prior { values: vec![f64::NAN; SIDE * SIDE] }.validate(&()).is_err());
    }
}
