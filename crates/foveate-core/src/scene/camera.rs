//! How the camera moved: the affine flow that most of a frame has.

use crate::scene::Map;

/// An affine flow: `(u, v) = (a₀ + a₁ x + a₂ y, b₀ + b₁ x + b₂ y)`, pixels a frame at image coordinates `(x, y)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Affine {
    /// a₀, a₁, a₂: the flow across.
    pub u: [f64; 3],
    /// b₀, b₁, b₂: the flow down.
    pub v: [f64; 3],
}

/// Passes of reweighting.
const PASSES: i32 = 12;
/// Distance at which a place counts half, in pixels a frame: in the first pass, halved with each, and in the last ones.
const HALF: [f64; 2] = [8.0, 0.5];

/// Cells along the edges that are ignored if a map is large enough: patches there lose pixels that leave the picture.
const EDGE: usize = 8;

impl Affine {
    /// The flow at a place.
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let along = |c: &[f64; 3]| c[0] + c[1] * x + c[2] * y;
        (along(&self.u), along(&self.v))
    }
    /// Fits a field of flow: least squares, reweighted by 1 / (1 + (r / half)²) (Cauchy's weights; half decreases to
    /// ½ pixel), so that independent motion has little weight if it is the smaller part. The start is the median of
    /// the field. Cells are taken 4 apart; `places` is a scratch buffer.
    pub fn fit(u: &Map, v: &Map, places: &mut Vec<[f64; 4]>) -> Self {
        let (w, cell) = (u.width(), u.cell() as f64);
        places.clear();
        let inner = |side: usize| (EDGE.min(side / 4)..side - EDGE.min(side / 4)).step_by(4);
        for j in inner(u.height()) {
            for i in inner(w) {
                let centre = |i: usize| cell * (i as f64 + 0.5) - 0.5;
                places.push([centre(i), centre(j), f64::from(u.at(i, j)), f64::from(v.at(i, j))]);
            }
        }
        let mut fit = Self::default();
        let middle = places.len() / 2;
        if places.is_empty() {
            return fit;
        }
        for (k, first) in [(2, &mut fit.u[0]), (3, &mut fit.v[0])] {
            *first = places.select_nth_unstable_by(middle, |a, b| a[k].total_cmp(&b[k])).1[k];
        }
        for pass in 0..PASSES {
            let half = (HALF[0] * 0.5_f64.powi(pass)).max(HALF[1]);
            let (mut normal, mut right) = ([[0.0; 3]; 3], [[0.0; 3]; 2]);
            for [x, y, u, v] in places.iter() {
                let (mu, mv) = fit.at(*x, *y);
                let off = ((u - mu).powi(2) + (v - mv).powi(2)) / (half * half);
                let weight = 1.0 / (1.0 + off);
                let row = [1.0, *x, *y];
                for a in 0..3 {
                    for b in 0..3 {
                        normal[a][b] += weight * row[a] * row[b];
                    }
                    right[0][a] += weight * row[a] * u;
                    right[1][a] += weight * row[a] * v;
                }
            }
            match (solve(normal, right[0]), solve(normal, right[1])) {
                (Some(u), Some(v)) => fit = Self { u, v },
                _ => break, // all on one line: the median it is
            }
        }
        fit
    }
}

/// The solution of three equations by Cramer's rule; `None` if they are singular.
fn solve(m: [[f64; 3]; 3], b: [f64; 3]) -> Option<[f64; 3]> {
    let det = |m: &[[f64; 3]; 3]| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    };
    let whole = det(&m);
    let size = m[0][0] * m[1][1] * m[2][2];
    (whole.abs() > 1e-9 * size.abs()).then(|| {
        std::array::from_fn(|k| {
            let mut replaced = m;
            (0..3).for_each(|row| replaced[row][k] = b[row]);
            det(&replaced) / whole
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_greater_part_is_the_camera() {
        let truth = Affine { u: [2.0, 0.01, -0.02], v: [-1.0, 0.015, 0.005] };
        let (mut u, mut v) = (Map::over(320, 240, 2), Map::over(320, 240, 2));
        for k in 0..u.values().len() {
            let (i, j) = (k % 160, k / 160);
            let (x, y) = (2.0 * i as f64 + 0.5, 2.0 * j as f64 + 0.5);
            let (mut a, mut b) = truth.at(x, y);
            if i > 100 && j > 60 {
                (a, b) = (a + 6.0, b - 4.0); // a fifth of the frame goes its own way
            }
            (u.values_mut()[k], v.values_mut()[k]) = (a as f32, b as f32);
        }
        let fit = Affine::fit(&u, &v, &mut vec![]);
        for (x, y) in [(0.0, 0.0), (319.0, 0.0), (0.0, 239.0), (319.0, 239.0)] {
            let (a, b) = (fit.at(x, y), truth.at(x, y));
            assert!((a.0 - b.0).hypot(a.1 - b.1) < 0.1, "{a:?} is not {b:?}");
        }
        let thin = Affine::fit(&Map::over(1, 90, 1), &Map::over(1, 90, 1), &mut vec![]);
        assert_eq!(thin, Affine::default());
    }
}
