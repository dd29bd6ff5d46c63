//! Model files and checkpoints of autoencoders.

use super::{Autoencoder, Recipe, Trainer};
use foveate::learn::rbm::io::{About, Tensor, Tensors, open, pack};
use foveate::learn::rbm::progress::{Checkpoint, save};
use foveate::learn::rbm::{Metadata, Rbm, Visible};
use foveate::rows::Rows;
use foveate::{Result, files};
use std::path::Path;

const KIND: &str = "autoencoder";
const CHECKPOINT: &str = "autoencoder-checkpoint";

impl Autoencoder {
    /// Returns W, b and c in the order of model files.
    pub(crate) fn tensors(&self) -> Vec<Tensor<'_>> {
        self.layer.tensors()
    }
    /// Creates the model from the tensors of a file, and removes them from `tensors`. Errors are texts.
    pub(crate) fn of_tensors(tensors: &mut Tensors) -> std::result::Result<Self, String> {
        Ok(Self { layer: Rbm::of_tensors(Visible::Gaussian, tensors)? })
    }
    /// Writes a model file; it is complete or absent.
    pub(crate) fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        files::write(path, &pack(KIND, About { metadata: metadata.clone() }, &self.tensors()))
    }
    /// Reads a model from the bytes of a file; `path` names it in errors.
    ///
    /// Fails, with the reason, if the bytes are no model file, have another format or kind, or are damaged.
    pub(crate) fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let (found, about) = open(bytes, path, KIND, |_: &About, tensors| Self::of_tensors(tensors))?;
        Ok((found, about.metadata))
    }
}

impl Trainer {
    /// Writes a checkpoint; after an error the previous file stays. `data_sha256` identifies the training rows.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub(crate) fn save(&self, path: &Path, data_sha256: &str) -> Result<()> {
        self.check()?;
        let mut all = self.model.tensors();
        all.push(("velocity", vec![self.velocity.len()], &self.velocity));
        save(path, CHECKPOINT, (&self.recipe, self.progress(), data_sha256), &all)
    }
    /// Resumes from a checkpoint with the same recipe (except the number of epochs) and the same rows.
    ///
    /// Fails, with the reason, if the recipe or the data differ, or the file is damaged.
    pub(crate) fn resume(path: &Path, recipe: Recipe, rows: Rows<'_>, data_sha256: &str) -> Result<Self> {
        let as_long = |begun| Recipe { epochs: recipe.epochs, ..begun };
        let mut checkpoint = Checkpoint::open(path, CHECKPOINT, &recipe, as_long, ("data", data_sha256))?;
        let found = Autoencoder::of_tensors(&mut checkpoint.tensors).map_err(|p| checkpoint.refuse(&p))?;
        let mut fresh = Self::new(recipe, rows)?;
        fresh.velocity = checkpoint.take("velocity", fresh.velocity.len())?;
        if found.layer.shape() != fresh.model.layer.shape() {
            return Err(checkpoint.refuse("its sizes are not those of the data"));
        }
        fresh.model = found;
        fresh.state = checkpoint.state(fresh.batches(rows.len()))?;
        Ok(fresh)
    }
}
