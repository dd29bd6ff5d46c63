//! Runs of `foveate eval` that are kept in files: an evaluation that was stopped goes on, one with `--choose` as well, and several
//! processes or machines may share one out (`--shard`, `--merge`).

use foveate::lab::eval::confidence::Judged;
use foveate::lab::eval::{Sequence, TrackRun, experiment};
use foveate::{BBox, Result};
use serde::{Deserialize, Serialize};

use super::one_pass::one_pass;
use super::record::{Data, Settings};
use crate::runs::{self, Entry, Finished, Store};

/// A finished run, as its file has it.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Kept {
    pub sequence: String,
    pub seed: u64,
    boxes: Vec<BBox>,
    seconds: Vec<f64>,
    read: Option<[f64; 2]>,
    judged: Vec<Judged>,
}

impl Kept {
    /// As [`one_pass`] answers it.
    pub(crate) fn apart(self) -> (TrackRun, Vec<Judged>) {
        (TrackRun { boxes: self.boxes, seconds: self.seconds, read: self.read }, self.judged)
    }
}

impl Finished for Kept {
    fn is_of(&self, frames: usize) -> bool {
        self.boxes.len() == frames && self.judged.len() + 1 == frames
    }
}

/// A configuration on sequences.
pub(crate) struct Runs<'a> {
    entry: Entry,
    sequences: &'a [Sequence],
    data: &'a [Data],
    store: &'a Store,
}

impl<'a> Runs<'a> {
    /// Those that are kept in `store`, or will be; `data` are those of the sequences.
    pub(crate) fn new(entry: Entry, sequences: &'a [Sequence], data: &'a [Data], store: &'a Store) -> Self {
        Self { entry, sequences, data, store }
    }

    /// The run of a sequence with a seed, kept or made.
    pub(crate) fn one(&self, sequence: &Sequence, seed: u64) -> Result<Kept> {
        let i = self.sequences.iter().position(|it| it.name == sequence.name).expect("one of the sequences");
        self.store.one(&self.key(seed, i), sequence.truth.len(), || make(&self.entry, sequence, seed))
    }

    /// The runs of each seed with each sequence, in this order; those that are not kept yet are made side by side, each in one
    /// thread. `None` where it was asked to stop, or to do a part only.
    pub(crate) fn all(&self, seeds: &[u64]) -> Result<Option<Vec<Kept>>> {
        let jobs: Vec<(u64, usize)> =
            seeds.iter().flat_map(|seed| (0..self.sequences.len()).map(move |sequence| (*seed, sequence))).collect();
        let key = |(seed, i): &(u64, usize)| self.key(*seed, *i);
        let make = |(seed, i): &(u64, usize)| make(&self.entry, &self.sequences[*i], *seed);
        let frames = |(_, i): &(u64, usize)| self.sequences[*i].truth.len();
        let kept: Option<Vec<Kept>> = self.store.finished("eval", &jobs, &frames, &key, &make)?.into_iter().collect();
        Ok(kept.filter(|_| self.store.shard.is_none()))
    }

    /// Removes the files of these runs, and their folder where nothing else is in it.
    pub(crate) fn forget(&self, seeds: &[u64]) -> Result<()> {
        let all = |seed: &u64| (0..self.sequences.len()).map(|i| self.key(*seed, i)).collect::<Vec<_>>();
        self.store.forget(seeds.iter().flat_map(all))?;
        // What is left in the folder is not of this evaluation.
        let _ = std::fs::remove_file(Settings::file(&self.store.folder));
        Ok(())
    }

    /// What P(lost) takes off the radius of a credible region: that of the tracker's configuration.
    pub(crate) fn localisation_noise(&self) -> f64 {
        self.entry.blueprint.config().confidence.localisation_noise
    }

    fn key(&self, seed: u64, i: usize) -> String {
        key("eval", &self.entry, &self.sequences[i], &self.data[i], seed)
    }
}

/// What names the file of a run: what it is done for, and all that it depends on, the boxes and pictures of the sequence among it.
pub(crate) fn key(purpose: &str, entry: &Entry, sequence: &Sequence, data: &Data, seed: u64) -> String {
    experiment::digest(&[purpose, &entry.key, &sequence.name, &data.digest(), &seed.to_string()].map(str::as_bytes))
}

/// A run, and the text of its file.
pub(crate) fn make(entry: &Entry, sequence: &Sequence, seed: u64) -> Result<(Kept, Vec<u8>)> {
    let (TrackRun { boxes, seconds, read }, judged) = one_pass(&entry.blueprint, sequence, seed)?;
    let kept = Kept { sequence: sequence.name.clone(), seed, boxes, seconds, read, judged };
    let text = runs::text(&kept)?;
    Ok((kept, text))
}
