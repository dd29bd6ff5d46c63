//! Learning a multi-fixation RBM: mini-batches, Adam, the mean of the parameters.

use super::gradient::{Tally, Work, gradient};
use super::parameters::{NAMES, Offset, Parameters, Shape};
use super::{FixationRbm, Gates, Recipe, Sequences};
use crate::training::{EpochState, Part, Training, named};
use foveate_base::Result;
use foveate_base::rng::{Purpose, Streams};
use foveate_kernels::{self as kernels, Adam};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Adam's decay rates of the moments, and the constant in its divisor.
const PAST: (f32, f32) = (0.9, 0.999);
const LEAST: f32 = 1e-8;
/// Parameters a thread moves at a time.
const TOGETHER: usize = 1 << 14;
/// Streams that are not of a row: the order of an epoch, and orders of fixations.
const ORDERS: u64 = 1 << 62;

/// A machine being trained: everything that the rest of the training depends on, the data apart.
#[derive(Debug)]
pub struct Trainer {
    recipe: Recipe,
    shape: Shape,
    /// Here `gates` are the parameters of V.
    parameters: Parameters,
    offset: Offset,
    first: Parameters,
    second: Parameters,
    mean: Parameters,
    state: EpochState,
    gradient: Parameters,
    gates: Vec<f32>,
    work: Work,
    tally: Tally,
    tallied: usize,
}

/// Begins with random factors, and visible biases that fit the mean of the data.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = Sequences<'a>;
    const CHECKPOINT: &'static str = "fixations-checkpoint";
    /// The rate falls to 0 over all epochs.
    const EXTENDS: bool = false;
    crate::training_fields!();

    fn new(recipe: Recipe, data: Sequences<'_>) -> Result<Self> {
        recipe.check()?;
        let n_v = data.glimpses().width();
        data.check(n_v, recipe.places.len(), recipe.classes, recipe.window)?;
        let Recipe { hidden, factors, classes, seed, .. } = recipe;
        let shape = Shape { n_v, factors, hidden, places: recipe.places.len(), classes };
        let mut p = Parameters::zeros(shape);
        let mut rng = Streams::new(seed, 0).at(0, Purpose::Train).rng(0);
        let mut fill = |values: &mut [f32], mean: f32, sd: f32| {
            for x in values {
                let normal: f32 = StandardNormal.sample(&mut rng);
                *x = mean + sd * normal;
            }
        };
        fill(&mut p.filters, 0.0, (n_v as f32).powf(-0.5));
        match recipe.gates {
            Gates::Linear => fill(&mut p.gates, 1.0, 0.5),
            Gates::Logistic => fill(&mut p.gates, 0.0, 3.0),
        }
        fill(&mut p.pooling, 0.0, 0.5 * (factors as f32).powf(-0.5));
        fill(&mut p.labels, 0.0, 0.05);
        let mut mean = vec![0.0f64; n_v];
        data.glimpses().iter().for_each(|row| mean.iter_mut().zip(row).for_each(|(m, &x)| *m += f64::from(x)));
        let offset: Offset = mean.iter().map(|m| (m / data.glimpses().len() as f64) as f32).collect();
        for (b, &m) in p.visible_bias.iter_mut().zip(&offset) {
            let m = f64::from(m).clamp(0.01, 0.99);
            *b = (m / (1.0 - m)).ln() as f32;
        }
        let zeros = || Parameters::zeros(shape);
        Ok(Self {
            state: EpochState::new(recipe.epochs),
            recipe,
            shape,
            mean: p.clone(),
            parameters: p,
            offset,
            first: zeros(),
            second: zeros(),
            gradient: zeros(),
            gates: vec![],
            work: Work::default(),
            tally: Tally::default(),
            tallied: 0,
        })
    }
    /// The last batch may be smaller.
    fn batches(&self, data: Sequences<'_>) -> usize {
        data.len().div_ceil(self.recipe.batch)
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        let mut all = vec![("offset".into(), &mut self.offset[..])];
        let parts = [&mut self.parameters, &mut self.first, &mut self.second, &mut self.mean];
        for (prefix, part) in ["", "first.", "second.", "mean."].into_iter().zip(parts) {
            all.extend(named(prefix, NAMES, part.all_mut().map(|values| &mut values[..])));
        }
        all
    }
    fn step(&mut self, data: Sequences<'_>) {
        let (s, window) = (self.shape, self.recipe.window);
        data.check(s.n_v, s.places, s.classes, window).expect("training goes on with data like those it began with");
        let draws = self.state.draws(self.recipe.seed);
        let (from, batch) = self.state.rows(data.len(), self.recipe.batch, Some(draws.rng(ORDERS)));

        // Take the sequences' glimpses, their fixations in an order of their own.
        let work = &mut self.work;
        work.x.resize(2 * batch.len() * window * s.n_v, 0.0);
        let mut rows = work.x.chunks_exact_mut(s.n_v);
        work.codes.clear();
        work.labels.clear();
        for (r, &i) in batch.iter().enumerate() {
            let mut fixations: [u8; 256] = std::array::from_fn(|k| k as u8);
            let fixations = &mut fixations[..window];
            if self.recipe.reorder {
                let mut rng = draws.rng(ORDERS + 1 + (from + r) as u64);
                (1..window).rev().for_each(|k| fixations.swap(k, rng.random_range(0..=k)));
            }
            for &k in &*fixations {
                let row = i as usize * window + usize::from(k);
                let seen = rows.next().expect("a row for each fixation").iter_mut();
                seen.zip(data.glimpses().row(row)).zip(&self.offset).for_each(|((to, x), m)| *to = x - m);
                work.codes.push(data.codes()[row]);
            }
            work.labels.extend(data.labels().get(i as usize));
        }

        self.gates.clone_from(&self.parameters.gates);
        effective(self.recipe.gates, &mut self.gates);
        let rows = if self.recipe.sequential() { window } else { 1 };
        let first = (from * rows) as u64;
        let stream = |m: usize| draws.rng(1 + first + m as u64);
        let (machine, n) = ((s, &self.parameters, &*self.gates, &*self.offset), batch.len());
        let tally = gradient(machine, &self.recipe, &stream, &mut self.work, &mut self.gradient);
        self.tally.log_posterior += tally.log_posterior;
        self.tally.wrong += tally.wrong;
        self.tallied += n;
        if self.recipe.gates == Gates::Logistic {
            self.gradient.gates.iter_mut().zip(&self.gates).for_each(|(g, v)| *g *= v * (1.0 - v));
        }
        let batches = self.batches(data);
        self.update(n, batches);
        self.state.done(batches);
    }
}

impl Trainer {
    /// The mean of log p(y | x₁..K) in nats and the share of wrong most likely classes, over the sequences since the
    /// last call, each before its step. NaN if there were none.
    pub fn take_tally(&mut self) -> (f64, f64) {
        let (Tally { log_posterior, wrong }, n) = (self.tally, self.tallied as f64);
        (self.tally, self.tallied) = (Tally::default(), 0);
        (log_posterior / n, wrong as f64 / n)
    }
    /// The current machine: the mean of the parameters, or the last ones if no mean is kept. Fails if the training
    /// has diverged.
    pub fn learned(&self) -> Result<FixationRbm> {
        let mut parameters = if self.recipe.average > 0.0 { self.mean.clone() } else { self.parameters.clone() };
        effective(self.recipe.gates, &mut parameters.gates);
        FixationRbm::new(self.shape, parameters, self.offset.clone(), self.recipe.places.clone(), self.recipe.window)
            .map_err(|_| self.state.diverged())
    }
    /// Moves the parameters along the gradient, summed over n sequences.
    fn update(&mut self, n: usize, batches: usize) {
        let r = &self.recipe;
        let steps = self.state.epoch * batches + self.state.batch;
        let (t, done) = ((steps + 1) as f32, steps as f32 / (r.epochs * batches) as f32);
        let rate = r.rate * (1.0 - done).max(0.0);
        let (one, two) = (1.0 - PAST.0.powf(t), 1.0 - PAST.1.powf(t));
        // The mean decays: its memory is at most a fifth of the steps done.
        let share = 1.0 - r.average.min((1.0 + t) / (6.0 + t));
        let scale = 1.0 / n as f32;
        let (step, widen) = (rate / one, two.sqrt().recip());
        let parts = (self.parameters.all_mut().into_iter().zip(self.gradient.all()))
            .zip(self.first.all_mut().into_iter().zip(self.second.all_mut()))
            .zip(self.mean.all_mut());
        for (index, (((x, g), (u, q)), mean)) in parts.enumerate() {
            // F, P and U, the first, third and fourth.
            let pull = if [0, 2, 3].contains(&index) { rate * r.l2 } else { 0.0 };
            let parts = (
                x.par_chunks_mut(TOGETHER),
                g.par_chunks(TOGETHER),
                u.par_chunks_mut(TOGETHER),
                q.par_chunks_mut(TOGETHER),
                mean.par_chunks_mut(TOGETHER),
            );
            let adam = Adam { past: PAST, scale, step, widen, least: LEAST, pull, share };
            parts.into_par_iter().for_each(|(x, g, u, q, mean)| kernels::adam(adam, x, g, [u, q], mean));
        }
    }
}

/// V from the parameters.
pub(super) fn effective(gates: Gates, values: &mut [f32]) {
    if gates == Gates::Logistic {
        kernels::logistic(values);
    }
}
