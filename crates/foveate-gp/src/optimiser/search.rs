//! The choice of the next point in the unit cube of `D` variables.

use super::climb::climb;
use super::cube::{Cube, moments};
use super::settings::Settings;
use crate::direct::{Direct, Form};
use crate::{Gp, Hyper, Kernel, Priors, Saved, StudentT};
use foveate_base::Result;
use foveate_base::rng::{Purpose, Streams};
use rand::RngExt;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// κ of the points, one after the other: wide, usual, near the largest mean.
const KAPPAS: [f64; 3] = [2.0, 1.0, 0.1];
/// Observed points at which climbs begin, beside DIRECT's.
const STARTS: usize = 3;
/// The most quasi-Newton steps of a fit.
const STEPS: usize = 30;
/// The hyper-parameters are fitted when there is a twenty-fifth more values: the cost of a fit grows with the cube of their number.
const REFIT: usize = 25;

#[derive(Debug)]
pub(super) struct Search<const D: usize> {
    warm_up: usize,
    evaluations: usize,
    streams: Streams,
    priors: Priors<D>,
    process: Gp<D>,
    direct: Direct<D>,
    /// The scaled values; and how many were seen since the last fit.
    values: Vec<f64>,
    unfitted: usize,
    means: Vec<f64>,
    variances: Vec<f64>,
}

/// The saved state beside points and values.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fitted {
    length_scales: Vec<f64>,
    signal_variance: f64,
    noise_variance: f64,
    unfitted: usize,
}

impl<const D: usize> Search<D> {
    pub(super) fn new(settings: Settings, seed: u64) -> Result<Self> {
        // Of the cube's side; values have variance 1. Smooth functions without noise are welcome, and so is noise alone.
        let length_scale = StudentT::new(4.0, 0.0, 1.0, (0.02, 5.0))?;
        Ok(Self {
            warm_up: settings.warm_up.unwrap_or(2 * D + 3),
            evaluations: settings.evaluations,
            streams: Streams::new(seed, 0),
            priors: Priors::new([length_scale; D], (0.05, 100.0), (1e-8, 1.0))?,
            process: Gp::new(Kernel::Matern52, first(), settings.window),
            direct: Direct::new(Form::LocallyBiased),
            values: vec![],
            unfitted: 0,
            means: vec![],
            variances: vec![],
        })
    }

    /// Point `t` of Latin hypercubes of `warm_up` points, one after the other.
    fn latin(&self, t: u64) -> [f64; D] {
        let n = self.warm_up;
        let (cube, row) = (t / n as u64, (t % n as u64) as usize);
        let mut rng = self.streams.at(cube, Purpose::Look).rng(0);
        std::array::from_fn(|_| {
            let mut cells: Vec<usize> = (0..n).collect();
            (1..n).rev().for_each(|i| cells.swap(i, rng.random_range(0..=i)));
            let within: Vec<f64> = (0..n).map(|_| rng.random()).collect();
            (cells[row] as f64 + within[row]) / n as f64
        })
    }

    /// The point with the largest bound that is found.
    fn propose(&mut self, kappa: f64) -> [f64; D] {
        let mut order: Vec<usize> = (0..self.values.len()).collect();
        order.sort_by(|&a, &b| self.values[b].total_cmp(&self.values[a]));
        let mut starts: Vec<[f64; D]> = order.iter().take(STARTS).map(|&i| self.process.points()[i]).collect();
        let Self { process, direct, means, variances, .. } = self;
        let mut bound = |points: &[[f64; D]], bounds: &mut [f64]| {
            means.resize(points.len(), 0.0);
            variances.resize(points.len(), 0.0);
            process.predict_many(points, means, variances);
            let beliefs = means.iter().zip(&*variances);
            bounds.iter_mut().zip(beliefs).for_each(|(bound, (m, v))| *bound = m + kappa * v.sqrt());
        };
        let mut best = direct.maximise_batches([0.0; D], [1.0; D], self.evaluations, &mut bound);
        starts.push(best.0);
        for start in starts {
            let found = climb(start, &mut bound);
            if found.1 > best.1 {
                best = found;
            }
        }
        best.0
    }

    /// Fits the hyper-parameters from their current and from their initial values, and keeps the better result.
    fn fit(&mut self) {
        let here = self.process.fit(&self.priors, STEPS);
        let kept = *self.process.hyper();
        self.process.set_hyper(first());
        if self.process.fit(&self.priors, STEPS).log_posterior < here.log_posterior {
            self.process.set_hyper(kept);
        }
        self.unfitted = 0;
    }

    fn scale(&mut self, values: &[f64]) {
        let (mean, unit) = moments(values);
        self.values.clear();
        self.values.extend(values.iter().map(|y| (y - mean) / unit));
    }
}

fn first<const D: usize>() -> Hyper<D> {
    Hyper { length_scales: [0.5; D], signal_variance: 1.0, noise_variance: 1e-4 }
}

fn array<const D: usize>(point: &[f64]) -> Option<[f64; D]> {
    point.try_into().ok()
}

impl<const D: usize> Cube for Search<D> {
    fn ask(&mut self, asked: u64, seen: u64) -> Vec<f64> {
        let warm = seen >= self.warm_up as u64;
        let point = if warm { self.propose(KAPPAS[(seen % KAPPAS.len() as u64) as usize]) } else { self.latin(asked) };
        point.to_vec()
    }
    fn tell(&mut self, point: &[f64], values: &[f64]) {
        self.process.push(array(point).expect("as many numbers as variables"), 0.0);
        self.scale(values);
        self.process.set_values(&self.values);
        self.unfitted += 1;
        if self.unfitted * REFIT >= values.len() && values.len() > D + 1 {
            self.fit();
        }
    }
    fn predict(&self, point: &[f64]) -> (f64, f64) {
        self.process.predict(&array(point).expect("as many numbers as variables"))
    }
    fn save(&self) -> Value {
        let Hyper { length_scales, signal_variance, noise_variance } = *self.process.hyper();
        let fitted =
            Fitted { length_scales: length_scales.to_vec(), signal_variance, noise_variance, unfitted: self.unfitted };
        serde_json::to_value(fitted).expect("numbers and names are JSON")
    }
    fn restore(&mut self, saved: &Value, points: &[Vec<f64>], values: &[f64]) -> Option<()> {
        let Fitted { length_scales, signal_variance, noise_variance, unfitted } = Fitted::deserialize(saved).ok()?;
        let hyper = Hyper { length_scales: array(&length_scales)?, signal_variance, noise_variance };
        let points: Vec<[f64; D]> = points.iter().map(|point| array(point)).collect::<Option<_>>()?;
        let (mean, unit) = moments(values);
        let values = values.iter().map(|y| (y - mean) / unit).collect();
        self.process.restore(&Saved { hyper, points, values }).ok()?;
        self.values.clear();
        self.values.extend_from_slice(self.process.values());
        self.unfitted = unfitted;
        Some(())
    }
}
