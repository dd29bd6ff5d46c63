//! Model files of filters.

use super::PatchFilters;
use crate::rbm::io::{Tensor, Tensors, open, pack, read};
use crate::rbm::{Metadata, Whitening};
use foveate_base::{Result, files};
use serde::{Deserialize, Serialize};
use std::path::Path;

const KIND: &str = "kmeans";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct About {
    /// Absent in files of filters of rows as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    softening: Option<f32>,
    metadata: Metadata,
}

impl PatchFilters {
    /// Writes a model file; it is whole or not there.
    pub fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        let about = About { softening: self.softening, metadata: metadata.clone() };
        files::write(path, &pack(KIND, about, &self.tensors()))
    }
    /// The whitening and D, as model files have them.
    pub fn tensors(&self) -> Vec<Tensor<'_>> {
        let (n_p, n_x, k) = self.shape();
        vec![
            ("mean", vec![n_p], self.whitening.mean()),
            ("whitening", vec![n_p, n_x], self.whitening.matrix().data()),
            ("filters", vec![n_x, k], &*self.filters),
        ]
    }
    /// From the tensors of a model file, which are used up to what does not belong to filters; problems in words.
    pub fn of_tensors(softening: Option<f32>, tensors: &mut Tensors) -> std::result::Result<Self, String> {
        let mut take = |name: &str| tensors.remove(name).ok_or_else(|| format!("the tensor {name} is missing"));
        let (mean, matrix, filters) = (take("mean")?, take("whitening")?, take("filters")?);
        let white = matrix.0.get(1).copied().unwrap_or(0);
        let n_p = mean.1.len();
        if mean.0 != [n_p] || matrix.0 != [n_p, white] || filters.0.len() != 2 || filters.0[0] != white || white == 0 {
            return Err(format!("mean is {:?}, whitening {:?}, filters {:?}", mean.0, matrix.0, filters.0));
        }
        let whitening = Whitening::new(mean.1, matrix.1).map_err(|e| e.to_string())?;
        Self::new(whitening, filters.1, softening).map_err(|e| e.to_string())
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors.
    ///
    /// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let take = |about: &About, tensors: &mut Tensors| Self::of_tensors(about.softening, tensors);
        let (found, about) = open(bytes, path, KIND, take)?;
        Ok((found, about.metadata))
    }
    /// Reads a model file; see [`PatchFilters::from_bytes`].
    pub fn load(path: &Path) -> Result<(Self, Metadata)> {
        Self::from_bytes(&read(path)?, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::{Recipe, Trainer};
    use crate::training::Training;
    use foveate_base::rows::Rows;

    #[test]
    fn models_come_back_and_checkpoints_go_on() {
        let data: Vec<f32> = (0..900).map(|i| ((i * i % 101) as f32).sin()).collect();
        let rows = Rows::new(&data, 9);
        let recipe = Recipe::new(5);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (path, checkpoint) = (dir.path().join("m.safetensors"), dir.path().join("c"));
        let mut whole = Trainer::new(recipe.clone(), rows).expect("patches");
        whole.step(rows);
        whole.save(&checkpoint, "x").expect("a writable folder");
        whole.step(rows);
        let mut rest = Trainer::resume(&checkpoint, recipe.clone(), rows, "x").expect("just written");
        rest.step(rows);
        assert_eq!(rest.learned(), whole.learned());
        assert!(Trainer::resume(&checkpoint, recipe, rows, "y").expect_err("other data").to_string().contains("other"));
        let metadata = Metadata { command: "foveate".into(), ..Metadata::default() };
        whole.learned().save(&path, &metadata).expect("a writable folder");
        assert_eq!(PatchFilters::load(&path).expect("just written"), (whole.learned().clone(), metadata));
        let mut bytes = std::fs::read(&path).expect("just written");
        *bytes.last_mut().expect("not empty") ^= 1;
        assert!(PatchFilters::from_bytes(&bytes, &path).is_err());
        let other = crate::rbm::Rbm::load(&path).expect_err("another kind").to_string();
        assert!(other.contains(KIND), "{other}");
    }
}
