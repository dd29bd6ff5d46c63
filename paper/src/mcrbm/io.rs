//! Model files and checkpoints of factored RBMs: checksummed tensors, as `rbm/io.rs` writes them.

use super::hmc::Step;
use super::train::Trainer;
use super::{FactoredRbm, Parameters, Recipe, Sizes};
use foveate::learn::rbm::Metadata;
use foveate::learn::rbm::Whitening;
use foveate::learn::rbm::io::{About, Tensor, Tensors, open, pack};
use foveate::learn::rbm::progress::{Checkpoint, save};
use foveate::rows::Rows;
use foveate::{Result, files};
use std::path::Path;

const KIND: &str = "mcrbm";
const CHECKPOINT: &str = "mcrbm-checkpoint";

fn tensors<'a>(whitening: &'a Whitening, parameters: &'a Parameters) -> Vec<Tensor<'a>> {
    let (n_v, n_x) = whitening.shape();
    let Sizes { factors, covariance, mean, .. } = parameters.sizes();
    let shapes =
        [vec![n_x, factors], vec![factors, covariance], vec![covariance], vec![n_x, mean], vec![mean], vec![n_x]];
    let mut all: Vec<Tensor<'_>> = vec![
        ("whitening.mean", vec![n_v], whitening.mean()),
        ("whitening.matrix", vec![n_v, n_x], whitening.matrix().data()),
    ];
    all.extend(parameters.parts().into_iter().zip(shapes).map(|((name, values), shape)| (name, shape, &values[..])));
    all
}

impl FactoredRbm {
    /// Returns the bytes of a model file.
    pub(crate) fn to_bytes(&self, metadata: &Metadata) -> Vec<u8> {
        pack(KIND, About { metadata: metadata.clone() }, &self.tensors())
    }
    /// Returns the whitening, C, P, W and the biases in the order of model files.
    pub(crate) fn tensors(&self) -> Vec<Tensor<'_>> {
        tensors(&self.whitening, &self.parameters)
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

impl Trainer {
    /// Writes a checkpoint; after an error the previous file stays. `data_sha256` identifies the training rows.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub(crate) fn save(&self, path: &Path, data_sha256: &str) -> Result<()> {
        self.check()?;
        let state = [self.step.size, self.step.rejection, self.length];
        let n_x = self.whitening.shape().1;
        let mut all = tensors(&self.whitening, &self.parameters);
        all.push(("chains", vec![self.recipe.batch, n_x], &self.chains));
        all.push(("state", vec![3], &state));
        save(path, CHECKPOINT, (&self.recipe, self.progress(), data_sha256), &all)
    }
    /// Resumes from a checkpoint with the same recipe (except the number of epochs) and the same rows.
    ///
    /// Fails, with the reason, if the recipe or the data differ, or the file is damaged.
    pub(crate) fn resume(path: &Path, recipe: Recipe, rows: Rows<'_>, data_sha256: &str) -> Result<Self> {
        let as_long = |begun| Recipe { epochs: recipe.epochs, ..begun };
        let mut checkpoint = Checkpoint::open(path, CHECKPOINT, &recipe, as_long, ("data", data_sha256))?;
        let found = FactoredRbm::of_tensors(&mut checkpoint.tensors).map_err(|p| checkpoint.refuse(&p))?;
        let mut fresh = Self::new(recipe, rows)?;
        let mut take = |name: &str, len: usize| match checkpoint.take(name, len)? {
            values if values.iter().all(|x| x.is_finite()) => Ok(values),
            _ => Err(checkpoint.refuse(&format!("the tensor {name} is not finite"))),
        };
        let (chains, state) = (take("chains", fresh.chains.len())?, take("state", 3)?);
        if found.sizes() != fresh.learned().sizes() {
            return Err(checkpoint.refuse("its sizes are not those of the data"));
        }
        fresh.rewhiten(found.whitening, rows);
        (fresh.parameters, fresh.chains) = (found.parameters, chains);
        (fresh.step, fresh.length) = (Step { size: state[0], rejection: state[1] }, state[2]);
        fresh.state = checkpoint.state(fresh.batches())?;
        Ok(fresh)
    }
}
