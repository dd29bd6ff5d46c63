//! Progress of a training by mini-batches, and the order of its rows.

use foveate_base::Error;
use foveate_base::rng::{Purpose, Rng, Streams};
use rand::RngExt;

/// The number of epochs, those that are done, and the order of the current one.
#[derive(Debug)]
pub struct EpochState {
    epochs: usize,
    /// Epochs that are done.
    pub epoch: usize,
    /// Batches of the current epoch that are done.
    pub batch: usize,
    order: Vec<u32>,
}

impl EpochState {
    /// The start of a training of so many epochs.
    pub fn new(epochs: usize) -> Self {
        Self { epochs, epoch: 0, batch: 0, order: vec![] }
    }
    /// The number of epochs.
    pub fn epochs(&self) -> usize {
        self.epochs
    }
    /// The random streams of the current epoch.
    pub fn draws(&self, seed: u64) -> Streams {
        Streams::new(seed, 0).at(1 + self.epoch as u64, Purpose::Train)
    }
    /// The place in the epoch of the batch's first row, and the batch: at most `size` of `n` rows, by their numbers. An epoch
    /// has a fresh permutation of them (Fisher & Yates), or, without a generator, their own order.
    pub fn rows(&mut self, n: usize, size: usize, shuffle: Option<Rng>) -> (usize, &[u32]) {
        if self.order.len() != n || self.batch == 0 {
            self.order.clear();
            self.order.extend(0..u32::try_from(n).expect("fewer than 2³² rows"));
            if let Some(mut rng) = shuffle {
                (1..n).rev().for_each(|i| self.order.swap(i, rng.random_range(0..=i)));
            }
        }
        let first = self.batch * size;
        (first, &self.order[first..(first + size).min(n)])
    }
    /// A batch is done, of so many that an epoch has.
    pub fn done(&mut self, batches: usize) {
        self.batch += 1;
        if self.batch == batches {
            (self.epoch, self.batch) = (self.epoch + 1, 0);
        }
    }
    /// The error of a diverged training.
    pub fn diverged(&self) -> Error {
        Error::Invalid(format!(
            "the training diverged in epoch {}: its numbers are no longer finite, or beyond 1e8; use a lower rate",
            self.epoch + 1
        ))
    }
}
