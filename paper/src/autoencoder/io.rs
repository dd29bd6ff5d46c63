//! Model files of autoencoders.

use super::Autoencoder;
use foveate::learn::rbm::io::{About, Tensor, Tensors, open, pack};
use foveate::learn::rbm::{Metadata, Rbm, Visible};
use foveate::{Result, files};
use std::path::Path;

const KIND: &str = "autoencoder";

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
