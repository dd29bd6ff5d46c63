//! Interrupted training of a multi-fixation RBM; as `rbm::checkpoint`, resumed training ends with the same bits.

use super::io::take;
use super::parameters::{NAMES, Parameters};
use super::{Places, Recipe, Sequences, Trainer};
use crate::rbm::progress::{self, Checkpoint};
use foveate_base::Result;
use serde::{Deserialize, Serialize};
use std::path::Path;

const KIND: &str = "fixations-checkpoint";

/// What has to be the same to go on.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    recipe: Recipe,
    places: Places,
}

const PREFIXES: [&str; 4] = ["", "first.", "second.", "mean."];

impl Trainer {
    /// Writes a checkpoint; the file is whole or unchanged. `data` identifies the training data of all epochs.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub fn save(&self, path: &Path, data: &str) -> Result<()> {
        self.learned()?;
        let settings = Settings { recipe: self.recipe.clone(), places: self.places.clone() };
        let names = PREFIXES.map(|prefix| NAMES.map(|name| format!("{prefix}{name}")));
        let parts = [&self.parameters, &self.first, &self.second, &self.mean].into_iter().zip(&names);
        let mut tensors: Vec<_> = parts.flat_map(|(part, names)| part.tensors(self.shape, names)).collect();
        tensors.push(("offset", vec![self.shape.n_v], &self.offset));
        progress::save(path, KIND, (&settings, self.progress(), data), &tensors)
    }
    /// Goes on from a checkpoint made with the same recipe, places and data (`now` being those of its epoch).
    ///
    /// Fails, with the reason, if they are others, or the file is damaged.
    pub fn resume(path: &Path, recipe: Recipe, places: Places, now: Sequences<'_>, data: &str) -> Result<Self> {
        let settings = Settings { recipe: recipe.clone(), places: places.clone() };
        let mut checkpoint = Checkpoint::open(path, KIND, &settings, |begun| begun, ("data", data))?;
        let mut fresh = Self::new(recipe, places, now)?;
        let mut part = |prefix: &str| -> Result<Parameters> {
            take(&mut checkpoint.tensors, fresh.shape, prefix).map_err(|problem| checkpoint.refuse(&problem))
        };
        let [parameters, first, second, mean] = PREFIXES;
        let (parameters, first, second, mean) = (part(parameters)?, part(first)?, part(second)?, part(mean)?);
        fresh.offset = checkpoint.take("offset", fresh.offset.len())?;
        (fresh.parameters, fresh.first, fresh.second, fresh.mean) = (parameters, first, second, mean);
        fresh.state = checkpoint.state(fresh.batches(now.len()))?;
        fresh.learned()?;
        Ok(fresh)
    }
    /// The epoch of a checkpoint, counted from 0, which determines the data to continue with. Fails if it is no
    /// checkpoint.
    pub fn epoch_of(path: &Path) -> Result<usize> {
        progress::epoch_of::<Settings>(path, KIND)
    }
}
