//! Learning by Lloyd's two steps: every patch takes its best filter, and every filter turns to the patches that took it.
//!
//! Given the filters, s and the choice of filter are the best there are; given those, the best filter of length 1 is Σ s x
//! brought to length 1. To the sum the filter itself is added (Coates & Ng 2012), so that no filter jumps; neither step
//! can raise the error. A filter that no patch takes becomes some patch, which cannot raise it either.

use super::{KMeans, MOST, normalise, whiten};
use crate::rbm::Whitening;
use crate::rbm::epoch_state::EpochState;
use crate::rbm::product::rows_times;
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Patches that one task sums: fixed, so that any number of threads gives the same bits.
const CHUNK: usize = 4096;
/// Rows of one product.
const TOGETHER: usize = 256;

/// How to learn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// K.
    pub filters: usize,
    /// Passes over all patches.
    pub epochs: usize,
    /// Share of the variance of normalised patches that whitening keeps, above 0, at most 1.
    pub keep: f64,
    /// What is added to a patch's variance before it is divided by its root.
    pub softening: f32,
    /// Names all random numbers.
    pub seed: u64,
}

impl Recipe {
    /// The usual settings, to be changed field by field.
    pub fn new(filters: usize) -> Self {
        Self { filters, epochs: 30, keep: 0.99, softening: 1.0, seed: 1 }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        let problem = if !(1..=MOST.1).contains(&self.filters) {
            format!("filters are 1 to {}, got {}", MOST.1, self.filters)
        } else if !(self.softening > 0.0 && self.softening.is_finite()) {
            format!("the softening is above 0, got {}", self.softening)
        } else if !(self.keep > 0.0 && self.keep <= 1.0) {
            format!("the share of variance to keep is above 0 and at most 1, got {}", self.keep)
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training: {problem}")))
    }
}

/// Filters being learned.
#[derive(Debug)]
pub struct Trainer {
    pub(super) recipe: Recipe,
    pub(super) model: KMeans,
    /// x of every patch.
    white: Vec<f32>,
    pub(super) state: EpochState,
    error: f64,
}

impl Trainer {
    /// Normalises and whitens the patches, and begins with some of them as filters.
    ///
    /// Fails if the recipe is out of range, a value is not finite, the patches do not vary, or there are fewer than filters.
    pub fn new(recipe: Recipe, patches: Rows<'_>) -> Result<Self> {
        recipe.check()?;
        if patches.len() < recipe.filters || patches.width() > MOST.0 {
            return Err(Error::Invalid(format!(
                "{} filters need as many patches, of at most {} values; got {} of {}",
                recipe.filters,
                MOST.0,
                patches.len(),
                patches.width()
            )));
        }
        let mut normal = patches.data().to_vec();
        normal.chunks_exact_mut(patches.width()).for_each(|patch| normalise(patch, recipe.softening));
        let whitening = Whitening::fit(Rows::new(&normal, patches.width()), recipe.keep)?;
        drop(normal);
        let white = whiten(&whitening, recipe.softening, patches);
        let (n_x, k) = (whitening.shape().1, recipe.filters);
        let mut filters = vec![0.0; n_x * k];
        let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(0);
        (0..k).for_each(|j| place(&mut filters, j, &some(&white, n_x, &mut rng)));
        let model = KMeans::new(whitening, filters, recipe.softening)?;
        Ok(Self { recipe, model, white, state: EpochState::default(), error: f64::INFINITY })
    }
    crate::training_accessors!();
    /// The model as it stands.
    pub fn learned(&self) -> &KMeans {
        &self.model
    }
    /// The mean of ‖x − s d‖² as the last epoch found it, before it moved the filters; infinite before the first.
    pub fn error(&self) -> f64 {
        self.error
    }
    /// The numbers x of every patch, n_x a row.
    pub fn white(&self) -> Rows<'_> {
        Rows::new(&self.white, self.model.shape().1)
    }
    /// One pass over all patches.
    pub fn step(&mut self) {
        let ((_, n_x, k), filters) = (self.model.shape(), &self.model.filters);
        let parts: Vec<(Vec<f64>, Vec<usize>, f64)> =
            self.white.par_chunks(CHUNK * n_x).map(|rows| turn(rows, n_x, filters)).collect();
        let (mut sums, mut counts, mut error) = (vec![0.0; n_x * k], vec![0; k], 0.0);
        for (part, taken, left) in &parts {
            sums.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            counts.iter_mut().zip(taken).for_each(|(c, t)| *c += t);
            error += left;
        }
        self.error = error / (self.white.len() / n_x) as f64;
        let mut rng = self.state.draws(self.recipe.seed).rng(0);
        self.state.done(1);
        for (j, count) in counts.iter().enumerate() {
            let turned: Vec<f64> = if *count == 0 {
                some(&self.white, n_x, &mut rng)
            } else {
                (0..n_x).map(|i| sums[i * k + j] + f64::from(self.model.filters[i * k + j])).collect()
            };
            place(&mut self.model.filters, j, &turned);
        }
    }
}

/// What some patches do to the filters (n_x × K): Σ s x of each, how many took it, and Σ ‖x − s d‖².
fn turn(rows: &[f32], n_x: usize, filters: &[f32]) -> (Vec<f64>, Vec<usize>, f64) {
    let k = filters.len() / n_x;
    let (mut sums, mut counts, mut left) = (vec![0.0; n_x * k], vec![0; k], 0.0);
    let mut scores = vec![0.0; TOGETHER * k];
    for rows in rows.chunks(TOGETHER * n_x) {
        let scores = &mut scores[..rows.len() / n_x * k];
        rows_times(Rows::new(rows, n_x), filters, scores);
        for (x, scores) in rows.chunks_exact(n_x).zip(scores.chunks_exact(k)) {
            let (mut best, mut most) = (0, f32::NEG_INFINITY);
            for (j, &score) in scores.iter().enumerate() {
                if score > most {
                    (best, most) = (j, score);
                }
            }
            let s = f64::from(most.max(0.0));
            counts[best] += usize::from(s > 0.0);
            for (i, &x) in x.iter().enumerate() {
                sums[i * k + best] += s * f64::from(x);
                left += f64::from(x).powi(2);
            }
            left -= s * s;
        }
    }
    (sums, counts, left)
}

/// Some patch that is not 0, or the first direction.
fn some(white: &[f32], n_x: usize, rng: &mut foveate_base::rng::Rng) -> Vec<f64> {
    for _ in 0..100 {
        let at = rng.random_range(0..white.len() / n_x);
        let x: Vec<f64> = white[at * n_x..][..n_x].iter().map(|x| f64::from(*x)).collect();
        if x.iter().map(|x| x * x).sum::<f64>() > 1e-6 {
            return x;
        }
    }
    (0..n_x).map(|i| f64::from(u8::from(i == 0))).collect()
}

/// Column j of the filters ← a direction, at length 1.
fn place(filters: &mut [f32], j: usize, direction: &[f64]) {
    let k = filters.len() / direction.len();
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    direction.iter().enumerate().for_each(|(i, x)| filters[i * k + j] = (x / length) as f32);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};

    /// Patches of 3 × 3 values: one of four patterns, times a contrast, plus a brightness and noise.
    fn patches(n: usize, noise: f32) -> Vec<f32> {
        let mut rng = Streams::new(11, 0).rng(0);
        (0..n)
            .flat_map(|_| {
                let (pattern, contrast): (usize, f32) = (rng.random_range(0..4), rng.random_range(0.5..2.0));
                let brightness: f32 = rng.random();
                let noisy: Vec<f32> = (0..9)
                    .map(|i| {
                        let on = [i % 3 == 0, i / 3 == 1, i % 4 == 0, i == 4][pattern];
                        let e: f32 = StandardNormal.sample(&mut rng);
                        brightness + contrast * (f32::from(u8::from(on)) + noise * e)
                    })
                    .collect();
                noisy
            })
            .collect()
    }

    fn trainer(data: &[f32], filters: usize, keep: f64) -> Trainer {
        let recipe = Recipe { softening: 1e-3, keep, ..Recipe::new(filters) };
        Trainer::new(recipe, Rows::new(data, 9)).expect("patches that vary")
    }

    #[test]
    fn the_error_never_rises_whatever_the_threads() {
        let data = patches(10_000, 0.5);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut trainer = trainer(&data, 30, 1.0);
                let errors: Vec<f64> = (0..25)
                    .map(|_| {
                        trainer.step();
                        trainer.error()
                    })
                    .collect();
                (errors, trainer.learned().clone())
            })
        };
        let (errors, model) = run(1);
        // Filters are rounded to f32: that is all by which it may rise.
        assert!(errors.windows(2).all(|e| e[1] <= e[0] * (1.0 + 1e-6)), "{errors:?}");
        assert!(errors[24] < 0.9 * errors[0], "{errors:?}");
        assert!((errors[24] / 8.0 - model.error(Rows::new(&data, 9))).abs() < 0.01, "whitened patches have length √8");
        assert_eq!(run(3), (errors, model));
    }

    #[test]
    fn normalised_whitened_patches_have_no_mean_and_covariance_one() {
        let data = patches(5000, 0.5);
        let trainer = trainer(&data, 4, 1.0);
        let white = trainer.white();
        // Without their mean nine values have eight directions.
        assert_eq!(trainer.learned().shape(), (9, 8, 4));
        for i in 0..8 {
            let mean = white.iter().map(|x| f64::from(x[i])).sum::<f64>() / 5000.0;
            assert!(mean.abs() < 1e-3, "{mean}");
            for j in 0..8 {
                let c = white.iter().map(|x| f64::from(x[i]) * f64::from(x[j])).sum::<f64>() / 5000.0;
                assert!((c - f64::from(u8::from(i == j))).abs() < 2e-3, "({i}, {j}): {c}");
            }
        }
    }

    #[test]
    fn four_patterns_are_found_as_four_filters() {
        let data = patches(4000, 0.02);
        // Filters begin as patches: a pattern has none of 40 once in 25,000 seeds.
        let mut trainer = trainer(&data, 40, 0.99);
        (0..30).for_each(|_| trainer.step());
        let (_, n_x, k) = trainer.learned().shape();
        let filters = trainer.learned().filters();
        let clean = patches(200, 0.0);
        let white = whiten(trainer.learned().whitening(), 1e-3, Rows::new(&clean, 9));
        for x in white.chunks_exact(n_x) {
            let length = x.iter().map(|x| x * x).sum::<f32>().sqrt();
            let best = (0..k).map(|j| (0..n_x).map(|i| x[i] * filters.row(i)[j]).sum::<f32>() / length);
            assert!(best.fold(0.0, f32::max) > 0.95, "a filter is along each pattern");
        }
    }

    #[test]
    fn bad_settings_are_refused() {
        let data = patches(20, 0.1);
        let why =
            |recipe: Recipe, data: &[f32]| Trainer::new(recipe, Rows::new(data, 9)).expect_err("refused").to_string();
        assert!(why(Recipe::new(21), &data).contains("21 filters need as many patches"));
        assert!(why(Recipe::new(0), &data).contains("filters are 1 to"));
        assert!(why(Recipe { softening: 0.0, ..Recipe::new(3) }, &data).contains("softening"));
        assert!(why(Recipe { keep: 1.5, ..Recipe::new(3) }, &data).contains("share of variance"));
        assert!(why(Recipe::new(3), &[0.5; 180]).contains("cannot be whitened"));
        assert!(why(Recipe::new(3), &[f32::NAN; 180]).contains("finite"));
    }
}
