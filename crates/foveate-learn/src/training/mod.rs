//! Training by epochs of mini-batches: what all trainers have in common, and how one continues after an interruption.
//!
//! Random numbers have names (epoch, row, step), so a generator has no state to keep; a training that is resumed ends
//! with the same bits as one that was never interrupted.

mod epochs;

pub use self::epochs::EpochState;

use crate::rbm::io::{Tensor, pack, read, unpack};
use crate::rbm::number::is_usable;
use foveate_base::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Numbers of a trainer under their name in a checkpoint.
pub type Part<'a> = (String, &'a mut [f32]);

/// Parts of the same names, with a prefix.
pub fn named<'a, const N: usize>(prefix: &str, names: [&str; N], parts: [&'a mut [f32]; N]) -> [Part<'a>; N] {
    let mut parts = parts.into_iter();
    names.map(|name| (format!("{prefix}{name}"), parts.next().expect("a part for every name")))
}

/// A model in training. The same seed gives the same bits for any number of threads.
pub trait Training: Sized {
    /// The settings. Its field `epochs` is the number of passes over the data.
    type Recipe: Clone + Serialize;
    /// The data of an epoch: of the same size in every epoch.
    type Data<'a>: Copy;
    /// The kind of the checkpoint's file.
    const CHECKPOINT: &'static str;
    /// Whether a longer training begins as a shorter one does, so that it may continue from the shorter one's checkpoint.
    const EXTENDS: bool = true;

    /// Begins a training with the data of the first epoch.
    ///
    /// # Errors
    /// The recipe is out of range, or the data do not fit it.
    fn new(recipe: Self::Recipe, data: Self::Data<'_>) -> Result<Self>;
    /// The number of batches in an epoch of these data.
    fn batches(&self, data: Self::Data<'_>) -> usize;
    /// Trains on one mini-batch. Panics if the data do not fit those of the first epoch.
    fn step(&mut self, data: Self::Data<'_>);
    /// The recipe.
    fn recipe(&self) -> &Self::Recipe;
    /// The progress.
    fn state(&self) -> &EpochState;
    /// The progress, to be set.
    fn state_mut(&mut self) -> &mut EpochState;
    /// All numbers that the rest of the training depends on, apart from the data and the progress.
    fn parts(&mut self) -> Vec<Part<'_>>;

    /// Epochs done, and batches done of the next.
    fn progress(&self) -> (usize, usize) {
        (self.state().epoch, self.state().batch)
    }
    /// Whether all epochs are done.
    fn is_done(&self) -> bool {
        self.state().epoch >= self.state().epochs()
    }
    /// Trains to the end of the current epoch.
    fn epoch(&mut self, data: Self::Data<'_>) {
        let epoch = self.state().epoch;
        while self.state().epoch == epoch {
            self.step(data);
        }
    }
    /// Fails if a number is not finite, or so large that the file would not be read: the training has diverged.
    fn check(&mut self) -> Result<()> {
        let finite = self.parts().iter().all(|(_, values)| values.iter().all(|x| is_usable(*x)));
        if finite { Ok(()) } else { Err(self.state().diverged()) }
    }
    /// Writes a checkpoint; the file is whole or unchanged. `data` identifies the data of all epochs.
    ///
    /// # Errors
    /// The training has diverged, or the file cannot be written.
    fn save(&mut self, path: &Path, data: &str) -> Result<()> {
        self.check()?;
        let (epoch, batch) = self.progress();
        let about = Progress { recipe: settings::<Self>(self.recipe()), data: data.into(), epoch, batch };
        let parts = self.parts();
        let tensors: Vec<Tensor<'_>> =
            parts.iter().map(|(name, values)| (&**name, vec![values.len()], &**values)).collect();
        files::write(path, &pack(Self::CHECKPOINT, about, &tensors))
    }
    /// Continues from a checkpoint. `first` are the data of the first epoch, and `data` identifies the data of all epochs.
    ///
    /// # Errors
    /// The checkpoint is of another recipe (the number of epochs apart, see [`Training::EXTENDS`]) or of other data, has
    /// done more epochs than are asked for, or is damaged.
    fn resume(path: &Path, recipe: Self::Recipe, first: Self::Data<'_>, data: &str) -> Result<Self> {
        let no = |problem: String| Error::malformed(path, format!("cannot continue from this checkpoint: {problem}"));
        let (found, mut tensors, sealed) = unpack::<Progress>(&read(path)?, Self::CHECKPOINT).map_err(no)?;
        sealed.map_err(no)?;
        let asked = settings::<Self>(&recipe);
        if found.recipe != asked {
            let begun = found.recipe;
            return Err(no(format!("it was begun as {begun}, and now {asked} is asked for; remove it to begin anew")));
        }
        if found.data != data {
            return Err(no("it was begun with other data; remove it to begin anew".into()));
        }
        let mut trainer = Self::new(recipe, first)?;
        for (name, part) in trainer.parts() {
            match tensors.remove(&name) {
                Some((_, values)) if values.len() == part.len() => part.copy_from_slice(&values),
                _ => return Err(no(format!("the tensor {name} is missing or does not fit"))),
            }
        }
        if found.batch >= trainer.batches(first) {
            return Err(no("it counts more batches than the data have".into()));
        }
        let epochs = trainer.state().epochs();
        if (found.epoch, found.batch) > (epochs, 0) {
            let more = format!("it has done more than the {epochs} epochs that are asked for");
            return Err(no(format!(
                "{more} ({} and {} batches); ask for more, or remove it to begin anew",
                found.epoch, found.batch
            )));
        }
        (trainer.state_mut().epoch, trainer.state_mut().batch) = (found.epoch, found.batch);
        trainer.check()?;
        Ok(trainer)
    }
}

/// Trains as [`Training::step`] does, but saves a checkpoint before every `every`-th step and continues from it: the result of an
/// interrupted training, for tests.
///
/// # Errors
/// As [`Training::new`], [`Training::save`] and [`Training::resume`].
pub fn interrupted<T: Training>(recipe: &T::Recipe, data: T::Data<'_>, every: usize, path: &Path) -> Result<T> {
    let mut training = T::new(recipe.clone(), data)?;
    let mut steps = 0;
    while !training.is_done() {
        steps += 1;
        if steps % every == 0 {
            training.save(path, "abc")?;
            training = T::resume(path, recipe.clone(), data, "abc")?;
        }
        training.step(data);
    }
    Ok(training)
}

/// Implements [`Training`]'s access to the fields `recipe` and `state`.
#[doc(hidden)]
#[macro_export]
macro_rules! training_fields {
    () => {
        fn recipe(&self) -> &Recipe {
            &self.recipe
        }
        fn state(&self) -> &EpochState {
            &self.state
        }
        fn state_mut(&mut self) -> &mut EpochState {
            &mut self.state
        }
    };
}

/// The metadata of a checkpoint.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Progress {
    /// The settings that must be the same.
    recipe: String,
    /// Identifies the data.
    data: String,
    /// Epochs that are done.
    epoch: usize,
    /// Batches of the next epoch that are done.
    batch: usize,
}

/// The settings that a checkpoint must share with the training that continues from it, as JSON.
fn settings<T: Training>(recipe: &T::Recipe) -> String {
    let text = serde_json::to_string(recipe).expect("a recipe is plain data");
    let mut fields: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).expect("it has fields");
    if T::EXTENDS {
        fields.remove("epochs");
    }
    serde_json::Value::Object(fields).to_string()
}

#[cfg(test)]
mod tests;
