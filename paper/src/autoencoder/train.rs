//! Training by stochastic gradient descent with momentum.
//!
//! With δ = v̂ − v and γ = δW ∘ h ∘ (1 − h): ∂/∂W = ṽᵀγ + δᵀh, ∂/∂b = δ, ∂/∂c = γ. Every row has its own random stream for its noise: the
//! same seed gives the same bits for any number of threads, and after any interruption.

use super::Autoencoder;
use foveate::learn::rbm::product::{add_outer, block_of, rows_times};
use foveate::learn::training::{EpochState, Part, Training, named};
use foveate::rng::{Purpose, Streams};
use foveate::rows::{Rows, RowsMut};
use foveate::{Error, Result};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Maximum number of hidden units, and of rows of a batch.
const MOST: usize = 1 << 16;

/// Training settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Recipe {
    /// n_h.
    pub hidden: usize,
    /// Passes over the data.
    pub epochs: usize,
    /// Rows in a mini-batch; rows that do not fill one wait for the next epoch.
    pub batch: usize,
    /// Learning rate for the mean gradient of a batch.
    pub rate: f32,
    /// 0 to 1 (exclusive): velocity = momentum · velocity + (1 − momentum) · rate · gradient.
    pub momentum: f32,
    /// Fraction of a row's values that noise sets to 0.
    pub mask: f32,
    /// Standard deviation of the noise added to the others.
    pub noise: f32,
    /// L2 weight decay.
    pub l2: f32,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Recipe {
    /// Returns settings for tests, to be changed field by field.
    #[cfg(test)]
    pub(crate) fn new(hidden: usize) -> Self {
        let (mask, noise) = (0.3, 0.5);
        Self { hidden, epochs: 30, batch: 100, rate: 0.5, momentum: 0.9, mask, noise, l2: 1e-3, seed: 1 }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |x: f32| x.is_finite() && x >= 0.0;
        let problem = if self.hidden == 0 || self.batch == 0 {
            "hidden units and rows of a batch must be at least 1"
        } else if self.hidden.max(self.batch) > MOST {
            "hidden units and rows of a batch must be at most 65536"
        } else if !(0.0..1.0).contains(&self.momentum) || !(0.0..1.0).contains(&self.mask) {
            "momentum and the masked share must be at least 0 and under 1"
        } else if ![self.rate, self.noise, self.l2].into_iter().all(positive) {
            "the rate, the noise and l2 must be finite and not negative"
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training: {problem}")))
    }
}

/// The state of a training run, without the data.
#[derive(Debug)]
pub(crate) struct Trainer {
    recipe: Recipe,
    model: Autoencoder,
    /// Velocities of W, then b, then c.
    velocity: Vec<f32>,
    state: EpochState,
    work: Work,
}

#[derive(Debug, Default)]
struct Work {
    noisy: Vec<f32>,
    h: Vec<f32>,
    delta: Vec<f32>,
    gamma: Vec<f32>,
    gradient: Vec<f32>,
}

/// Begins with small random weights and biases 0.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = Rows<'a>;
    const CHECKPOINT: &'static str = "autoencoder-checkpoint";
    foveate::learn::training_fields!();

    fn new(recipe: Recipe, rows: Rows<'_>) -> Result<Self> {
        recipe.check()?;
        if rows.len() < recipe.batch || !rows.data().iter().all(|x| x.is_finite()) {
            return Err(Error::Invalid(format!(
                "training needs finite values and a full batch of {} rows, got {}",
                recipe.batch,
                rows.len()
            )));
        }
        let (n_v, n_h) = (rows.width(), recipe.hidden);
        let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(0);
        // With this scale the initial hidden activations are near one half.
        let sd = 0.5 / (n_v as f32).sqrt();
        let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
        let weights = (0..n_v * n_h).map(|_| sd * normal()).collect();
        let model = Autoencoder::new(weights, vec![0.0; n_v], vec![0.0; n_h])?;
        let velocity = vec![0.0; n_v * n_h + n_v + n_h];
        Ok(Self { state: EpochState::new(recipe.epochs), recipe, model, velocity, work: Work::default() })
    }
    fn batches(&self, rows: Rows<'_>) -> usize {
        rows.len() / self.recipe.batch
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        let layer = self.model.layer.parameters_mut();
        let mut all = Vec::from(named("", ["weights", "visible_bias", "hidden_bias"], layer));
        all.push(("velocity".into(), &mut self.velocity));
        all
    }
    fn step(&mut self, rows: Rows<'_>) {
        let (n_v, r) = (rows.width(), &self.recipe);
        let draws = self.state.draws(r.seed);
        let (first, picked) = self.state.rows(rows.len(), r.batch, Some(draws.rng(0)));
        let clean: Vec<f32> = picked.iter().flat_map(|&i| rows.row(i as usize)).copied().collect();
        self.work.noisy.clear();
        for (i, row) in clean.chunks_exact(n_v).enumerate() {
            let mut rng = draws.rng(1 + (first + i) as u64);
            self.work.noisy.extend(row.iter().map(|x| {
                let (kept, noise): (f32, f32) = (rng.random(), StandardNormal.sample(&mut rng));
                if kept < r.mask { 0.0 } else { x + r.noise * noise }
            }));
        }
        self.gradient(Rows::new(&clean, n_v));
        self.descend();
        self.state.done(self.batches(rows));
    }
}

impl Trainer {
    /// Returns the current autoencoder.
    pub(crate) fn learned(&self) -> &Autoencoder {
        &self.model
    }
    /// Computes ∂/∂(W, b, c) of the mean of ½‖v̂ − v‖² over `clean` rows with corrupted versions `work.noisy`.
    fn gradient(&mut self, clean: Rows<'_>) {
        let layer = &self.model.layer;
        let ((n_v, n_h), m) = (layer.shape(), clean.len());
        let Work { noisy, h, delta, gamma, gradient, .. } = &mut self.work;
        h.resize(m * n_h, 0.0);
        gamma.resize(m * n_h, 0.0);
        delta.resize(m * n_v, 0.0);
        let block = block_of(m);
        let rows = noisy.par_chunks(block * n_v).zip(clean.data().par_chunks(block * n_v));
        let out = h.par_chunks_mut(block * n_h).zip(delta.par_chunks_mut(block * n_v));
        rows.zip(out).zip(gamma.par_chunks_mut(block * n_h)).for_each(|(((noisy, clean), (h, delta)), gamma)| {
            layer.h_from_v(Rows::new(noisy, n_v), RowsMut::new(h, n_h));
            layer.v_from_h(Rows::new(h, n_h), RowsMut::new(delta, n_v));
            delta.iter_mut().zip(clean).for_each(|(d, v)| *d -= v);
            rows_times(Rows::new(delta, n_v), layer.weights().data(), gamma);
            gamma.iter_mut().zip(&*h).for_each(|(g, h)| *g *= h * (1.0 - h));
        });
        gradient.clear();
        gradient.resize(n_v * n_h + n_v + n_h, 0.0);
        let (weights, biases) = gradient.split_at_mut(n_v * n_h);
        let (b, c) = biases.split_at_mut(n_v);
        let share = 1.0 / m as f32;
        let (noisy, delta, h, gamma) =
            (Rows::new(noisy, n_v), Rows::new(delta, n_v), Rows::new(h, n_h), Rows::new(gamma, n_h));
        let block = block_of(n_v);
        weights.par_chunks_mut(block * n_h).enumerate().for_each(|(i, w)| {
            add_outer(w, share, noisy, i * block, gamma);
            add_outer(w, share, delta, i * block, h);
        });
        for (sums, rows) in [(b, delta), (c, gamma)] {
            rows.iter().for_each(|row| sums.iter_mut().zip(row).for_each(|(s, x)| *s += share * x));
        }
    }
    /// Moves the parameters down the gradient.
    fn descend(&mut self) {
        let Recipe { rate, momentum, l2, .. } = self.recipe;
        let [weights, visible_bias, hidden_bias] = self.model.layer.parameters_mut();
        let pulled = self.work.gradient.iter_mut().zip(&*weights);
        pulled.for_each(|(g, w)| *g += l2 * w);
        let all = weights.iter_mut().chain(visible_bias).chain(hidden_bias);
        for ((x, u), g) in all.zip(&mut self.velocity).zip(&self.work.gradient) {
            *u = momentum * *u - (1.0 - momentum) * rate * g;
            *x += *u;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::learn::training::interrupted;

    fn rows(n: usize) -> Vec<f32> {
        let mut rng = Streams::new(4, 0).rng(0);
        (0..n)
            .flat_map(|_| {
                let a: f32 = StandardNormal.sample(&mut rng);
                let b: f32 = StandardNormal.sample(&mut rng);
                [a, -a, a + 0.1 * b, b, b, 0.5 * (a - b)]
            })
            .collect()
    }

    #[test]
    fn gradients_are_those_of_the_error() {
        let data = rows(3);
        let clean = Rows::new(&data, 6);
        let recipe = Recipe { batch: 3, ..Recipe::new(4) };
        let mut trainer = Trainer::new(recipe, clean).expect("good rows");
        let noisy: Vec<f32> = data.iter().map(|x| 0.7 * x + 0.1).collect();
        trainer.work.noisy.clone_from(&noisy);
        trainer.gradient(clean);
        let n = trainer.velocity.len();
        for e in 0..n {
            let at = |by: f32| {
                let mut layer = trainer.model.layer.clone();
                let [weights, visible_bias, hidden_bias] = layer.parameters_mut();
                let mut all = weights.iter_mut().chain(visible_bias).chain(hidden_bias);
                *all.nth(e).expect("a parameter") += by;
                let (mut h, mut back) = ([0.0; 12], [0.0; 18]);
                layer.h_from_v(Rows::new(&noisy, 6), RowsMut::new(&mut h, 4));
                layer.v_from_h(Rows::new(&h, 4), RowsMut::new(&mut back, 6));
                back.iter().zip(&data).map(|(a, b)| 0.5 * f64::from(a - b).powi(2)).sum::<f64>() / 3.0
            };
            let slope = (at(1e-2) - at(-1e-2)) / 2e-2;
            let got = f64::from(trainer.work.gradient[e]);
            assert!((slope - got).abs() < 1e-3 * (1.0 + got.abs()), "parameter {e}: {got} is not {slope}");
        }
    }

    #[test]
    fn it_learns_and_a_resumed_training_ends_with_the_same_bits() {
        let data = rows(400);
        let all = Rows::new(&data, 6);
        let recipe = Recipe { batch: 20, epochs: 15, rate: 0.2, mask: 0.25, noise: 0.3, l2: 1e-4, ..Recipe::new(8) };
        let mut whole = Trainer::new(recipe.clone(), all).expect("good rows");
        let before = whole.learned().error(all);
        while !whole.is_done() {
            whole.step(all);
        }
        let after = whole.learned().error(all);
        assert!(after < 0.3 * before, "the error went from {before} to {after}");
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("c.checkpoint");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
        let cut: Trainer = pool.install(|| interrupted(&recipe, all, 37, &path)).expect("good rows");
        assert_eq!((cut.learned(), cut.progress()), (whole.learned(), (15, 0)));
        assert!(Trainer::resume(&path, recipe.clone(), all, "def").is_err());
        assert!(Trainer::resume(&path, Recipe { mask: 0.1, ..recipe }, all, "abc").is_err());
        let model = dir.path().join("m.safetensors");
        whole.learned().save(&model, &Default::default()).expect("a writable folder");
        let mut bytes = std::fs::read(&model).expect("just written");
        assert_eq!(&Autoencoder::from_bytes(&bytes, &model).expect("just written").0, whole.learned());
        *bytes.last_mut().expect("not empty") ^= 1;
        assert!(Autoencoder::from_bytes(&bytes, &model).is_err());
        assert!(foveate::learn::rbm::Rbm::load(&model).expect_err("another kind").to_string().contains("autoencoder"));
    }

    #[test]
    fn wrong_recipes_are_refused() {
        let data = rows(30);
        let good = Recipe { batch: 10, ..Recipe::new(4) };
        for wrong in [
            Recipe { hidden: 0, ..good.clone() },
            Recipe { hidden: usize::MAX, ..good.clone() },
            Recipe { batch: 31, ..good.clone() },
            Recipe { mask: 1.0, ..good.clone() },
            Recipe { rate: f32::NAN, ..good.clone() },
        ] {
            assert!(Trainer::new(wrong.clone(), Rows::new(&data, 6)).is_err(), "{wrong:?}");
        }
    }
}
