//! A reward surface as numbers on a grid, and its colours.

use serde::{Deserialize, Serialize};

use crate::draw::Colour;
use foveate_core::gaze::Surface;
use foveate_core::geometry::Gaze;

/// A reward surface: mean and standard deviation of the reward of gazes, on n × n points of the square from −reach to reach.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Heat {
    /// Points along a side.
    pub n: usize,
    /// Half the side of the square, in template units.
    pub reach: f64,
    /// Mean reward, row by row from the top, each row from the left: n² values.
    pub mean: Vec<f64>,
    /// Its standard deviation, in the same order.
    pub sd: Vec<f64>,
}

impl Heat {
    /// Samples a surface on n × n points, n at least 2.
    pub fn of(surface: &dyn Surface, n: usize) -> Self {
        let (n, reach) = (n.max(2), surface.reach());
        let at = |i: usize| reach * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
        let (mean, sd) = (0..n * n).map(|i| surface.at(at(i % n), at(i / n))).unzip();
        Self { n, reach, mean, sd }
    }
    /// Returns the mixture of several runs' surfaces on the same points: its mean, and the standard deviation that combines the runs' means
    /// with their own deviations. `None` without a surface, or if the points differ.
    pub fn average(all: &[Self]) -> Option<Self> {
        let first = all.first()?;
        if all.iter().any(|heat| (heat.n, heat.reach) != (first.n, first.reach)) {
            return None;
        }
        let runs = all.len() as f64;
        let over = |of: &dyn Fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / runs;
        let mean: Vec<f64> = (0..first.mean.len()).map(|i| over(&|heat| heat.mean[i])).collect();
        let variance = |i: usize| over(&|heat| (heat.mean[i] - mean[i]).powi(2) + heat.sd[i].powi(2));
        let sd = (0..mean.len()).map(|i| variance(i).sqrt()).collect();
        Some(Self { n: first.n, reach: first.reach, mean, sd })
    }
    /// Interpolates `values` (the mean or the sd) bilinearly at a gaze; `None` outside the points.
    pub fn read(&self, values: &[f64], u: f64, v: f64) -> Option<f64> {
        let place = |x: f64| (x / self.reach + 1.0) / 2.0 * (self.n - 1) as f64;
        let (x, y, last) = (place(u), place(v), (self.n - 1) as f64);
        if !((0.0..=last).contains(&x) && (0.0..=last).contains(&y)) {
            return None;
        }
        let (i, j) = ((x as usize).min(self.n - 2), (y as usize).min(self.n - 2));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let row = |j: usize| (1.0 - fx) * values[j * self.n + i] + fx * values[j * self.n + i + 1];
        Some((1.0 - fy) * row(j) + fy * row(j + 1))
    }
    /// Returns the grid point with the largest mean; `None` without a point.
    pub fn best(&self) -> Option<Gaze> {
        let k = (0..self.mean.len()).max_by(|a, b| self.mean[*a].total_cmp(&self.mean[*b]))?;
        let at = |i: usize| self.reach * (2.0 * i as f64 / (self.n - 1) as f64 - 1.0);
        Some(Gaze { u: at(k % self.n), v: at(k / self.n), arm: None })
    }
}

/// Returns the minimum and the maximum of the finite values; (0, 1) if there are none.
pub fn span(values: &[f64]) -> (f64, f64) {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// Returns the colour of a fraction, 0 to 1: indigo, violet, rose, pale yellow. Brightness increases monotonically, so that colour-blind
/// people and grey prints show it. Values that are not finite count as 0.
pub fn ramp(share: f64) -> Colour {
    const STOPS: [[f64; 3]; 4] =
        [[26.0, 16.0, 70.0], [111.0, 71.0, 230.0], [224.0, 82.0, 143.0], [255.0, 236.0, 130.0]];
    let t = 3.0 * if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    let i = (t as usize).min(2);
    let f = t - i as f64;
    std::array::from_fn(|c| (STOPS[i][c] + f * (STOPS[i + 1][c] - STOPS[i][c])).round() as u8)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A hill at (0.4, −0.2); its uncertainty grows with the distance from the centre.
    pub(crate) struct Hill(pub Vec<Gaze>);

    impl Surface for Hill {
        fn reach(&self) -> f64 {
            1.0
        }
        fn at(&self, u: f64, v: f64) -> (f64, f64) {
            (0.2 + 0.6 * (-2.0 * ((u - 0.4).powi(2) + (v + 0.2).powi(2))).exp(), 0.05 + 0.1 * u.hypot(v))
        }
        fn fixations(&self) -> &[Gaze] {
            &self.0
        }
        fn best(&self) -> Option<Gaze> {
            (!self.0.is_empty()).then_some(Gaze { u: 0.4, v: -0.2, arm: None })
        }
    }

    #[test]
    fn a_surface_is_read_back() {
        let heat = Heat::of(&Hill(vec![]), 21);
        assert_eq!(
            (heat.mean.len(), heat.best()),
            (441, Some(Gaze { u: 0.3999999999999999, v: -0.19999999999999996, arm: None }))
        );
        for (u, v) in [(0.0, 0.0), (-1.0, 1.0), (1.0, -1.0), (0.3, -0.7)] {
            let (mean, sd) = Hill(vec![]).at(u, v);
            assert!((heat.read(&heat.mean, u, v).expect("inside") - mean).abs() < 1e-9, "on the points");
            assert!((heat.read(&heat.sd, u, v).expect("inside") - sd).abs() < 1e-9);
        }
        // Between points a bilinear patch is off by less than the curvature (4 × 0.6 at most) times spacing² / 4.
        let between = heat.read(&heat.mean, 0.43, -0.17).expect("inside");
        assert!((between - Hill(vec![]).at(0.43, -0.17).0).abs() < 2.4 * 0.01 / 4.0);
        assert_eq!((heat.read(&heat.mean, 1.01, 0.0), heat.read(&heat.mean, 0.0, f64::NAN)), (None, None));
    }

    #[test]
    fn runs_are_averaged() {
        let one = |mean: f64, sd: f64| Heat { n: 2, reach: 1.0, mean: vec![mean; 4], sd: vec![sd; 4] };
        let both = Heat::average(&[one(0.2, 0.0), one(0.4, 0.0)]).expect("two of a kind");
        assert!((both.mean[0] - 0.3).abs() < 1e-15 && (both.sd[3] - 0.1).abs() < 1e-15);
        assert!((Heat::average(&[one(0.2, 0.3)]).expect("one").sd[0] - 0.3).abs() < 1e-15);
        assert!(Heat::average(&[one(0.0, 0.0), Heat { reach: 2.0, ..one(0.0, 0.0) }]).is_none());
        assert!(Heat::average(&[]).is_none());
    }

    #[test]
    fn the_ramp_grows_brighter() {
        let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2);
        let light = |c: Colour| 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
        assert!((1..=100).all(|i| light(ramp(f64::from(i) / 100.0)) > light(ramp(f64::from(i - 1) / 100.0))));
        assert_eq!((ramp(-1.0), ramp(f64::NAN), ramp(9.0)), (ramp(0.0), ramp(0.0), ramp(1.0)));
        assert_eq!((span(&[f64::NAN, 2.0, -1.0]), span(&[])), ((-1.0, 2.0), (0.0, 1.0)));
    }
}
