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
    /// W, b and c, as model files have them.
    pub(crate) fn tensors(&self) -> Vec<Tensor<'_>> {
        self.layer.tensors()
    }
    /// From the tensors of a model file, which are used up to what does not belong to one; problems in words.
    pub(crate) fn of_tensors(tensors: &mut Tensors) -> std::result::Result<Self, String> {
        Ok(Self { layer: Rbm::of_tensors(Visible::Gaussian, tensors)? })
    }
    /// Writes a model file; it is whole or not there.
    pub(crate) fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        files::write(path, &pack(KIND, About { metadata: metadata.clone() }, &self.tensors()))
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors.
    ///
    /// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
    pub(crate) fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let (found, about) = open(bytes, path, KIND, |_: &About, tensors| Self::of_tensors(tensors))?;
        Ok((found, about.metadata))
    }
}

impl Trainer {
    /// Writes a checkpoint; the file is whole or as it was before. `data_sha256` names the training rows.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub(crate) fn save(&self, path: &Path, data_sha256: &str) -> Result<()> {
        self.check()?;
        let mut all = self.model.tensors();
        all.push(("velocity", vec![self.velocity.len()], &self.velocity));
        save(path, CHECKPOINT, (&self.recipe, self.progress(), data_sha256), &all)
    }
    /// Goes on from a checkpoint, made with the same recipe (but for the number of epochs) and the same rows.
    ///
    /// Fails, with the reason, if the recipe or the data are others, or the file is damaged.
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
