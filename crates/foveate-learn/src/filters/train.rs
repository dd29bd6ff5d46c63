//! Learning filters: passes over all patches, each of which turns every filter.

use super::{MOST, PatchFilters, Sums, kmeans, normalised, place, whiten};
use crate::Stop;
use crate::rbm::Whitening;
use crate::training::{EpochState, Part, Training};
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result, memory};
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Patches that one task sums: fixed, so that any number of threads gives the same bits.
const CHUNK: usize = 4096;

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
    /// The term added to a patch's variance before the division by its root; `None` leaves patches unchanged.
    pub softening: Option<f32>,
    /// Names all random numbers.
    pub seed: u64,
}

impl Recipe {
    /// The usual settings, to be changed field by field.
    pub fn new(filters: usize) -> Self {
        Self { filters, epochs: 30, keep: 0.99, softening: Some(1.0), seed: 1 }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        let problem = if !(1..=MOST.1).contains(&self.filters) {
            format!("filters are 1 to {}, got {}", MOST.1, self.filters)
        } else if let Some(softening) = self.softening.filter(|s| !(*s > 0.0 && s.is_finite())) {
            format!("the softening is above 0, got {softening}")
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
    recipe: Recipe,
    model: PatchFilters,
    /// x of every patch.
    white: Vec<f32>,
    state: EpochState,
    cost: f64,
}

/// Normalises and whitens the patches, and begins with some of them as filters. A batch is an epoch: one pass over all patches.
/// Patches that do not vary, are not finite, or are fewer than the filters, are refused.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = Rows<'a>;
    const CHECKPOINT: &'static str = "filters-checkpoint";
    crate::training_fields!();

    fn new(recipe: Recipe, patches: Rows<'_>) -> Result<Self> {
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
        let whitening =
            Whitening::fit(Rows::new(&normalised(patches, recipe.softening), patches.width()), recipe.keep)?;
        let white = whiten(&whitening, recipe.softening, patches);
        let n_x = whitening.shape().1;
        let k = recipe.filters;
        // The sums of one task, times the tasks.
        let bytes = size_of::<f64>() * n_x * k * patches.len().div_ceil(CHUNK);
        memory::check(
            format_args!("learning {k} filters of {n_x} whitened numbers from {} rows", patches.len()),
            bytes as u64,
        )?;
        let mut filters = vec![0.0; n_x * k];
        let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(0);
        (0..k).for_each(|j| place(&mut filters, j, &some(&white, n_x, &mut rng)));
        let model = PatchFilters::new(whitening, filters, recipe.softening)?;
        Ok(Self { state: EpochState::new(recipe.epochs), recipe, model, white, cost: f64::INFINITY })
    }
    fn batches(&self, _: Rows<'_>) -> usize {
        1
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        vec![("filters".into(), &mut self.model.filters)]
    }
    fn step(&mut self, _: Rows<'_>) {
        self.step_until(&|| false).expect("nothing stops it");
    }
}

impl Trainer {
    /// The model as it stands.
    pub fn learned(&self) -> &PatchFilters {
        &self.model
    }
    /// The objective that the method minimises, the mean over patches divided by n_x, as the last epoch found it, before it turned the filters;
    /// infinite before the first.
    pub fn cost(&self) -> f64 {
        self.cost
    }
    /// The numbers x of every patch, n_x a row.
    pub fn white(&self) -> Rows<'_> {
        Rows::new(&self.white, self.model.shape().1)
    }
    /// One pass over all patches, unless `stop` returns true before it is done: it is called for every 256 patches or fewer, and for
    /// every filter that turns.
    ///
    /// # Errors
    /// [`Error::Stopped`] then; the trainer is unchanged.
    pub fn step_until(&mut self, stop: Stop<'_>) -> Result<()> {
        let n_x = self.model.shape().1;
        let mut filters = self.model.filters.clone();
        let chunks = self.white.par_chunks(CHUNK * n_x);
        let parts: Option<Vec<Sums>> = chunks.map(|rows| kmeans::sums(Rows::new(rows, n_x), &filters, stop)).collect();
        let sums = parts.ok_or(Error::Stopped)?.into_iter().reduce(Sums::with).expect("patches");
        let mut rng = self.state.draws(self.recipe.seed).rng(0);
        kmeans::turn(&sums, &mut filters, n_x, || some(&self.white, n_x, &mut rng));
        self.cost = sums.cost / self.white.len() as f64;
        self.model.filters = filters;
        self.state.done(1);
        Ok(())
    }
}

impl Sums {
    fn with(mut self, other: Self) -> Self {
        self.cost += other.cost;
        for (sums, more) in self.parts.iter_mut().zip(&other.parts) {
            sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
        self
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use std::sync::atomic::{AtomicUsize, Ordering};

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
        let recipe = Recipe { softening: Some(1e-3), keep, ..Recipe::new(filters) };
        Trainer::new(recipe, Rows::new(data, 9)).expect("patches that vary")
    }

    #[test]
    fn the_cost_never_rises_whatever_the_threads() {
        let data = patches(6000, 0.5);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut trainer = trainer(&data, 30, 1.0);
                let costs: Vec<f64> = (0..25)
                    .map(|_| {
                        trainer.step(Rows::new(&data, 9));
                        trainer.cost()
                    })
                    .collect();
                (costs, trainer.learned().clone())
            })
        };
        let (costs, model) = run(1);
        // Filters are rounded to f32: that is all by which it may rise.
        assert!(costs.windows(2).all(|c| c[1] <= c[0] * (1.0 + 1e-5)), "{costs:?}");
        assert!(costs[24] < 0.98 * costs[0], "{costs:?}");
        let now = model.cost(Rows::new(&data, 9));
        assert!((costs[24] / now - 1.0).abs() < 0.02, "{} and {now}", costs[24]);
        assert_eq!(run(3), (costs, model));
    }

    /// A stopped trainer is unchanged, and stops soon: it checks after at most 256 patches. It then continues to the same bits.
    #[test]
    fn a_pass_stops_within_256_patches_and_changes_nothing() {
        let data = patches(6000, 0.5);
        let (mut whole, mut cut) = (trainer(&data, 12, 1.0), trainer(&data, 12, 1.0));
        let asked = AtomicUsize::new(0);
        whole.step_until(&|| asked.fetch_add(1, Ordering::Relaxed) == usize::MAX).expect("not stopped");
        let all = asked.swap(0, Ordering::Relaxed);
        assert!(all >= 6000 / 256, "{all} questions");
        for n in [1, 2, all / 2, all - 1, all] {
            let before = (cut.learned().clone(), cut.progress());
            asked.store(0, Ordering::Relaxed);
            let stopped = cut.step_until(&|| asked.fetch_add(1, Ordering::Relaxed) + 1 >= n);
            assert!(matches!(stopped, Err(Error::Stopped)), "after {n} of {all}");
            assert!((cut.learned().clone(), cut.progress()) == before && cut.cost().is_infinite());
        }
        cut.step(Rows::new(&data, 9));
        assert_eq!((cut.learned(), cut.cost()), (whole.learned(), whole.cost()));
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
        (0..30).for_each(|_| trainer.step(Rows::new(&data, 9)));
        let (_, n_x, k) = trainer.learned().shape();
        let filters = trainer.learned().filters();
        let clean = patches(200, 0.0);
        let white = whiten(trainer.learned().whitening(), Some(1e-3), Rows::new(&clean, 9));
        for x in white.chunks_exact(n_x) {
            let length = x.iter().map(|x| x * x).sum::<f32>().sqrt();
            let best = (0..k).map(|j| (0..n_x).map(|i| x[i] * filters.row(i)[j]).sum::<f32>() / length);
            assert!(best.fold(0.0, f32::max) > 0.95, "a filter is along each pattern");
        }
    }

    #[test]
    fn codes_are_of_a_row_alone_and_rows_may_keep_their_means() {
        let data = patches(700, 0.5);
        let recipe = Recipe { softening: None, keep: 1.0, ..Recipe::new(12) };
        let mut trainer = Trainer::new(recipe, Rows::new(&data, 9)).expect("patches that vary");
        (0..3).for_each(|_| trainer.step(Rows::new(&data, 9)));
        let model = trainer.learned();
        let (_, n_x, k) = model.shape();
        assert_eq!(n_x, 9, "no direction is lost");
        let codes = model.codes(Rows::new(&data, 9));
        for row in [0, 255, 256, 699] {
            assert_eq!(model.codes(Rows::new(&data[9 * row..][..9], 9)), codes[k * row..][..k], "{row}");
        }
    }

    #[test]
    fn bad_settings_are_refused() {
        let data = patches(20, 0.1);
        let kmeans = Recipe::new;
        let why =
            |recipe: Recipe, data: &[f32]| Trainer::new(recipe, Rows::new(data, 9)).expect_err("refused").to_string();
        assert!(why(kmeans(21), &data).contains("21 filters need as many patches"));
        assert!(why(kmeans(0), &data).contains("filters are 1 to"));
        assert!(why(Recipe { softening: Some(0.0), ..kmeans(3) }, &data).contains("softening"));
        assert!(why(Recipe { keep: 1.5, ..kmeans(3) }, &data).contains("share of variance"));
        assert!(why(kmeans(3), &[0.5; 180]).contains("cannot be whitened"));
        assert!(why(kmeans(3), &[f32::NAN; 180]).contains("finite"));
    }
}
