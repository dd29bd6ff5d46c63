//! Learning by stochastic maximum likelihood or contrastive divergence.
//!
//! The gradient of log p(v) is ⟨v hᵀ⟩ under the data minus ⟨v hᵀ⟩ under the model. The second is estimated by k steps of
//! Gibbs sampling, from the data (CD-k, Hinton 2002) or from chains that are never restarted (SML, or PCD: Younes 1989,
//! Tieleman 2008; as the authors do). Both phases are one matrix product, h of the second counted negatively.
//!
//! Every row of every batch has its own random stream, and products do not depend on how rows are grouped: the same
//! seed gives the same bits for any number of threads, and after any interruption (see [`Training`]).

use super::product::{add_outer, block_of};
use super::units::{add_rows, sample_binary, sample_visible};
use super::{Negative, Rbm, Recipe, Visible};
use crate::training::{EpochState, Part, Training, named};
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Epochs during which momentum is held at 0.5 or less (Hinton 2010, section 9).
const CAUTIOUS_EPOCHS: usize = 5;
/// Share of the past in the running mean of each hidden unit's activity.
const ACTIVITY_DECAY: f32 = 0.9;

/// As many numbers as a machine has: its velocity, or its mean over time.
#[derive(Clone, Debug, PartialEq)]
struct Parameters {
    weights: Vec<f32>,
    visible_bias: Vec<f32>,
    hidden_bias: Vec<f32>,
}

impl Parameters {
    fn zeros(n_v: usize, n_h: usize) -> Self {
        Self { weights: vec![0.0; n_v * n_h], visible_bias: vec![0.0; n_v], hidden_bias: vec![0.0; n_h] }
    }
    fn all_mut(&mut self) -> [&mut [f32]; 3] {
        [&mut self.weights, &mut self.visible_bias, &mut self.hidden_bias]
    }
}

/// A machine being trained: everything that the rest of the training depends on, the data apart.
#[derive(Debug)]
pub struct Trainer {
    recipe: Recipe,
    rbm: Rbm,
    velocity: Parameters,
    mean: Option<Parameters>,
    /// Hidden states of the persistent chains, chains × n_h.
    chains: Vec<f32>,
    /// Running mean of p(h = 1 | v) over the data, for the sparsity target.
    activity: Vec<f32>,
    state: EpochState,
    work: Work,
}

/// Scratch of a batch: the data's rows, then the model's.
#[derive(Debug, Default)]
struct Work {
    v: Vec<f32>,
    h: Vec<f32>,
    states: Vec<f32>,
    gradient_b: Vec<f32>,
    gradient_c: Vec<f32>,
}

/// Begins with small random weights, visible biases that fit the mean of the data, and hidden biases 0 (or the logit of the
/// sparsity target). Data that are not finite, or not in 0 to 1 for binary units, are refused.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = Rows<'a>;
    const CHECKPOINT: &'static str = "rbm-checkpoint";
    crate::training_fields!();

    fn new(recipe: Recipe, data: Rows<'_>) -> Result<Self> {
        recipe.check()?;
        let (n_v, n_h) = (data.width(), recipe.hidden);
        let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(0);
        let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
        let weights = (0..n_v * n_h).map(|_| recipe.initial_sd * normal()).collect();
        let mut mean = vec![0.0; n_v];
        data.iter().for_each(|row| mean.iter_mut().zip(row).for_each(|(m, &x)| *m += f64::from(x)));
        let bias = |m: f64| match recipe.visible {
            Visible::Bernoulli => logit((m / data.len() as f64).clamp(0.01, 0.99)),
            Visible::Gaussian => m / data.len() as f64,
        };
        let visible_bias = mean.into_iter().map(|m| bias(m) as f32).collect();
        let hidden_bias = vec![recipe.sparsity.map_or(0.0, |s| logit(f64::from(s.target)) as f32); n_h];
        check_data(recipe.visible, data)?;
        Self::from_rbm(recipe.clone(), Rbm::new(recipe.visible, weights, visible_bias, hidden_bias)?, data)
    }
    /// The last batch may be smaller.
    fn batches(&self, data: Rows<'_>) -> usize {
        data.len().div_ceil(self.recipe.batch)
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        const NAMES: [&str; 3] = ["weights", "visible_bias", "hidden_bias"];
        let mut all = vec![("chains".into(), &mut self.chains[..]), ("activity".into(), &mut self.activity)];
        all.extend(named("", NAMES, self.rbm.parameters_mut()));
        all.extend(named("velocity.", NAMES, self.velocity.all_mut()));
        all.extend(self.mean.iter_mut().flat_map(|mean| named("mean.", NAMES, mean.all_mut())));
        all
    }
    fn step(&mut self, data: Rows<'_>) {
        let (n_v, n_h) = self.rbm.shape();
        assert!(data.width() == n_v && !data.is_empty(), "training goes on with the data it began with");
        let (recipe, draws) = (self.recipe.clone(), self.state.draws(self.recipe.seed));
        let batch = self.state.batch;
        let (_, order) = self.state.rows(data.len(), recipe.batch, recipe.shuffle.then(|| draws.rng(0)));
        let rows = order.len();
        let (chains, steps) = match recipe.negative {
            Negative::Contrastive { steps } => (rows, steps),
            Negative::Persistent { chains, steps } => (chains, steps),
        };

        // Positive phase: the data, and the hidden units they excite.
        let Work { v, h, states, .. } = &mut self.work;
        v.resize((rows + chains) * n_v, 0.0);
        h.resize((rows + chains) * n_h, 0.0);
        let (v0, v1) = v.split_at_mut(rows * n_v);
        let (h0, h1) = h.split_at_mut(rows * n_h);
        let rbm = &self.rbm;
        let block = block_of(rows);
        (v0.par_chunks_mut(block * n_v), h0.par_chunks_mut(block * n_h), order.par_chunks(block))
            .into_par_iter()
            .for_each(|(v, h, order)| {
                v.chunks_exact_mut(n_v).zip(order).for_each(|(v, &i)| v.copy_from_slice(data.row(i as usize)));
                rbm.h_from_v(Rows::new(v, n_v), RowsMut::new(h, n_h));
            });

        // Negative phase: k steps of Gibbs sampling, each row (or chain) with streams of its own.
        let persistent = matches!(recipe.negative, Negative::Persistent { .. });
        let states = if persistent { &mut self.chains } else { states };
        states.resize(chains * n_h, 0.0);
        let stream = |row: usize, draw: usize| {
            let row = batch * recipe.batch.max(chains) + row;
            draws.rng(1 + (row * (2 * steps + 1) + draw) as u64)
        };
        let (block, h0) = (block_of(chains), &*h0);
        (v1.par_chunks_mut(block * n_v), h1.par_chunks_mut(block * n_h), states.par_chunks_mut(block * n_h))
            .into_par_iter()
            .enumerate()
            .for_each(|(b, (v, h, states))| {
                let row = |r| b * block + r;
                if !persistent {
                    for (r, s) in states.chunks_exact_mut(n_h).enumerate() {
                        sample_binary(&h0[row(r) * n_h..][..n_h], &mut stream(row(r), 0), s);
                    }
                }
                for step in 1..=steps {
                    rbm.v_from_h(Rows::new(states, n_h), RowsMut::new(v, n_v));
                    if persistent {
                        (v.chunks_exact_mut(n_v).enumerate())
                            .for_each(|(r, v)| sample_visible(recipe.visible, v, &mut stream(row(r), 2 * step - 1)));
                    }
                    rbm.h_from_v(Rows::new(v, n_v), RowsMut::new(h, n_h));
                    if persistent || step < steps {
                        for (r, (h, s)) in h.chunks_exact(n_h).zip(states.chunks_exact_mut(n_h)).enumerate() {
                            sample_binary(h, &mut stream(row(r), 2 * step), s);
                        }
                    }
                }
                let weight = -(rows as f32) / chains as f32;
                h.iter_mut().for_each(|h| *h *= weight);
            });

        let batches = self.batches(data);
        self.update(rows, chains, batches);
        self.state.done(batches);
    }
}

impl Trainer {
    /// Begins with a given machine; persistent chains begin at rows of the data.
    pub fn from_rbm(recipe: Recipe, rbm: Rbm, data: Rows<'_>) -> Result<Self> {
        recipe.check()?;
        check_data(recipe.visible, data)?;
        let (n_v, n_h) = rbm.shape();
        if (n_v, n_h, rbm.visible()) != (data.width(), recipe.hidden, recipe.visible) {
            return Err(Error::Invalid(format!(
                "a {n_v}-{n_h} RBM does not fit data {} wide and a recipe of {} hidden units",
                data.width(),
                recipe.hidden
            )));
        }
        let mut chains = Vec::new();
        if let Negative::Persistent { chains: n, .. } = recipe.negative {
            let mut h = vec![0.0; n_h];
            chains = vec![0.0; n * n_h];
            for (i, chain) in chains.chunks_exact_mut(n_h).enumerate() {
                let mut rng = Streams::new(recipe.seed, 0).at(0, Purpose::Train).rng(1 + i as u64);
                let row = data.row(rng.random_range(0..data.len()));
                rbm.h_from_v(Rows::new(row, n_v), RowsMut::new(&mut h, n_h));
                sample_binary(&h, &mut rng, chain);
            }
        }
        Ok(Self {
            velocity: Parameters::zeros(n_v, n_h),
            mean: recipe.average_from.map(|_| Parameters::zeros(n_v, n_h)),
            activity: vec![recipe.sparsity.map_or(0.0, |s| s.target); n_h],
            state: EpochState::new(recipe.epochs),
            recipe,
            rbm,
            chains,
            work: Work::default(),
        })
    }
    /// The current machine: the mean of the parameters if averaging has begun, otherwise the last ones.
    pub fn learned(&self) -> Rbm {
        match &self.mean {
            Some(mean) if self.mean_has_begun() => {
                let Parameters { weights, visible_bias, hidden_bias } = mean.clone();
                let mut rbm = self.rbm.clone();
                (rbm.weights, rbm.visible_bias, rbm.hidden_bias) = (weights, visible_bias, hidden_bias);
                rbm
            }
            _ => self.rbm.clone(),
        }
    }
    fn mean_has_begun(&self) -> bool {
        self.recipe.average_from.is_some_and(|from| self.progress() > (from, 0))
    }
    /// Moves the parameters by the statistics in `work`.
    fn update(&mut self, rows: usize, chains: usize, batches: usize) {
        let (n_v, n_h) = self.rbm.shape();
        let r = &self.recipe;
        let momentum = if self.state.epoch < CAUTIOUS_EPOCHS { r.momentum.min(0.5) } else { r.momentum };
        let rate = (1.0 - momentum) * r.rate;
        let (epoch, batch) = self.progress();
        let averaged = match r.average_from {
            Some(from) if epoch >= from => (epoch - from) * batches + batch + 1,
            _ => 0,
        };

        // Gradients of the biases: differences of means.
        let Work { v, h, gradient_b, gradient_c, .. } = &mut self.work;
        gradient_b.clear();
        gradient_b.resize(n_v, 0.0);
        add_rows(&v[rows * n_v..], gradient_b);
        gradient_b.iter_mut().for_each(|g| *g *= -(rows as f32) / chains as f32);
        add_rows(&v[..rows * n_v], gradient_b);
        gradient_b.iter_mut().for_each(|g| *g /= rows as f32);
        gradient_c.clear();
        gradient_c.resize(n_h, 0.0);
        add_rows(&h[..rows * n_h], gradient_c);
        if r.sparsity.is_some() {
            for (q, g) in self.activity.iter_mut().zip(&*gradient_c) {
                *q = ACTIVITY_DECAY * *q + (1.0 - ACTIVITY_DECAY) * g / rows as f32;
            }
        }
        add_rows(&h[rows * n_h..], gradient_c);
        gradient_c.iter_mut().for_each(|g| *g /= rows as f32);
        if let Some(s) = r.sparsity {
            gradient_c.iter_mut().zip(&self.activity).for_each(|(g, q)| *g += s.cost * (s.target - q));
        }

        // Biases, then weights in blocks of visible units; a mean of zero batches is not read.
        let towards = |mean: &mut [f32], now: &[f32]| {
            let share = 1.0 / averaged as f32;
            mean.iter_mut().zip(now).for_each(|(m, x)| *m += (x - *m) * share);
        };
        let mut none = (vec![], vec![], vec![]);
        let (mean_w, mean_b, mean_c) = match &mut self.mean {
            Some(m) if averaged > 0 => (&mut m.weights, &mut m.visible_bias, &mut m.hidden_bias),
            _ => (&mut none.0, &mut none.1, &mut none.2),
        };
        for (bias, velocity, gradient, mean) in [
            (&mut self.rbm.visible_bias, &mut self.velocity.visible_bias, &*gradient_b, mean_b),
            (&mut self.rbm.hidden_bias, &mut self.velocity.hidden_bias, &*gradient_c, mean_c),
        ] {
            for ((x, u), g) in bias.iter_mut().zip(velocity.iter_mut()).zip(gradient) {
                *u = momentum * *u + rate * g;
                *x += *u;
            }
            towards(mean, bias);
        }
        let (v, h) = (Rows::new(v, n_v), Rows::new(h, n_h));
        let plain = momentum == 0.0 && r.l1 == 0.0 && r.l2 == 0.0;
        let block = block_of(n_v);
        let blocks =
            self.rbm.weights.par_chunks_mut(block * n_h).zip(self.velocity.weights.par_chunks_mut(block * n_h));
        let update = |b: usize, w: &mut [f32], u: &mut [f32]| {
            if plain {
                add_outer(w, rate / rows as f32, v, b * block, h);
            } else {
                let (pull, push) = (rate * r.l2, rate * r.l1);
                u.iter_mut().zip(&*w).for_each(|(u, &w)| *u = momentum * *u - pull * w - push * sign(w));
                add_outer(u, rate / rows as f32, v, b * block, h);
                w.iter_mut().zip(&*u).for_each(|(w, u)| *w += u);
            }
        };
        if averaged > 0 {
            blocks.zip(mean_w.par_chunks_mut(block * n_h)).enumerate().for_each(|(b, ((w, u), mean))| {
                update(b, w, u);
                towards(mean, w);
            });
        } else {
            blocks.enumerate().for_each(|(b, (w, u))| update(b, w, u));
        }
    }
}

fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}

fn check_data(visible: Visible, data: Rows<'_>) -> Result<()> {
    let fits = |x: f32| match visible {
        Visible::Bernoulli => (0.0..=1.0).contains(&x),
        Visible::Gaussian => x.is_finite(),
    };
    if data.is_empty() {
        return Err(Error::Invalid("training needs at least one row of data".into()));
    }
    match data.data().iter().position(|&x| !fits(x)) {
        None => Ok(()),
        Some(i) => Err(Error::Invalid(format!(
            "row {}, value {} of the training data is {}: {}",
            i / data.width(),
            i % data.width(),
            data.data()[i],
            if visible == Visible::Bernoulli { "binary units need values from 0 to 1" } else { "it must be finite" }
        ))),
    }
}
