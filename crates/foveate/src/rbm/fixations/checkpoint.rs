//! Interrupted training of a multi-fixation RBM; as `rbm::checkpoint`, resumed training ends with the same bits.

use super::super::io;
use super::io::take;
use super::parameters::{NAMES, Parameters};
use super::{Places, Recipe, Sequences, Trainer};
use crate::rbm::course::Course;
use crate::{Error, Result, files};
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    recipe: Recipe,
    places: Places,
    data: String,
    epoch: usize,
    batch: usize,
    steps: u64,
}

const PREFIXES: [&str; 4] = ["", "first.", "second.", "mean."];

impl Trainer {
    /// Writes a checkpoint; the file is whole or as it was before. `data` names what is learned from, in all epochs.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub fn save(&self, path: &Path, data: &str) -> Result<()> {
        self.learned()?;
        let (epoch, batch) = self.progress();
        let (recipe, places) = (self.recipe.clone(), self.places.clone());
        let state = State { recipe, places, data: data.into(), epoch, batch, steps: self.steps };
        let names = PREFIXES.map(|prefix| NAMES.map(|name| format!("{prefix}{name}")));
        let parts = [&self.parameters, &self.first, &self.second, &self.mean].into_iter().zip(&names);
        let mut tensors: Vec<_> = parts.flat_map(|(part, names)| part.tensors(self.shape, names)).collect();
        tensors.push(("offset", vec![self.shape.n_v], &self.offset));
        files::write(path, &io::pack("fixations-checkpoint", state, &tensors))
    }
    /// Goes on from a checkpoint made with the same recipe, places and data (`now` being those of its epoch).
    ///
    /// Fails, with the reason, if they are others, or the file is damaged.
    pub fn resume(path: &Path, recipe: Recipe, places: Places, now: Sequences<'_>, data: &str) -> Result<Self> {
        let refuse = |problem: String| Error::malformed(path, format!("cannot go on from this checkpoint: {problem}"));
        let (state, mut tensors, sealed) =
            io::unpack::<State>(&io::read(path)?, "fixations-checkpoint").map_err(refuse)?;
        sealed.map_err(refuse)?;
        if state.recipe != recipe || state.places != places || state.data != data {
            let text = |r: &Recipe| serde_json::to_string(r).unwrap_or_default();
            return Err(refuse(format!(
                "it was begun as {} on {}, and now {} on {data} is asked for; remove it to begin anew",
                text(&state.recipe),
                state.data,
                text(&recipe)
            )));
        }
        let mut fresh = Self::new(recipe, places, now)?;
        let mut part = |prefix: &str| -> Result<Parameters> { take(&mut tensors, fresh.shape, prefix).map_err(refuse) };
        let [parameters, first, second, mean] = PREFIXES;
        let (parameters, first, second, mean) = (part(parameters)?, part(first)?, part(second)?, part(mean)?);
        match tensors.remove("offset") {
            Some((_, offset)) if offset.len() == fresh.offset.len() => fresh.offset = offset,
            _ => return Err(refuse("the tensor offset is missing or does not fit".into())),
        }
        if state.batch >= fresh.batches(now.len()) {
            return Err(refuse("it counts more batches than the data have".into()));
        }
        (fresh.parameters, fresh.first, fresh.second, fresh.mean) = (parameters, first, second, mean);
        (fresh.course, fresh.steps) = (Course::at((state.epoch, state.batch)), state.steps);
        fresh.learned()?;
        Ok(fresh)
    }
    /// The epoch a checkpoint was written in, counted from 0: what data to go on with. Fails if it is no checkpoint.
    pub fn epoch_of(path: &Path) -> Result<usize> {
        let read = io::unpack::<State>(&io::read(path)?, "fixations-checkpoint");
        read.map(|found| found.0.epoch).map_err(|problem| Error::malformed(path, problem))
    }
}
