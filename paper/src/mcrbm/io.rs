//! Model files of factored RBMs: checksummed tensors, as `rbm/io.rs` writes them.

use super::{FactoredRbm, Parameters, Sizes};
use foveate::learn::rbm::Metadata;
use foveate::learn::rbm::Whitening;
use foveate::learn::rbm::io::{About, Tensor, Tensors, open, pack};
use foveate::{Result, files};
use std::path::Path;

const KIND: &str = "mcrbm";

impl FactoredRbm {
    /// Returns the bytes of a model file.
    pub(crate) fn to_bytes(&self, metadata: &Metadata) -> Vec<u8> {
        pack(KIND, About { metadata: metadata.clone() }, &self.tensors())
    }
    /// Returns the whitening, C, P, W and the biases in the order of model files.
    pub(crate) fn tensors(&self) -> Vec<Tensor<'_>> {
        let (n_v, n_x) = self.whitening.shape();
        let Sizes { factors, covariance, mean, .. } = self.parameters.sizes();
        let shapes =
            [vec![n_x, factors], vec![factors, covariance], vec![covariance], vec![n_x, mean], vec![mean], vec![n_x]];
        let mut all: Vec<Tensor<'_>> = vec![
            ("whitening.mean", vec![n_v], self.whitening.mean()),
            ("whitening.matrix", vec![n_v, n_x], self.whitening.matrix().data()),
        ];
        all.extend(
            self.parameters.parts().into_iter().zip(shapes).map(|((name, values), shape)| (name, shape, &values[..])),
        );
        all
    }
    /// Creates the machine from the tensors of a file, and removes them from `tensors`. Errors are texts.
    pub(crate) fn of_tensors(tensors: &mut Tensors) -> std::result::Result<Self, String> {
        let mut shapes = vec![];
        let mut take = |name: &str| {
            let (shape, values) = tensors.remove(name).ok_or_else(|| format!("the tensor {name} is missing"))?;
            shapes.push((name.to_string(), shape));
            Ok::<_, String>(values)
        };
        let (mean, matrix) = (take("whitening.mean")?, take("whitening.matrix")?);
        let mut parameters = Parameters::default();
        for (name, part) in parameters.parts_mut() {
            *part = take(name)?;
        }
        let whitening = Whitening::new(mean, matrix).map_err(|e| e.to_string())?;
        let found = Self::new(whitening, parameters).map_err(|e| e.to_string())?;
        for ((name, shape), (_, expected, _)) in shapes.iter().zip(found.tensors()) {
            if *shape != expected {
                return Err(format!("{name} is {shape:?}, expected {expected:?}"));
            }
        }
        Ok(found)
    }
    /// Writes a model file; it is complete or absent.
    pub(crate) fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        files::write(path, &self.to_bytes(metadata))
    }
    /// Reads a model from the bytes of a file; `path` names it in errors.
    ///
    /// Fails, with the reason, if the bytes are no model file, have another format or kind, or are damaged.
    pub(crate) fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let (found, about) = open(bytes, path, KIND, |_: &About, tensors| Self::of_tensors(tensors))?;
        Ok((found, about.metadata))
    }
}
