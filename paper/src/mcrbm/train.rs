//! Training by stochastic maximum likelihood, with the model's statistics from hybrid Monte Carlo on the free energy.
//!
//! The gradient of log p(x) is −∂F/∂θ under the data plus ∂F/∂θ under the model. Both phases are one batch of matrix products, with the
//! model's rows negative. Every row has its own random stream: the same seed gives the same bits for any number of threads, and after any
//! interruption.

use super::energy::Scratch;
use super::hmc::{Step, Work as Chains, transition};
use super::{FactoredRbm, Negative, Parameters, Recipe, Sizes};
use foveate::learn::rbm::Whitening;
use foveate::learn::rbm::product::{add_outer, block_of};
use foveate::learn::rbm::units::add_rows;
use foveate::learn::training::{EpochState, Part, Training, named};
use foveate::rng::{Purpose, Streams};
use foveate::rows::Rows;
use foveate::{Error, Result};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Learning rates of the parameters relative to `rate` (the authors' code).
const C_RATE: f32 = 2.0;
const W_RATE: f32 = 0.2;
const MEAN_BIAS_RATE: f32 = 0.1;
const SLOW_RATE: f32 = 0.02;
/// Initial length of the columns of C. Deviation: 0.2 in the authors' code; from there it takes many epochs to grow, because the common
/// length takes up a twentieth of every step.
const FIRST_LENGTH: f32 = 1.0;
/// Initial values (the authors' code).
const WEIGHT_SD: f32 = 0.05;
const COVARIANCE_BIAS: f32 = 2.0;
const MEAN_BIAS: f32 = -2.0;
const FIRST_STEP: f32 = 0.01;
/// Decay of the running common length of the filters ("weird but important" in the authors' code).
const LENGTH_REMEMBERED: f32 = 0.95;

/// The state of a training run.
#[derive(Debug)]
pub(crate) struct Trainer {
    recipe: Recipe,
    whitening: Whitening,
    pub(super) parameters: Parameters,
    /// The model's rows, batch × n_x.
    pub(super) chains: Vec<f32>,
    step: Step,
    /// The common length of the columns of C.
    pub(super) length: f32,
    state: EpochState,
    /// The rows, whitened.
    data: Vec<f32>,
    work: Work,
}

#[derive(Debug, Default)]
struct Work {
    /// The data's rows, then the model's.
    x: Vec<f32>,
    blocks: Vec<Scratch>,
    whole: Scratch,
    chains: Chains<Scratch>,
    sums: Vec<f32>,
}

/// Begins by fitting the whitening to the rows (glimpses as the encoder conditions them), and drawing small filters.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = Rows<'a>;
    const CHECKPOINT: &'static str = "mcrbm-checkpoint";
    foveate::learn::training_fields!();

    fn new(recipe: Recipe, rows: Rows<'_>) -> Result<Self> {
        recipe.check()?;
        if rows.len() < recipe.batch {
            return Err(Error::Invalid(format!(
                "training needs a full batch of {} rows, got {}",
                recipe.batch,
                rows.len()
            )));
        }
        let whitening = Whitening::fit(rows, recipe.keep)?;
        let data = whiten(&whitening, rows);
        let (pooling, n_c) = recipe.first_pooling();
        let (n_x, n_f, n_m) = (whitening.shape().1, recipe.factors, recipe.means);
        let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(0);
        let mut normal = |n: usize, sd: f32| -> Vec<f32> {
            let draw = |_| -> f32 { StandardNormal.sample(&mut rng) };
            (0..n).map(draw).map(|z: f32| sd * z).collect()
        };
        let mut parameters = Parameters {
            filters: normal(n_x * n_f, 1.0),
            pooling,
            covariance_bias: vec![COVARIANCE_BIAS; n_c],
            weights: normal(n_x * n_m, WEIGHT_SD),
            mean_bias: vec![MEAN_BIAS; n_m],
            visible_bias: vec![0.0; n_x],
        };
        let chains = normal(recipe.batch * n_x, 1.0);
        let length = equalise(&mut parameters.filters, n_f, |_| FIRST_LENGTH);
        // Checks the shapes, and the length of a glimpse.
        FactoredRbm::new(whitening.clone(), parameters.clone())?;
        let step = Step { size: FIRST_STEP, rejection: recipe.rejection };
        let work = Work::default();
        let state = EpochState::new(recipe.epochs);
        Ok(Self { recipe, whitening, parameters, chains, step, length, state, data, work })
    }
    fn batches(&self, rows: Rows<'_>) -> usize {
        rows.len() / self.recipe.batch
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        let Step { size, rejection } = &mut self.step;
        let parts = self.parameters.parts_mut().into_iter().map(|(name, values)| (name.into(), &mut values[..]));
        let numbers = [size, rejection, &mut self.length].map(std::slice::from_mut);
        parts
            .chain([("chains".into(), &mut self.chains[..])])
            .chain(named("state.", ["step", "rejection", "length"], numbers))
            .collect()
    }
    fn step(&mut self, rows: Rows<'_>) {
        let (n, batch) = (self.whitening.shape().1, self.recipe.batch);
        let draws = self.state.draws(self.recipe.seed);
        let (first, picked) = self.state.rows(self.data.len() / n, batch, Some(draws.rng(0)));
        let Work { x, chains, .. } = &mut self.work;
        x.clear();
        let data = Rows::new(&self.data, n);
        picked.iter().for_each(|&i| x.extend_from_slice(data.row(i as usize)));
        if self.recipe.negative == Negative::Contrastive {
            self.chains.copy_from_slice(x);
        }
        let first = 1 + first as u64;
        let leapfrog = (self.recipe.leapfrog_steps, self.step.size);
        let rejected =
            transition(&self.parameters, &mut self.chains, n, leapfrog, |row| draws.rng(first + row as u64), chains);
        self.step.adapt(rejected as f32 / batch as f32, self.recipe.rejection);
        x.extend_from_slice(&self.chains);
        self.statistics();
        self.update();
        self.state.done(self.batches(rows));
    }
}

impl Trainer {
    /// Returns the current length of a leapfrog step, and the running rejection rate.
    pub(crate) fn leapfrog(&self) -> (f32, f32) {
        (self.step.size, self.step.rejection)
    }
    /// Returns the current machine.
    pub(crate) fn learned(&self) -> FactoredRbm {
        FactoredRbm { whitening: self.whitening.clone(), parameters: self.parameters.clone() }
    }
    /// Computes the parameter statistics of the rows in `work.x`, with the model's half negative.
    fn statistics(&mut self) {
        let (Sizes { white, factors, covariance, mean }, p) = (self.parameters.sizes(), &self.parameters);
        let Work { x, blocks, whole, .. } = &mut self.work;
        let rows = x.len() / white;
        let block = block_of(rows);
        blocks.resize_with(rows.div_ceil(block), Scratch::default);
        x.par_chunks(block * white)
            .zip(&mut *blocks)
            .for_each(|(x, scratch)| p.hidden(Rows::new(x, white), scratch, None, true));
        let half = self.recipe.batch;
        type Part = fn(&Scratch) -> &Vec<f32>;
        type PartMut = fn(&mut Scratch) -> &mut Vec<f32>;
        let parts: [(Part, PartMut, usize); 5] = [
            (|s| &s.hat, |s| &mut s.hat, 0),
            (|s| &s.u, |s| &mut s.u, 0),
            (|s| &s.pull, |s| &mut s.pull, factors),
            (|s| &s.covariance, |s| &mut s.covariance, covariance),
            (|s| &s.mean, |s| &mut s.mean, mean),
        ];
        for (from, to, negative) in parts {
            let to = to(whole);
            to.clear();
            blocks.iter().for_each(|b| to.extend_from_slice(from(b)));
            if negative > 0 {
                to[half * negative..].iter_mut().for_each(|x| *x = -*x);
            }
        }
    }
    /// Updates the parameters with the statistics in `work`.
    fn update(&mut self) {
        let Sizes { white, factors, covariance, mean } = self.parameters.sizes();
        let r = &self.recipe;
        let epoch = self.state.epoch as f32 + 1.0;
        let rate = r.rate / (epoch / r.anneal.max(1) as f32).max(1.0) / r.batch as f32;
        let (p, w) = (&mut self.parameters, &mut self.work);
        let s = &mut w.whole;

        let hat = Rows::new(&s.hat, white);
        outer(&mut p.filters, -C_RATE * rate, hat, Rows::new(&s.pull, factors));
        outer(&mut p.weights, W_RATE * rate, Rows::new(&w.x, white), Rows::new(&s.mean, mean));
        if r.learn_pooling.is_some_and(|from| self.state.epoch >= from) {
            s.u.iter_mut().for_each(|u| *u = 0.5 * *u * *u);
            outer(&mut p.pooling, -SLOW_RATE * rate, Rows::new(&s.u, factors), Rows::new(&s.covariance, covariance));
            whole_shares(&mut p.pooling, covariance);
        }
        if self.state.epoch >= r.settle {
            let batch = r.batch as f32;
            for (values, rate) in [(&mut p.filters, C_RATE * rate), (&mut p.weights, W_RATE * rate)] {
                let pull = r.l1 * rate * batch;
                values.iter_mut().for_each(|x| *x -= x.clamp(-pull, pull));
            }
        }
        let old = self.length;
        self.length =
            equalise(&mut p.filters, factors, |mean| LENGTH_REMEMBERED * old + (1.0 - LENGTH_REMEMBERED) * mean);
        let half = r.batch * white;
        w.x[half..].iter_mut().for_each(|x| *x = -*x);
        for (bias, rows, rate) in [
            (&mut p.covariance_bias, &s.covariance, SLOW_RATE * rate),
            (&mut p.mean_bias, &s.mean, MEAN_BIAS_RATE * rate),
            (&mut p.visible_bias, &w.x, SLOW_RATE * rate),
        ] {
            w.sums.clear();
            w.sums.resize(bias.len(), 0.0);
            add_rows(rows, &mut w.sums);
            bias.iter_mut().zip(&w.sums).for_each(|(b, s)| *b += rate * s);
        }
    }
}

/// Returns all rows whitened.
fn whiten(whitening: &Whitening, rows: Rows<'_>) -> Vec<f32> {
    const CHUNK: usize = 1024;
    let (n_v, n_x) = whitening.shape();
    let mut x = vec![0.0; rows.len() * n_x];
    x.par_chunks_mut(CHUNK * n_x).zip(rows.data().par_chunks(CHUNK * n_v)).for_each_init(
        Vec::new,
        |centred, (x, rows)| {
            centred.resize(rows.len(), 0.0);
            whitening.whiten(Rows::new(rows, n_v), &mut centred[..rows.len()], x);
        },
    );
    x
}

/// Computes `values` (k × n) += `factor` · `left`ᵀ `right`, in blocks of rows of `values` that threads share.
fn outer(values: &mut [f32], factor: f32, left: Rows<'_>, right: Rows<'_>) {
    let n = right.width();
    let block = block_of(left.width());
    (values.par_chunks_mut(block * n).enumerate()).for_each(|(b, v)| add_outer(v, factor, left, b * block, right));
}

/// Gives all columns of C the same length, computed by `choose` from their mean length, and returns that length.
fn equalise(filters: &mut [f32], n_f: usize, choose: impl Fn(f32) -> f32) -> f32 {
    let mut lengths = vec![0.0f32; n_f];
    for row in filters.chunks_exact(n_f) {
        lengths.iter_mut().zip(row).for_each(|(l, c)| *l += c * c);
    }
    lengths.iter_mut().for_each(|l| *l = l.sqrt());
    let length = choose(lengths.iter().sum::<f32>() / n_f as f32);
    // A column of zeros has no direction: it stays.
    lengths.iter_mut().for_each(|l| *l = if *l > 0.0 { length / *l } else { 1.0 });
    for row in filters.chunks_exact_mut(n_f) {
        row.iter_mut().zip(&lengths).for_each(|(c, gain)| *c *= gain);
    }
    length
}

/// Clips P at 0 and normalises each column to sum 1; a zero column stays 0.
fn whole_shares(pooling: &mut [f32], n_c: usize) {
    let mut sums = vec![0.0f32; n_c];
    for row in pooling.chunks_exact_mut(n_c) {
        for (p, sum) in row.iter_mut().zip(&mut sums) {
            *p = p.max(0.0);
            *sum += *p;
        }
    }
    for row in pooling.chunks_exact_mut(n_c) {
        row.iter_mut().zip(&sums).filter(|(_, sum)| **sum > 0.0).for_each(|(p, sum)| *p /= sum);
    }
}
