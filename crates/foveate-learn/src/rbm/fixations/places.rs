//! Where fixations may fall, and the code z of a place between them.

use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// The code z of a fixation: at most four places, each with its share; shares add up to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Code {
    places: [u16; 4],
    shares: [f32; 4],
}

impl Code {
    /// One-hot: place `index` alone.
    pub fn one_hot(index: usize) -> Self {
        let index = u16::try_from(index).expect("fewer places than 65,536");
        Self { places: [index; 4], shares: [1.0, 0.0, 0.0, 0.0] }
    }
    /// The places with a share, and their shares.
    pub fn parts(self) -> impl Iterator<Item = (usize, f32)> {
        self.places.into_iter().map(usize::from).zip(self.shares).filter(|p| p.1 != 0.0)
    }
    /// The place with the largest share.
    pub fn nearest(self) -> usize {
        let largest = (0..4).max_by(|&a, &b| self.shares[a].total_cmp(&self.shares[b])).expect("four shares");
        usize::from(self.places[largest])
    }
}

/// The places that have a code of their own: points (u, v) of the plane, in template units for a tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f32; 2]>", into = "Vec<[f32; 2]>")]
pub struct Places {
    at: Vec<[f32; 2]>,
    /// Distinct u, distinct v, and the place of each pair, if the places form a full lattice.
    lattice: Option<(Vec<f32>, Vec<f32>, Vec<u16>)>,
}

impl Places {
    /// Fails without a place, with more than 65,536, or with one that is not finite.
    pub fn new(at: Vec<[f32; 2]>) -> Result<Self> {
        if at.is_empty() || at.len() > 1 << 16 || at.iter().flatten().any(|x| !x.is_finite()) {
            let n = at.len();
            return Err(Error::Invalid(format!("fixations need 1 to 65536 places at finite points, got {n}")));
        }
        let distinct = |axis: usize| {
            let mut all: Vec<f32> = at.iter().map(|p| p[axis]).collect();
            all.sort_by(f32::total_cmp);
            all.dedup();
            all
        };
        let (us, vs) = (distinct(0), distinct(1));
        let lattice = (us.len() * vs.len() == at.len()).then(|| {
            let place = |u: f32, v: f32| at.iter().position(|p| *p == [u, v]).map(|i| i as u16);
            let pairs = us.iter().flat_map(|&u| vs.iter().map(move |&v| place(u, v)));
            pairs.collect::<Option<Vec<u16>>>()
        });
        let lattice = lattice.flatten().map(|index| (us, vs, index));
        Ok(Self { at, lattice })
    }
    /// `n` × `n` places over the square from −reach to reach, column by column.
    pub fn grid(n: usize, reach: f32) -> Result<Self> {
        let at = |i: usize| if n <= 1 { 0.0 } else { reach * (2.0 * i as f32 / (n - 1) as f32 - 1.0) };
        Self::new((0..n * n).map(|k| [at(k / n), at(k % n)]).collect())
    }
    /// How many there are.
    pub fn len(&self) -> usize {
        self.at.len()
    }
    /// Never: there is one at least.
    pub fn is_empty(&self) -> bool {
        false
    }
    /// The points.
    pub fn points(&self) -> &[[f32; 2]] {
        &self.at
    }
    /// The one-hot code of the place nearest to (u, v); of two equally near, the first.
    pub fn nearest(&self, u: f32, v: f32) -> Code {
        let far = |p: &[f32; 2]| (p[0] - u).powi(2) + (p[1] - v).powi(2);
        let near = (0..self.at.len()).min_by(|&a, &b| far(&self.at[a]).total_cmp(&far(&self.at[b])));
        Code::one_hot(near.expect("there is a place"))
    }
    /// The code of a point between places: bilinear shares of the four around it, after moving it into their square. Where
    /// places are no lattice, the nearest.
    pub fn code(&self, u: f32, v: f32) -> Code {
        let Some((us, vs, index)) = &self.lattice else { return self.nearest(u, v) };
        let ((i, p), (j, q)) = (between(us, u), between(vs, v));
        let (right, below) = ((i + 1).min(us.len() - 1), (j + 1).min(vs.len() - 1));
        Code {
            places: [(i, j), (i, below), (right, j), (right, below)].map(|(i, j)| index[i * vs.len() + j]),
            shares: [(1.0 - p) * (1.0 - q), (1.0 - p) * q, p * (1.0 - q), p * q],
        }
    }
}

/// The last of `sorted` that is not beyond x (clamped to its range), and how far x is on the way to the next, 0 to 1.
fn between(sorted: &[f32], x: f32) -> (usize, f32) {
    let i = sorted.partition_point(|&s| s <= x).saturating_sub(1).min(sorted.len().saturating_sub(2));
    match sorted.get(i + 1) {
        Some(next) => (i, ((x - sorted[i]) / (next - sorted[i])).clamp(0.0, 1.0)),
        None => (i, 0.0),
    }
}

impl TryFrom<Vec<[f32; 2]>> for Places {
    type Error = Error;
    fn try_from(at: Vec<[f32; 2]>) -> Result<Self> {
        Self::new(at)
    }
}

impl From<Places> for Vec<[f32; 2]> {
    fn from(places: Places) -> Self {
        places.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_one_hot_at_places_and_bilinear_between() {
        let grid = Places::grid(3, 0.5).expect("nine places");
        for (k, &[u, v]) in grid.points().iter().enumerate() {
            assert_eq!((grid.code(u, v).nearest(), grid.nearest(u, v)), (k, Code::one_hot(k)));
            assert_eq!(grid.code(u, v).parts().collect::<Vec<_>>(), [(k, 1.0)]);
        }
        // The shares' mean place is the point itself, inside; the nearest point of the square, outside.
        for (u, v) in [(0.1, -0.3), (-0.45, 0.2), (3.0, -0.1), (-7.0, 9.0)] {
            let (mut sum, mut mean) = (0.0, [0.0; 2]);
            for (k, share) in grid.code(u, v).parts() {
                sum += share;
                (0..2).for_each(|i| mean[i] += share * grid.points()[k][i]);
            }
            assert!((sum - 1.0).abs() < 1e-6);
            assert!((mean[0] - u.clamp(-0.5, 0.5)).abs() < 1e-6 && (mean[1] - v.clamp(-0.5, 0.5)).abs() < 1e-6);
        }
        let four = Places::new(vec![[1.0, 1.0], [1.0, 2.0], [2.0, 1.0], [0.0, 0.0]]).expect("four places");
        assert_eq!(four.code(1.9, 1.2), Code::one_hot(2), "no lattice");
        assert_eq!(Places::grid(1, 0.5).expect("the centre").code(0.3, -2.0).nearest(), 0);
        assert!(Places::new(vec![]).is_err() && Places::new(vec![[f32::NAN, 0.0]]).is_err());
    }
}
