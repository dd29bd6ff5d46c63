//! All pairs of boxes that overlap.

use crate::geometry::{BBox, sharing_columns};

/// Fraction of the smaller box that the overlap must exceed.
const MEETING: f64 = 0.1;

/// Returns whether two boxes overlap.
fn meet(a: &BBox, b: &BBox) -> bool {
    a.intersection(b) > MEETING * (a.w * a.h).min(b.w * b.h)
}

/// Maximum number of pairs in a frame. For 1,400 boxes on top of each other all pairs are found; beyond that, pairs further to the right
/// are left out, so that time and memory do not grow with the square of the number of boxes in a file.
const MOST: usize = 1 << 20;

/// Pairs of overlapping boxes, by index, in order.
#[derive(Default)]
pub(super) struct Meetings {
    order: Vec<u32>,
    pairs: Vec<(u32, u32)>,
    meets: Vec<bool>,
}

impl Meetings {
    /// Finds all pairs of these boxes.
    pub(super) fn find(&mut self, n: usize, at: &dyn Fn(usize) -> BBox) {
        let Self { order, pairs, meets } = self;
        pairs.clear();
        meets.clear();
        meets.resize(n, false);
        for (i, j) in sharing_columns(n, at, order).filter(|(i, j)| meet(&at(*i), &at(*j))).take(MOST) {
            pairs.push((i.min(j) as u32, i.max(j) as u32));
            (meets[i], meets[j]) = (true, true);
        }
        pairs.sort_unstable();
    }

    /// Returns the pairs, each with the smaller index first, in order.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        self.pairs.iter().map(|(i, j)| (*i as usize, *j as usize))
    }

    /// Returns whether a box overlaps another.
    pub(super) fn meets(&self, i: usize) -> bool {
        self.meets[i]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// 20 sets of 60 boxes, seed 1, against brute force.
    #[test]
    fn all_pairs_are_found() {
        let mut meetings = Meetings::default();
        for trial in 0..20 {
            let mut rng = Streams::new(1, 0).rng(trial);
            let mut draw = |most: f64| (rng.random::<f64>() * most).round();
            let boxes: Vec<BBox> = (0..60).map(|_| BBox::new(draw(90.0), draw(90.0), draw(30.0), draw(30.0))).collect();
            meetings.find(boxes.len(), &|i| boxes[i]);
            let all = (0..60).flat_map(|i| (i + 1..60).map(move |j| (i, j)));
            let tried: Vec<_> = all.filter(|(i, j)| meet(&boxes[*i], &boxes[*j])).collect();
            assert_eq!(meetings.pairs().collect::<Vec<_>>(), tried);
            assert!((0..60).all(|i| meetings.meets(i) == tried.iter().any(|(a, b)| *a == i || *b == i)));
        }
        meetings.find(2000, &|_| BBox::new(0.0, 0.0, 5.0, 5.0));
        assert_eq!(meetings.pairs().count(), MOST);
    }
}
