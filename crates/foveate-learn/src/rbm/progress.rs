//! What the checkpoints of all trainings by epochs share: how far they are, and whether they may go on.

use super::epoch_state::EpochState;
use super::io::{Tensor, Tensors, pack, read, unpack};
use foveate_base::{Error, Result, files};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The metadata of a checkpoint.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Progress<R> {
    /// How it is trained.
    recipe: R,
    /// Names the rows that are learned from.
    data_sha256: String,
    /// Epochs that are done.
    epoch: usize,
    /// Number of finished batches of that epoch; 0 if a whole epoch is one step.
    batch: usize,
}

/// Writes a checkpoint with the recipe, the progress and a checksum of the training rows; the file is whole or
/// unchanged.
pub fn save<R: Serialize>(
    path: &Path,
    kind: &str,
    (recipe, (epoch, batch), data): (&R, (usize, usize), &str),
    tensors: &[Tensor<'_>],
) -> Result<()> {
    files::write(path, &pack(kind, Progress { recipe, data_sha256: data.into(), epoch, batch }, tensors))
}

/// The epoch a checkpoint was written in, counted from 0. Fails if it is no checkpoint of a recipe `R`.
pub fn epoch_of<R: Serialize + DeserializeOwned>(path: &Path, kind: &str) -> Result<usize> {
    let read = unpack::<Progress<R>>(&read(path)?, kind);
    read.map(|found| found.0.epoch).map_err(|problem| Error::malformed(path, problem))
}

/// A checkpoint with the requested recipe and data.
pub struct Checkpoint<'a> {
    path: &'a Path,
    /// Epochs done, and batches done of the next.
    progress: (usize, usize),
    /// Its numbers.
    pub tensors: Tensors,
}

impl<'a> Checkpoint<'a> {
    /// Opens a checkpoint. `as_long` sets the requested number of epochs in a recipe; only that may differ. `what`
    /// names the data of `data_sha256` in errors.
    ///
    /// Fails, with the reason, if the recipe or the data are others, or the file is damaged.
    pub fn open<R: Clone + PartialEq + Serialize + DeserializeOwned>(
        path: &'a Path,
        kind: &str,
        recipe: &R,
        as_long: impl Fn(R) -> R,
        (what, data_sha256): (&str, &str),
    ) -> Result<Self> {
        let no = |problem: String| refuse(path, &problem);
        let (found, tensors, sealed) = unpack::<Progress<R>>(&read(path)?, kind).map_err(no)?;
        sealed.map_err(no)?;
        if as_long(found.recipe.clone()) != *recipe {
            let text = |r: &R| serde_json::to_string(r).unwrap_or_default();
            return Err(no(format!(
                "it was begun as {}, and now {} is asked for; remove it to begin anew",
                text(&found.recipe),
                text(recipe)
            )));
        }
        if found.data_sha256 != data_sha256 {
            return Err(no(format!("it was begun with other {what}; remove it to begin anew")));
        }
        Ok(Self { path, progress: (found.epoch, found.batch), tensors })
    }
    /// The values of a tensor that has to have so many.
    pub fn take(&mut self, name: &str, len: usize) -> Result<Vec<f32>> {
        match self.tensors.remove(name) {
            Some((_, values)) if values.len() == len => Ok(values),
            _ => Err(self.refuse(&format!("the tensor {name} is missing or does not fit"))),
        }
    }
    /// The progress of the training, if an epoch has so many batches.
    pub fn state(&self, batches: usize) -> Result<EpochState> {
        match self.progress {
            (epoch, batch) if batch < batches => Ok(EpochState::at(epoch, batch)),
            _ => Err(self.refuse("it counts more batches than the data have")),
        }
    }
    /// The error of a checkpoint that does not fit.
    pub fn refuse(&self, problem: &str) -> Error {
        refuse(self.path, problem)
    }
}

fn refuse(path: &Path, problem: &str) -> Error {
    Error::malformed(path, format!("cannot go on from this checkpoint: {problem}"))
}
