//! Selection (Algorithm 1): children of heavy particles start the next frame.
//!
//! Every scheme is unbiased: particle i gets m·wᵢ of the m copies on average. They differ in the spread of counts:
//! those of systematic and residual resampling are less than 1 below m·wᵢ (Douc, Cappé & Moulines 2005).

use foveate_base::rng::Rng;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// How the places of the next frame are given out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Independent draws, the paper's "resample with replacement". It has the largest variance.
    Multinomial,
    /// One uniform draw in each of m equal strata.
    Stratified,
    /// One uniform draw shared by all strata (Kitagawa 1996), as in the authors' code.
    #[default]
    Systematic,
    /// ⌊m·w⌋ copies of each particle, the rest multinomial (Liu & Chen 1998).
    Residual,
}

foveate_base::settings! {
    /// When and how to resample.
    #[derive(Copy)]
    pub struct Resampling in "resampling" {
        /// Resampling scheme.
        pub scheme: Scheme = Scheme::Systematic,
        /// Resample if the effective sample size is below this share of the particles: 0 is never, 1 every frame.
        pub below: f64 = 1.0; 0.0 to 1.0,
    }
}

impl Resampling {
    /// Whether to resample a belief of `n` particles with this effective sample size.
    pub fn is_due(&self, ess: f64, n: usize) -> bool {
        self.below >= 1.0 || ess < self.below * n as f64
    }
    /// For each place in `ancestors`, the index of the particle that takes it; ascending.
    ///
    /// O(n + m) for n weights (of any positive sum) and m places, without allocation. A particle of weight 0
    /// is never selected. Panics if the weights are not finite or their sum is not positive.
    pub fn select(&self, weights: &[f64], ancestors: &mut [usize], rng: &mut Rng) {
        let total = sum(weights);
        assert!(total > 0.0 && total.is_finite(), "weights to select from need a positive sum, not {total}");
        match self.scheme {
            Scheme::Multinomial => descending(weights, total, ancestors, |_| 0, rng),
            Scheme::Residual => {
                let m = ancestors.len() as f64;
                // A whole number of places may be a rounding error short of it.
                descending(weights, total, ancestors, |w| (m * (w / total) + 1e-9) as usize, rng);
            }
            Scheme::Stratified => stratified(weights, total, ancestors, rng),
            Scheme::Systematic => systematic(weights, total, ancestors, rng),
        }
    }
}

/// One pass up the cumulative sum of the weights; place k lies at (k + u) / m of it, each with a u of its own.
fn stratified(weights: &[f64], total: f64, ancestors: &mut [usize], rng: &mut Rng) {
    let last = last_with_weight(weights);
    let step = total / ancestors.len() as f64;
    let (mut i, mut reached) = (0, weights[0]);
    for (k, ancestor) in ancestors.iter_mut().enumerate() {
        let position = (k as f64 + rng.random::<f64>()) * step;
        while reached <= position && i < last {
            i += 1;
            reached += weights[i];
        }
        *ancestor = i;
    }
}

fn last_with_weight(weights: &[f64]) -> usize {
    weights.iter().rposition(|&w| w > 0.0).expect("a positive sum has a positive term")
}

/// The same with one u for all places, and without a branch to mispredict.
///
/// Particle i begins at place m · (w₀ + … + wᵢ₋₁) + u, rounded. A place is taken by the last particle to begin there
/// or before; one without weight begins where the next one does.
fn systematic(weights: &[f64], total: f64, ancestors: &mut [usize], rng: &mut Rng) {
    /// Adding this to a number leaves it, rounded, in the low bits.
    const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
    let scale = ancestors.len() as f64 / total;
    let u = rng.random::<f64>() - 0.5;
    ancestors.fill(0);
    let mut begin = |i: usize, before: f64| {
        let place = (before * scale + u + ROUND).to_bits() - ROUND.to_bits();
        if let Some(ancestor) = ancestors.get_mut(place as usize) {
            *ancestor = i;
        }
    };
    let (rows, rest) = weights[..=last_with_weight(weights)].as_chunks::<4>();
    let mut before = 0.0;
    for (row, [a, b, c, d]) in rows.iter().enumerate() {
        begin(4 * row, before);
        begin(4 * row + 1, before + a);
        begin(4 * row + 2, before + (a + b));
        begin(4 * row + 3, before + (a + b + c));
        before += a + b + (c + d);
    }
    for (i, w) in rest.iter().enumerate() {
        begin(4 * rows.len() + i, before);
        before += w;
    }
    let mut last = 0;
    for ancestor in ancestors {
        last = last.max(*ancestor);
        *ancestor = last;
    }
}

/// Σ weights, four sums side by side.
fn sum(weights: &[f64]) -> f64 {
    let (rows, rest) = weights.as_chunks::<4>();
    let lanes = rows.iter().fold([0.0; 4], |sum, row| std::array::from_fn(|i| sum[i] + row[i]));
    lanes.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

/// `certain(w)` copies of each particle, the rest drawn independently from the remaining weights.
///
/// The largest of r uniform draws is u^(1/r); below it lie r − 1 uniform draws. So they come in descending
/// order, and one pass down the cumulative sum gives all places, from the last to the first.
fn descending(weights: &[f64], total: f64, ancestors: &mut [usize], certain: impl Fn(f64) -> usize, rng: &mut Rng) {
    let m = ancestors.len();
    let step = total / m as f64;
    let left = |w: f64| (w - certain(w) as f64 * step).max(0.0);
    let mut draws = m - weights.iter().map(|&w| certain(w)).sum::<usize>().min(m);
    let first = weights.iter().position(|&w| w > 0.0).expect("a positive sum has a positive term");
    let mut below: f64 = weights.iter().map(|&w| left(w)).sum();
    let mut next = |draws: usize, top: f64| top * rng.random::<f64>().powf(1.0 / draws as f64);
    let mut position = if draws > 0 { next(draws, below) } else { 0.0 };
    let mut places = ancestors.iter_mut().rev();
    for (i, &w) in weights.iter().enumerate().rev() {
        places.by_ref().take(certain(w)).for_each(|place| *place = i);
        below -= left(w);
        while draws > 0 && (position > below && left(w) > 0.0 || i == first) {
            if let Some(place) = places.next() {
                *place = i;
            }
            draws -= 1;
            position = next(draws.max(1), position);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use foveate_base::rng::{Purpose, Streams};

    const SCHEMES: [Scheme; 4] = [Scheme::Multinomial, Scheme::Stratified, Scheme::Systematic, Scheme::Residual];

    #[test]
    fn every_scheme_is_unbiased() {
        let geometric: Vec<f64> = (0..20).map(|i| 0.7f64.powi(i)).collect();
        for scheme in SCHEMES {
            let resampling = Resampling { scheme, below: 1.0 };
            conformance::resampling(&resampling, &[0.0, 0.3, 0.0, 0.55, 0.15, 0.0], 6);
            conformance::resampling(&resampling, &[0.0, 0.3, 0.0, 0.55, 0.15, 0.0], 11);
            conformance::resampling(&resampling, &geometric, 20);
            conformance::resampling(&resampling, &[1.0], 3);
            conformance::resampling(&resampling, &[0.25; 4], 4);
            conformance::resampling(&resampling, &[1e-300, 0.0, 1.0, 1e-300], 4);
        }
    }

    /// 1,000 sets of weights, seed 2: how far a count may stray from m·w, for certain.
    #[test]
    fn counts_stray_no_further_than_the_scheme_allows() {
        let mut rng = Streams::new(2, 0).at(0, Purpose::Select).rng(0);
        let n = 37;
        for _ in 0..1000 {
            let raw: Vec<f64> = (0..n).map(|_| rng.random::<f64>().powi(6)).collect();
            let total: f64 = raw.iter().sum();
            let weights: Vec<f64> = raw.iter().map(|w| w / total).collect();
            for (scheme, low, high) in
                [(Scheme::Systematic, 1.0, 1.0), (Scheme::Stratified, 2.0, 2.0), (Scheme::Residual, 1.0, n as f64)]
            {
                let mut ancestors = vec![0; n];
                Resampling { scheme, below: 1.0 }.select(&weights, &mut ancestors, &mut rng);
                for (i, w) in weights.iter().enumerate() {
                    let stray = ancestors.iter().filter(|&&a| a == i).count() as f64 - n as f64 * w;
                    assert!(-low - 1e-9 < stray && stray < high + 1e-9, "{scheme:?}: {stray}");
                }
            }
        }
    }

    #[test]
    fn equal_weights_keep_everyone() {
        let mut rng = Streams::new(3, 0).at(0, Purpose::Select).rng(0);
        for n in [1, 2, 3, 10, 100, 1000] {
            for scheme in [Scheme::Stratified, Scheme::Systematic, Scheme::Residual] {
                let mut ancestors = vec![0; n];
                Resampling { scheme, below: 1.0 }.select(&vec![1.0 / n as f64; n], &mut ancestors, &mut rng);
                let gaps = ancestors.iter().enumerate().filter(|&(i, &a)| i != a).count();
                assert!(gaps <= n / 100, "{scheme:?} of {n} equal weights moved {gaps}"); // rounding may move a few
            }
        }
    }

    #[test]
    fn due_below_the_threshold_only() {
        let at = |below| Resampling { scheme: Scheme::Systematic, below };
        assert!(at(1.0).is_due(100.0, 100) && at(1.0).is_due(100.0 + 1e-9, 100));
        assert!(at(0.5).is_due(49.9, 100) && !at(0.5).is_due(50.0, 100));
        assert!(!at(0.0).is_due(1.0, 100));
        assert!(at(1.5).check().is_err() && at(f64::NAN).check().is_err() && at(0.5).check().is_ok());
        let read: Resampling = toml::from_str("scheme = \"residual\"").expect("below has a default");
        assert_eq!(read, Resampling { scheme: Scheme::Residual, below: 1.0 });
    }
}
