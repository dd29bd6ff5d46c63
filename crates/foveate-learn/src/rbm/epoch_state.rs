//! Progress of a training by mini-batches, and the order of its rows.

/// The progress of every trainer. It needs a `recipe` with `epochs` and an [`EpochState`] called `state`.
#[doc(hidden)]
#[macro_export]
macro_rules! training_accessors {
    () => {
        /// The recipe.
        pub fn recipe(&self) -> &Recipe {
            &self.recipe
        }
        /// Epochs done, and batches done of the next.
        pub fn progress(&self) -> (usize, usize) {
            self.state.progress()
        }
        /// Whether all epochs are done.
        pub fn is_done(&self) -> bool {
            self.state.epoch >= self.recipe.epochs
        }
    };
}

use foveate_base::Error;
use foveate_base::rng::{Purpose, Rng, Streams};
use rand::RngExt;

/// Epochs and batches that are done, and the order of the present epoch.
#[derive(Debug, Default)]
pub struct EpochState {
    /// Epochs that are done.
    pub epoch: usize,
    /// Of the present epoch.
    pub batch: usize,
    order: Vec<u32>,
}

impl EpochState {
    /// So many epochs, and batches of the next, are done.
    pub(super) fn at(epoch: usize, batch: usize) -> Self {
        Self { epoch, batch, order: vec![] }
    }
    /// Epochs done, and batches done of the next.
    pub fn progress(&self) -> (usize, usize) {
        (self.epoch, self.batch)
    }
    /// The random streams of the present epoch.
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
    pub fn diverged(&self, rate: f32) -> Error {
        let epoch = self.epoch + 1;
        Error::Invalid(format!(
            "the training diverged in epoch {epoch}: its numbers are no longer finite; use a lower rate than {rate}"
        ))
    }
}
