//! Climbing to a local maximum within the unit cube, by quasi-Newton steps on differences.

use crate::bfgs::{MOST, Objective, Row, minimise};

/// How far a point is moved for differences.
const STEP: f64 = 1e-5;
/// The most quasi-Newton steps.
const STEPS: usize = 30;
/// A step that gains less ends the climb.
const TOLERANCE: f64 = 1e-9;

/// The function to maximise: its values at points.
type Bound<'a, const D: usize> = dyn FnMut(&[[f64; D]], &mut [f64]) + 'a;

struct Hill<'a, const D: usize> {
    bound: &'a mut Bound<'a, D>,
    /// The point at hand, and its value.
    at: [f64; D],
    here: f64,
}

impl<const D: usize> Hill<'_, D> {
    /// Values a step below and a step above, along each axis.
    fn around(&mut self) -> ([f64; D], [f64; D]) {
        let moved = |step: f64| {
            std::array::from_fn(|d| {
                let mut point = self.at;
                point[d] += step;
                point
            })
        };
        let points: [[[f64; D]; D]; 2] = [-STEP, STEP].map(moved);
        let mut values = [[0.0; D]; 2];
        for (points, values) in points.iter().zip(&mut values) {
            (self.bound)(points, values);
        }
        (values[0], values[1])
    }
}

impl<const D: usize> Objective for Hill<'_, D> {
    fn value(&mut self, x: &[f64]) -> f64 {
        self.at.copy_from_slice(x);
        let mut value = [0.0];
        (self.bound)(&[self.at], &mut value);
        self.here = value[0];
        -value[0]
    }
    fn gradient(&mut self, g: &mut [f64]) {
        let (below, above) = self.around();
        (0..D).for_each(|d| g[d] = (below[d] - above[d]) / (2.0 * STEP));
    }
    fn curvature(&mut self, b: &mut [Row]) {
        let (below, above) = self.around();
        for d in 0..D {
            b[d][d] = ((2.0 * self.here - below[d] - above[d]) / (STEP * STEP)).max(1.0);
        }
    }
}

/// A local maximum near `start`, and its value.
pub(super) fn climb<'a, const D: usize>(start: [f64; D], bound: &'a mut Bound<'a, D>) -> ([f64; D], f64) {
    const { assert!(D <= MOST, "as many variables as a fit has") };
    let mut hill = Hill { bound, at: start, here: 0.0 };
    let mut x = start;
    let value = hill.value(&x);
    let outcome = minimise(&mut hill, &mut x, &[(0.0, 1.0); D], value, TOLERANCE, STEPS);
    (x, -outcome.value)
}
