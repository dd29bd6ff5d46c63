//! Natural cubic splines through points at whole parameters: the paths of synthetic targets.

/// A curve in the plane: twice continuously differentiable, through point `i` at parameter `i`,
/// with no curvature at its ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    points: Vec<[f64; 2]>,
    /// Second derivatives at the points.
    bends: Vec<[f64; 2]>,
}

impl Spline {
    /// The curve through `points`. Panics without a point.
    pub fn through(points: Vec<[f64; 2]>) -> Self {
        assert!(!points.is_empty(), "a curve needs a point");
        let n = points.len();
        let mut bends = vec![[0.0; 2]; n];
        // Thomas' algorithm on b[i-1] + 4 b[i] + b[i+1] = 6 (p[i-1] - 2 p[i] + p[i+1]), b[0] = b[n-1] = 0.
        let mut factor = vec![0.0; n];
        for i in 1..n.saturating_sub(1) {
            let pivot = 4.0 - factor[i - 1];
            factor[i] = 1.0 / pivot;
            let before = bends[i - 1];
            bends[i] = [0, 1].map(|k| {
                let right = 6.0 * (points[i - 1][k] - 2.0 * points[i][k] + points[i + 1][k]);
                (right - before[k]) / pivot
            });
        }
        for i in (1..n.saturating_sub(1)).rev() {
            let after = bends[i + 1];
            bends[i] = [0, 1].map(|k| bends[i][k] - factor[i] * after[k]);
        }
        Self { points, bends }
    }

    /// The largest parameter.
    pub fn end(&self) -> f64 {
        (self.points.len() - 1) as f64
    }

    /// The point at parameter `t`, 0 to [`Spline::end`]; beyond, the end point.
    pub fn at(&self, t: f64) -> [f64; 2] {
        let t = t.clamp(0.0, self.end());
        let i = (t as usize).min(self.points.len().saturating_sub(2));
        let j = (i + 1).min(self.points.len() - 1);
        let (b, a) = (t - i as f64, 1.0 - (t - i as f64));
        [0, 1].map(|k| {
            let bend = (a * a * a - a) * self.bends[i][k] + (b * b * b - b) * self.bends[j][k];
            a * self.points[i][k] + b * self.points[j][k] + bend / 6.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_natural_cubic_spline() {
        let points = vec![[0.0, 3.0], [5.0, 1.0], [2.0, 8.0], [9.0, 9.0], [4.0, -2.0]];
        let curve = Spline::through(points.clone());
        for (i, p) in points.iter().enumerate() {
            let q = curve.at(i as f64);
            assert!((0..2).all(|k| (p[k] - q[k]).abs() < 1e-12), "{p:?} {q:?}");
        }
        // First and second differences agree from both sides of an inner point; none bends at the ends.
        let e = 1e-4;
        let second = |t: f64, k: usize| {
            let at = |t: f64| curve.at(t)[k];
            (at(t - e) - 2.0 * at(t) + at(t + e)) / (e * e)
        };
        for k in 0..2 {
            for i in 1..4 {
                let t = i as f64;
                let slope = |t: f64| (curve.at(t + e)[k] - curve.at(t - e)[k]) / (2.0 * e);
                assert!((slope(t - 2.0 * e) - slope(t + 2.0 * e)).abs() < 0.05);
                assert!((second(t - 2.0 * e, k) - second(t + 2.0 * e, k)).abs() < 0.05);
            }
            assert!(second(e, k).abs() < 0.05 && second(4.0 - e, k).abs() < 0.05);
        }
    }

    #[test]
    fn few_points_make_points_and_lines() {
        assert_eq!(Spline::through(vec![[2.0, 3.0]]).at(0.7), [2.0, 3.0]);
        assert_eq!(Spline::through(vec![[0.0, 0.0], [2.0, 4.0]]).at(0.5), [1.0, 2.0]);
    }
}
