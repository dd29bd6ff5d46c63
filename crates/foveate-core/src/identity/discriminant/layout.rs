//! One weight vector for several gazes: where the features of each are in it.

use std::collections::HashMap;

use crate::geometry::Gaze;

/// What a feature measures, and where: its quantity, and its place relative to the gaze, template units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub quantity: usize,
    pub u: f64,
    pub v: f64,
}

/// Places are the same if they differ by less than this.
const SAME: f64 = 1e-6;

/// The features of several gazes in one vector. Two gazes share a feature if it measures the same quantity at the same place of the
/// template; each has a 1 of its own.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    gazes: Vec<Gaze>,
    /// For each gaze the indices of its features, and of its 1.
    indices: Vec<Vec<usize>>,
    /// Lengths of the parts of the vector; the ones follow.
    parts: Vec<usize>,
    /// The weights of each gaze.
    weights: Vec<Vec<f32>>,
    committed: usize,
}

impl Layout {
    /// Of these gazes and the centre, with features of parts of these lengths at these places.
    pub(crate) fn new(gazes: &[Gaze], parts: &[usize], places: &[Place]) -> Self {
        assert_eq!(places.len(), parts.iter().sum::<usize>(), "one place for each feature");
        let mut gazes = gazes.to_vec();
        if find(&gazes, Gaze::CENTRE).is_none() {
            gazes.push(Gaze::CENTRE);
        }
        let (mut indices, mut lengths, mut n) = (vec![vec![]; gazes.len()], vec![], 0);
        let mut rest = places;
        for part in parts {
            let (places, others) = rest.split_at(*part);
            let (mut known, begun) = (HashMap::new(), n);
            for (gaze, indices) in gazes.iter().zip(&mut indices) {
                for Place { quantity, u, v } in places {
                    let at = [gaze.u + u, gaze.v + v].map(|place| (place / SAME).round() as i64);
                    indices.push(*known.entry((*quantity, at)).or_insert_with(|| {
                        n += 1;
                        n - 1
                    }));
                }
            }
            lengths.push(n - begun);
            rest = others;
        }
        for (k, indices) in indices.iter_mut().enumerate() {
            indices.push(n + k);
        }
        let weights = vec![vec![0.0; places.len() + 1]; gazes.len()];
        let mut it = Self { gazes, indices, parts: lengths, weights, committed: 0 };
        it.commit(Gaze::CENTRE);
        it
    }

    pub(crate) fn gazes(&self) -> &[Gaze] {
        &self.gazes
    }

    /// Lengths of the parts of the vector, without the ones.
    pub(super) fn parts(&self) -> &[usize] {
        &self.parts
    }

    /// Values of the vector.
    pub(crate) fn count(&self) -> usize {
        self.parts.iter().sum::<usize>() + self.gazes.len()
    }

    /// Values of a row of one gaze: its features and a 1.
    pub(super) fn width(&self) -> usize {
        self.indices[0].len()
    }

    /// The weight of a row, so that rows of all gazes (`all`), or in turn of each, count as one row of all features.
    pub(super) fn mass(&self, all: bool) -> f32 {
        let whole = self.parts.iter().sum::<usize>() as f32 / (self.width() - 1) as f32;
        if all { whole / self.gazes.len() as f32 } else { whole }
    }

    /// The number of the committed gaze.
    pub(super) fn committed(&self) -> usize {
        self.committed
    }

    /// Commits to a gaze. Returns false if it is none of its gazes.
    pub(super) fn commit(&mut self, gaze: Gaze) -> bool {
        let found = find(&self.gazes, gaze);
        self.committed = found.unwrap_or(self.committed);
        found.is_some()
    }

    /// The weights of a gaze relative to the committed one.
    pub(super) fn weights(&self, gaze: Gaze) -> Option<&[f32]> {
        let Gaze { u, v, .. } = self.gazes[self.committed];
        find(&self.gazes, Gaze { u: gaze.u + u, v: gaze.v + v, arm: None }).map(|k| &self.weights[k][..])
    }

    /// Takes the weights of each gaze from those of all features.
    pub(super) fn take(&mut self, all: &[f32]) {
        for (weights, indices) in self.weights.iter_mut().zip(&self.indices) {
            weights.iter_mut().zip(indices).for_each(|(weight, i)| *weight = all[*i]);
        }
    }

    /// Rows of the k-th gaze as rows of all features, in a buffer.
    pub(super) fn spread<'a>(&self, rows: &[f32], k: usize, whole: &'a mut Vec<f32>) -> &'a [f32] {
        let (width, n) = (self.width(), self.count());
        whole.clear();
        whole.resize(rows.len() / width * n, 0.0);
        for (row, whole) in rows.chunks_exact(width).zip(whole.chunks_exact_mut(n)) {
            row.iter().zip(&self.indices[k]).for_each(|(value, i)| whole[*i] = *value);
        }
        whole
    }
}

fn find(gazes: &[Gaze], gaze: Gaze) -> Option<usize> {
    gazes.iter().position(|it| (it.u - gaze.u).abs() < SAME && (it.v - gaze.v).abs() < SAME)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPACING: f64 = 0.5;

    fn gaze(u: f64, v: f64) -> Gaze {
        Gaze { u, v, arm: None }
    }

    /// Two quantities at four places each, and a third at one.
    fn places() -> Vec<Place> {
        let four = (0..4).map(|k| (f64::from(k % 2) - 0.5, f64::from(k / 2) - 0.5));
        let square = four.flat_map(|(u, v)| [0, 1].map(|quantity| Place { quantity, u: SPACING * u, v: SPACING * v }));
        square.chain([Place { quantity: 0, u: 0.0, v: 0.0 }]).collect()
    }

    /// Four gazes that are one place apart see nine places twice over, and four others; the centre is added.
    #[test]
    fn gazes_share_what_they_measure_at_one_place() {
        let corners = [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)].map(|(u, v)| gaze(u, v));
        let mut it = Layout::new(&corners, &[8, 1], &places());
        assert_eq!((it.parts(), it.count(), it.width(), it.gazes().len()), (&[18, 4][..], 26, 10, 4));
        assert_eq!(it.mass(false), 22.0 / 9.0);
        assert_eq!(it.mass(true), 22.0 / 9.0 / 4.0);
        // To the right is what the gaze to the right has on its left.
        let all: Vec<f32> = (0..26).map(|i| i as f32).collect();
        it.take(&all);
        let [centre, right] = [gaze(0.0, 0.0), gaze(0.5, 0.0)].map(|gaze| it.weights(gaze).expect("a gaze of it"));
        assert_eq!((&centre[2..4], &centre[6..8]), (&right[..2], &right[4..6]));
        assert!(centre[8] != right[8] && centre[9] != right[9]);
        assert!(it.weights(gaze(0.25, 0.0)).is_none());
        // Gazes are relative to the committed one.
        let right = right.to_vec();
        assert!(it.commit(gaze(0.5, 0.0)) && !it.commit(gaze(9.0, 0.0)));
        assert_eq!(it.weights(Gaze::CENTRE), Some(&right[..]));
        // A row and its weights have the same product before and after.
        let (row, mut whole) = ((1..=10).map(|i| i as f32).collect::<Vec<f32>>(), vec![]);
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let expected = product(&row, &right);
        assert_eq!(product(it.spread(&row, it.committed(), &mut whole), &all), expected);
        assert!(Layout::new(&[gaze(0.5, 0.5)], &[8, 1], &places()).gazes().contains(&Gaze::CENTRE));
    }
}
