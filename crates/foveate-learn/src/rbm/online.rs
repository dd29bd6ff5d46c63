//! An RBM that keeps learning from a few rows at a time: the stochastic gradient, or a particle filter over its parameters.
//!
//! Section 7 of the paper leaves this as future work: "existing particle filtering and stochastic optimization algorithms could be used to
//! train the RBMs online". One particle takes a step of contrastive divergence along the rows. Several take it each along a sample
//! of the rows drawn with replacement, and move their biases by noise: the proposal. A particle's weight is how well it separates
//! the rows from others, by its free energy F:
//! ```text
//! wₜ = wₜ₋₁ · Πᵢ σ(F̄ − F(vᵢ)),   F̄ the mean of F over the others;
//! ```
//! The normaliser of p(v) itself cannot be computed. The particles are resampled if their weights are uneven. The result is their mean.

use super::product::rows_times;
use super::units::softplus;
use super::{Negative, Rbm, Recipe, Trainer};
use crate::training::Training;
use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Settings of the training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Number of particles, at least 1; 1 is the stochastic gradient alone.
    pub particles: usize,
    /// Step along the mean gradient of the rows.
    pub learning_rate: f32,
    /// Standard deviation of the noise on each hidden unit's bias in a step, for several particles.
    pub noise: f32,
}

/// One particle: a machine, and the logarithm of its weight.
#[derive(Clone, Debug, PartialEq)]
pub struct Particle {
    /// The machine.
    pub rbm: Rbm,
    /// Logarithm of its weight; those of all particles need not add up to 1.
    pub log_weight: f64,
}

/// Log evidence of a machine by which the rows have none: its numbers are beyond all bounds.
const NOTHING: f64 = -1e6;

/// An RBM that keeps learning.
#[derive(Clone, Debug)]
pub struct OnlineRbm {
    settings: Settings,
    streams: Streams,
    steps: u64,
    particles: Vec<Particle>,
}

impl OnlineRbm {
    /// Begins with this machine; `streams` name all random numbers.
    pub fn new(rbm: Rbm, settings: Settings, streams: Streams) -> Self {
        let particles = vec![Particle { rbm, log_weight: 0.0 }; settings.particles.max(1)];
        Self { settings, streams, steps: 0, particles }
    }

    /// Continues from stored particles, after so many steps. Fails if they are not as many, or not of the shape, of
    /// those it has, or a weight is not finite; then nothing has changed.
    pub fn resume(&mut self, steps: u64, particles: Vec<Particle>) -> Result<()> {
        let first = &self.particles[0].rbm;
        let fits = |p: &Particle| p.rbm.shape() == first.shape() && p.rbm.visible() == first.visible();
        if particles.len() != self.particles.len() || !particles.iter().all(|p| fits(p) && p.log_weight.is_finite()) {
            return Err(Error::Invalid(format!(
                "{} RBMs that were trained online are not {} of {:?} units with finite weights",
                particles.len(),
                self.particles.len(),
                first.shape()
            )));
        }
        (self.steps, self.particles) = (steps, particles);
        Ok(())
    }

    /// Steps done, and the particles.
    pub fn particles(&self) -> (u64, &[Particle]) {
        (self.steps, &self.particles)
    }

    /// One step: `rows` are to become more probable than `others`, which one particle does not read. Both are as wide as the
    /// machine, and finite. A particle whose numbers would not stay finite does not move.
    pub fn learn(&mut self, rows: Rows<'_>, others: Rows<'_>) {
        self.steps += 1;
        let (draws, Settings { learning_rate, noise, .. }) =
            (self.streams.at(self.steps, Purpose::Train), self.settings);
        let several = self.particles.len() > 1;
        let mut sampled = vec![];
        for (i, particle) in self.particles.iter_mut().enumerate() {
            let mut rng = draws.rng(i as u64);
            let data = if several { bootstrap(rows, &mut rng, &mut sampled) } else { rows };
            if let Some(mut moved) = step(&particle.rbm, data, learning_rate, rng.random()) {
                if several {
                    let mut normal = || -> f32 { StandardNormal.sample(&mut rng) };
                    moved.hidden_bias.iter_mut().for_each(|c| *c += noise * normal());
                }
                particle.rbm = moved;
            }
            if several {
                particle.log_weight += evidence(&particle.rbm, rows, others);
            }
        }
        if several {
            self.resample(draws.rng(u64::MAX).random());
        }
    }

    /// The mean of the particles.
    pub fn mean(&self) -> Rbm {
        let mut mean = self.particles[0].rbm.clone();
        if self.particles.len() > 1 {
            parameters(&mut mean).into_iter().for_each(|x| x.fill(0.0));
            for (particle, weight) in self.particles.iter().zip(self.weights()) {
                let Rbm { weights, visible_bias, hidden_bias, .. } = &particle.rbm;
                for (sum, values) in parameters(&mut mean).into_iter().zip([weights, visible_bias, hidden_bias]) {
                    sum.iter_mut().zip(values).for_each(|(sum, x)| *sum += weight as f32 * x);
                }
            }
        }
        mean
    }

    /// Normalised weights.
    fn weights(&self) -> Vec<f64> {
        let most = self.particles.iter().map(|p| p.log_weight).fold(f64::NEG_INFINITY, f64::max);
        let mut weights: Vec<f64> = self.particles.iter().map(|p| (p.log_weight - most).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        weights
    }

    /// Systematic resampling where the effective sample size is under half of the particles.
    fn resample(&mut self, start: f64) {
        let (weights, n) = (self.weights(), self.particles.len());
        let ess = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
        if ess >= 0.5 * n as f64 {
            return;
        }
        let (mut k, mut sum) = (0, weights[0]);
        let chosen = (0..n).map(|i| {
            while sum * (n as f64) < i as f64 + start && k + 1 < n {
                k += 1;
                sum += weights[k];
            }
            Particle { log_weight: 0.0, ..self.particles[k].clone() }
        });
        self.particles = chosen.collect();
    }
}

fn parameters(rbm: &mut Rbm) -> [&mut Vec<f32>; 3] {
    [&mut rbm.weights, &mut rbm.visible_bias, &mut rbm.hidden_bias]
}

/// As many rows, drawn with replacement.
fn bootstrap<'a>(rows: Rows<'_>, rng: &mut Rng, into: &'a mut Vec<f32>) -> Rows<'a> {
    into.clear();
    (0..rows.len()).for_each(|_| into.extend_from_slice(rows.row(rng.random_range(0..rows.len()))));
    Rows::new(into, rows.width())
}

/// A machine after one step of CD-1 along the rows; `None` if its numbers or the rows do not fit.
fn step(rbm: &Rbm, rows: Rows<'_>, rate: f32, seed: u64) -> Option<Rbm> {
    let recipe = Recipe {
        batch: rows.len(),
        shuffle: false,
        rate,
        momentum: 0.0,
        negative: Negative::Contrastive { steps: 1 },
        l2: 0.0,
        seed,
        ..Recipe::new(rbm.visible(), rbm.shape().1)
    };
    let mut trainer = Trainer::from_rbm(recipe, rbm.clone(), rows).ok()?;
    trainer.step(rows);
    trainer.check().ok()?;
    Some(trainer.learned())
}

/// Σ log σ(F̄ − F(v)) over the rows, F̄ the mean over the others; 0 where there are none, [`NOTHING`] where it is no number.
fn evidence(rbm: &Rbm, rows: Rows<'_>, others: Rows<'_>) -> f64 {
    if others.is_empty() {
        return 0.0;
    }
    let (mean, each) = (free_energies(rbm, others), free_energies(rbm, rows));
    let mean = mean.iter().sum::<f64>() / mean.len() as f64;
    let evidence: f64 = each.iter().map(|f| -softplus(f - mean)).sum();
    if evidence.is_finite() { evidence } else { NOTHING }
}

/// F(v) of every row, nats; as [`Rbm::free_energy`], by one product.
fn free_energies(rbm: &Rbm, rows: Rows<'_>) -> Vec<f64> {
    let (_, n_h) = rbm.shape();
    let mut z = vec![0.0; rows.len() * n_h];
    rows_times(rows, &rbm.weights, &mut z);
    let hidden = |z: &[f32]| -> f64 { z.iter().zip(&rbm.hidden_bias).map(|(z, c)| softplus(f64::from(z + c))).sum() };
    rows.iter().zip(z.chunks_exact(n_h)).map(|(v, z)| rbm.visible_energy(v) - hidden(z)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rbm::Visible;

    const N_V: usize = 12;

    fn machine(seed: u64) -> Rbm {
        let mut rng = Streams::new(seed, 0).rng(0);
        let mut values = |n: usize, sd: f32| (0..n).map(|_| sd * (rng.random::<f32>() - 0.5)).collect::<Vec<_>>();
        Rbm::new(Visible::Bernoulli, values(N_V * 8, 0.2), values(N_V, 0.2), values(8, 0.2)).expect("shapes that fit")
    }

    /// Rows whose first half is lit, or whose second half is; a tenth of the units are flipped.
    fn rows(first: bool, n: usize, rng: &mut Rng) -> Vec<f32> {
        let lit = |i: usize, flip: bool| f32::from(u8::from(((i % N_V < N_V / 2) == first) != flip));
        (0..n * N_V).map(|i| lit(i, rng.random::<f32>() < 0.1)).collect()
    }

    fn learned(particles: usize, seed: u64) -> OnlineRbm {
        let settings = Settings { particles, learning_rate: 0.05, noise: 0.02 };
        let mut it = OnlineRbm::new(machine(3), settings, Streams::new(seed, 0));
        let mut rng = Streams::new(5, 0).rng(1);
        for _ in 0..200 {
            let (target, around) = (rows(true, 9, &mut rng), rows(false, 8, &mut rng));
            it.learn(Rows::new(&target, N_V), Rows::new(&around, N_V));
        }
        it
    }

    /// The free energy of learned rows falls against that of other rows, with either method; bit for bit for one seed.
    #[test]
    fn it_learns_what_it_is_shown() {
        let (mut rng, frozen) = (Streams::new(6, 0).rng(1), machine(3));
        let (target, around) = (rows(true, 40, &mut rng), rows(false, 40, &mut rng));
        let margin = |rbm: &Rbm| -> f64 {
            let mean = |v: &[f32]| free_energies(rbm, Rows::new(v, N_V)).iter().sum::<f64>() / 40.0;
            mean(&around) - mean(&target)
        };
        for particles in [1, 6] {
            let it = learned(particles, 1);
            assert!(margin(&it.mean()) > margin(&frozen) + 3.0, "{particles}: {}", margin(&it.mean()));
            assert_eq!(it.mean(), learned(particles, 1).mean());
            assert_ne!(it.mean(), learned(particles, 2).mean());
        }
    }

    #[test]
    fn free_energies_are_those_of_the_machine() {
        let (rbm, v) = (machine(7), rows(true, 5, &mut Streams::new(1, 0).rng(0)));
        for (f, v) in free_energies(&rbm, Rows::new(&v, N_V)).iter().zip(v.chunks(N_V)) {
            assert!((f - rbm.free_energy(v)).abs() < 1e-5);
        }
    }

    /// One step of the gradient alone is one batch of a training with the same seed.
    #[test]
    fn a_step_is_contrastive_divergence() {
        let (rbm, v) = (machine(7), rows(true, 5, &mut Streams::new(1, 0).rng(0)));
        let data = Rows::new(&v, N_V);
        let mut it =
            OnlineRbm::new(rbm.clone(), Settings { particles: 1, learning_rate: 0.1, noise: 0.0 }, Streams::new(4, 0));
        it.learn(data, Rows::new(&[], N_V));
        let seed = Streams::new(4, 0).at(1, Purpose::Train).rng(0).random();
        assert_eq!(Some(it.mean()), step(&rbm, data, 0.1, seed));
        assert_ne!(it.mean(), rbm);
    }

    /// The best particle survives, and restored particles continue as the others do.
    #[test]
    fn particles_are_resampled_and_resumed() {
        let mut it = learned(6, 1);
        let (steps, kept) = it.particles();
        let (steps, kept) = (steps, kept.to_vec());
        let mut again = OnlineRbm::new(machine(3), it.settings, it.streams);
        again.resume(steps, kept.clone()).expect("as many, of the same shape");
        let v = rows(true, 9, &mut Streams::new(1, 0).rng(0));
        [&mut it, &mut again].into_iter().for_each(|it| it.learn(Rows::new(&v, N_V), Rows::new(&v, N_V)));
        assert_eq!(it.mean(), again.mean());
        assert!(again.resume(1, kept[1..].to_vec()).is_err());
        assert!(again.resume(1, vec![Particle { log_weight: f64::NAN, ..kept[0].clone() }; 6]).is_err());
        it.particles.iter_mut().enumerate().for_each(|(i, p)| p.log_weight = if i == 2 { 0.0 } else { -50.0 });
        let best = it.particles[2].rbm.clone();
        it.resample(0.3);
        assert!(it.particles.iter().all(|p| p.rbm == best && p.log_weight == 0.0));
    }

    /// A particle that cannot move is judged as all others are: one that explains nothing does not stay for that.
    #[test]
    fn what_cannot_move_is_weighed_too() {
        let mut it = learned(2, 1);
        let streams = Streams::new(1, 0);
        let (v, others) = (rows(true, 9, &mut streams.rng(0)), rows(false, 9, &mut streams.rng(1)));
        it.particles.iter_mut().for_each(|p| p.log_weight = 0.0);
        it.particles[1].rbm.weights[0] = f32::INFINITY;
        it.learn(Rows::new(&v, N_V), Rows::new(&others, N_V));
        let [good, stuck] = &it.particles[..] else { unreachable!("two particles") };
        assert!(good.log_weight > -100.0 && stuck.log_weight == NOTHING, "{} {}", good.log_weight, stuck.log_weight);
    }

    /// A rate that makes numbers overflow moves nothing.
    #[test]
    fn what_diverges_does_not_move() {
        let v = rows(true, 3, &mut Streams::new(1, 0).rng(0));
        let settings = Settings { particles: 1, learning_rate: f32::MAX, noise: 0.0 };
        let mut it = OnlineRbm::new(machine(3), settings, Streams::new(4, 0));
        (0..4).for_each(|_| it.learn(Rows::new(&v, N_V), Rows::new(&[], N_V)));
        let mean = it.mean();
        assert!(mean.weights.iter().chain(&mean.hidden_bias).all(|x| x.is_finite()));
    }
}
