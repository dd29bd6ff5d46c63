//! Trains a classifier of single glimpses by mini-batches; the pictures vary slightly in every epoch.
//!
//! Logistic regression (`softmax.rs`) on standardised features, by Adam with decoupled weight decay; the result is the running mean of the
//! parameters. The scales of features are those of the first epoch's rows and are merged into the weights. The same seed gives the same
//! bits, for any number of threads and after any interruption.

use crate::eval::Reliability;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use foveate_kernels as kernels;
use foveate_learn::rbm::product::{add_outer, rows_times};
use foveate_learn::softmax::{Softmax, normalize, temperature};
use foveate_learn::training::{EpochState, Part, Training, named};
use serde::{Deserialize, Serialize};

/// Update rate of the running mean of the parameters per batch.
const SHARE: f32 = 0.01;
/// Features with a smaller standard deviation than this fraction of the largest are not amplified.
const FLAT: f64 = 0.02;

/// Training settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// n_c.
    pub classes: usize,
    /// Passes over the pictures.
    pub epochs: usize,
    /// Size of a mini-batch; the last one of an epoch may be smaller.
    pub batch: usize,
    /// Learning rate.
    pub rate: f32,
    /// Weight decay per step.
    pub decay: f32,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Recipe {
    /// Returns the default settings, to be changed field by field.
    pub fn new(classes: usize) -> Self {
        Self { classes, epochs: 100, batch: 32, rate: 0.002, decay: 0.002, seed: 1 }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        let problem = if !(2..=256).contains(&self.classes) {
            "classes are 2 to 256"
        } else if self.batch == 0 || self.epochs == 0 {
            "epochs and pictures of a batch are at least 1"
        } else if !(self.rate > 0.0 && self.rate <= 1.0 && (0.0..1.0).contains(&self.decay)) {
            "the rate is above 0 and at most 1, the decay at least 0 and under 1"
        } else {
            return Ok(());
        };
        Err(Error::Config(format!("training: {problem}")))
    }
}

/// Names of the stored parameters, their mean, and Adam's two moments, each W (n_in × n_c), then b.
const NAMES: [&str; 4] = ["now", "mean", "first", "second"];

/// The state of a training run.
#[derive(Debug)]
pub struct Trainer {
    recipe: Recipe,
    /// Subtracted from the features …
    centre: Vec<f32>,
    /// … which are then multiplied by this.
    gain: Vec<f32>,
    parts: [Vec<f32>; 4],
    state: EpochState,
}

/// Begins with zero parameters. Data are the features and classes of an epoch's pictures.
impl Training for Trainer {
    type Recipe = Recipe;
    type Data<'a> = (Rows<'a>, &'a [u8]);
    const CHECKPOINT: &'static str = "classifier-checkpoint";
    foveate_learn::training_fields!();

    fn new(recipe: Recipe, (first, _): Self::Data<'_>) -> Result<Self> {
        recipe.check()?;
        if first.is_empty() || !first.data().iter().all(|x| x.is_finite()) {
            return Err(Error::Invalid("a classifier needs rows of finite features".into()));
        }
        let (n_in, n) = (first.width(), first.len() as f64);
        let (mut sums, mut squares) = (vec![0.0f64; n_in], vec![0.0f64; n_in]);
        for row in first.iter() {
            sums.iter_mut().zip(row).for_each(|(s, &x)| *s += f64::from(x) / n);
        }
        for row in first.iter() {
            squares.iter_mut().zip(row).zip(&sums).for_each(|((q, &x), m)| *q += (f64::from(x) - m).powi(2) / n);
        }
        let most = squares.iter().copied().fold(0.0, f64::max).sqrt().max(1e-6);
        let gain = squares.iter().map(|q| (1.0 / q.sqrt().max(FLAT * most)) as f32).collect();
        let zeros = || vec![0.0; (n_in + 1) * recipe.classes];
        Ok(Self {
            centre: sums.into_iter().map(|m| m as f32).collect(),
            gain,
            parts: [zeros(), zeros(), zeros(), zeros()],
            state: EpochState::new(recipe.epochs),
            recipe,
        })
    }
    fn batches(&self, (rows, _): Self::Data<'_>) -> usize {
        rows.len().div_ceil(self.recipe.batch)
    }
    fn parts(&mut self) -> Vec<Part<'_>> {
        named("", NAMES, self.parts.each_mut().map(|part| &mut part[..])).into()
    }
    fn step(&mut self, (rows, labels): Self::Data<'_>) {
        assert!(rows.len() == labels.len() && rows.width() == self.centre.len(), "the rows the training began with");
        let (n_in, n) = (rows.width(), self.recipe.classes);
        let order = self.state.draws(self.recipe.seed).rng(0);
        let before = self.state.epoch * self.batches((rows, labels)) + self.state.batch;
        let (_, picked) = self.state.rows(rows.len(), self.recipe.batch, Some(order));
        let scaled =
            |&i: &u32| rows.row(i as usize).iter().zip(&self.centre).zip(&self.gain).map(|((x, m), g)| (x - m) * g);
        let x: Vec<f32> = picked.iter().flat_map(scaled).collect();
        let x = Rows::new(&x, n_in);
        let [now, mean, moments @ ..] = &mut self.parts;
        let mut slopes = vec![0.0; picked.len() * n];
        rows_times(x, &now[..n_in * n], &mut slopes);
        let mut log_p = vec![0.0; n];
        for (slopes, &i) in slopes.chunks_exact_mut(n).zip(picked) {
            let scores = slopes.iter().zip(&now[n_in * n..]).map(|(s, b)| f64::from(s + b));
            log_p.iter_mut().zip(scores).for_each(|(q, s)| *q = s);
            normalize(&mut log_p);
            for (l, (slope, q)) in slopes.iter_mut().zip(&log_p).enumerate() {
                *slope = f32::from(u8::from(l == usize::from(labels[i as usize]))) - q.exp() as f32;
            }
        }
        let mut gradient = vec![0.0; now.len()];
        let (to_w, to_b) = gradient.split_at_mut(n_in * n);
        add_outer(to_w, 1.0, x, 0, Rows::new(&slopes, n));
        slopes.chunks_exact(n).for_each(|slopes| to_b.iter_mut().zip(slopes).for_each(|(b, s)| *b += s));
        let t = before as i32 + 1;
        let (b1, b2) = (0.9f32, 0.999f32);
        let adam = kernels::Adam {
            past: (b1, b2),
            scale: 1.0 / picked.len() as f32,
            step: self.recipe.rate / (1.0 - b1.powi(t)),
            widen: 1.0 / (1.0 - b2.powi(t)).sqrt(),
            least: 1e-6,
            pull: self.recipe.decay,
            // At the beginning the mean is over all steps.
            share: SHARE.max(1.0 / t as f32),
        };
        let [first, second] = moments;
        kernels::adam(adam, now, &gradient, [first, second], mean);
        self.state.done(self.batches((rows, labels)));
    }
}

impl Trainer {
    /// Returns the current classifier, for features that are not standardised.
    pub fn learned(&self) -> Result<Softmax> {
        let (n_in, n) = (self.centre.len(), self.recipe.classes);
        let (w, b) = self.parts[1].split_at(n_in * n);
        let mut bias = b.to_vec();
        let mut weights = w.to_vec();
        for ((row, m), g) in weights.chunks_exact_mut(n).zip(&self.centre).zip(&self.gain) {
            for (w, b) in row.iter_mut().zip(&mut bias) {
                *w *= g;
                *b -= m * *w;
            }
        }
        Softmax::new(weights, bias, 1.0)
    }
}

/// The results on held-out rows.
#[derive(Clone, Debug)]
pub struct Held {
    /// Accuracy, log loss and calibration error. The temperature of each half of the rows was fitted on the other half, so that no row is
    /// tested with a temperature fitted to it.
    pub reliability: Reliability,
    /// Confusion matrix: a row for each true class, a column for each decided one.
    pub confusion: Vec<Vec<usize>>,
}

/// Fits the temperature on rows of held-out pictures with these labels, each picture's once a pass. It is at least 1: a few pictures that
/// are all classified correctly would otherwise make the classifier overconfident.
pub fn calibrated(softmax: Softmax, rows: Rows<'_>, labels: &[u8]) -> Softmax {
    let mut log_p = vec![0.0; rows.len() * softmax.classes()];
    let softmax = softmax.at(1.0);
    softmax.log_probabilities(rows, &mut log_p);
    let labels: Vec<u8> = labels.iter().cycle().take(rows.len()).copied().collect();
    let t = temperature(&log_p, &labels, softmax.classes()).max(1.0);
    softmax.at(t)
}

/// Tests a classifier (at temperature 1) on rows of held-out pictures with these labels, each picture's once a pass. The temperature of
/// each half of the pictures is fitted on the other.
pub fn judge(softmax: &Softmax, rows: Rows<'_>, labels: &[u8]) -> Held {
    let n = softmax.classes();
    let mut log_p = vec![0.0; rows.len() * n];
    softmax.log_probabilities(rows, &mut log_p);
    let half = |odd: bool| -> (Vec<f64>, Vec<u8>) {
        let all = log_p.chunks_exact(n).zip(labels.iter().cycle());
        let own = all.enumerate().filter(|(i, _)| (i % labels.len() % 2 == 1) == odd);
        let (q, l): (Vec<&[f64]>, Vec<u8>) = own.map(|(_, (q, l))| (q, *l)).unzip();
        (q.concat(), l)
    };
    let (mut calibrated, mut order) = (vec![], vec![]);
    for odd in [false, true] {
        let ((mut own, own_labels), (other, other_labels)) = (half(odd), half(!odd));
        let t = if other_labels.is_empty() { 1.0 } else { temperature(&other, &other_labels, n).max(1.0) };
        for q in own.chunks_exact_mut(n) {
            q.iter_mut().for_each(|q| *q /= t);
            normalize(q);
        }
        calibrated.extend(own);
        order.extend(own_labels);
    }
    let mut confusion = vec![vec![0; n]; n];
    for (q, &label) in calibrated.chunks_exact(n).zip(&order) {
        confusion[usize::from(label)][foveate_core::identity::accumulate::likeliest(q)] += 1;
    }
    Held { reliability: Reliability::of(&calibrated, &order, n, 10), confusion }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand_distr::{Distribution, StandardNormal};

    /// Three classes around three points of ten dimensions.
    fn rows(n: usize, seed: u64) -> (Vec<f32>, Vec<u8>) {
        let mut rng = Streams::new(seed, 0).rng(0);
        let labels: Vec<u8> = (0..n).map(|i| (i % 3) as u8).collect();
        let value = |label: u8, j: usize, e: f32| if j == usize::from(label) { 2.0 + e } else { 0.1 * e };
        let rows = labels
            .iter()
            .flat_map(|&l| (0..10).map(move |j| (l, j)))
            .map(|(l, j)| value(l, j, StandardNormal.sample(&mut rng)));
        (rows.collect(), labels)
    }

    #[test]
    fn it_learns_and_goes_on_bit_for_bit() {
        let (x, y) = rows(100, 1);
        let data = (Rows::new(&x, 10), &y[..]);
        let recipe = Recipe { batch: 16, epochs: 20, rate: 0.02, ..Recipe::new(3) };
        let (dir, mut whole) =
            (tempfile::tempdir().expect("a folder"), Trainer::new(recipe.clone(), data).expect("rows"));
        let path = dir.path().join("c");
        while whole.progress().0 < 20 {
            if whole.progress() == (7, 3) {
                whole.save(&path, "these").expect("a writable folder");
            }
            whole.step(data);
        }
        assert_eq!(whole.batches(data), 7, "the last batch has four rows");
        let mut rest = Trainer::resume(&path, recipe.clone(), data, "these").expect("just written");
        while rest.progress().0 < 20 {
            rest.step(data);
        }
        assert_eq!(rest.learned().expect("finite"), whole.learned().expect("finite"));
        let other = Trainer::resume(&path, recipe, data, "those").expect_err("other data").to_string();
        assert!(other.contains("other data"), "{other}");

        // Classes 2 apart by one deviation: 200 new rows, seed 2; a correct classifier gets fewer than 190 right once in a million.
        let (x, y) = rows(200, 2);
        let held = judge(&whole.learned().expect("finite"), Rows::new(&x, 10), &y);
        assert!(held.reliability.accuracy > 0.95, "{:?}", held.reliability);
        let right: usize = (0..3).map(|c| held.confusion[c][c]).sum();
        assert_eq!(right as f64 / 200.0, held.reliability.accuracy);
        assert_eq!(held.confusion.iter().flatten().sum::<usize>(), 200);
        // All of a few are right: this must not increase the confidence.
        let few = calibrated(whole.learned().expect("finite"), Rows::new(&x[..30], 10), &y[..3]);
        assert_eq!(few.temperature(), 1.0);
        // An odd number of pictures, twice: each is in one half.
        let [once, twice] = [1, 2].map(|passes| {
            let rows = x[..90].repeat(passes);
            judge(&whole.learned().expect("finite"), Rows::new(&rows, 10), &y[..9]).reliability
        });
        assert!((once.log_loss - twice.log_loss).abs() < 1e-9, "{} {}", once.log_loss, twice.log_loss);
        // One row alone can be judged too.
        assert_eq!(judge(&whole.learned().expect("finite"), Rows::new(&x[..10], 10), &y[..1]).confusion[0][0], 1);
    }
}
