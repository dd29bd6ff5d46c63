//! Stored runs of `foveate eval`: an interrupted evaluation resumes, also with `--choose`, and several processes or machines can share one
//! (`--shard`, `--merge`).

use foveate::lab::eval::confidence::Judged;
use foveate::lab::eval::{Sequence, TrackRun, experiment};
use foveate::{BBox, Result};
use serde::{Deserialize, Serialize};

use super::one_pass::one_pass;
use super::record::{Data, Settings};
use crate::runs::{self, Entry, Finished, Store};

/// A finished run, as stored in its file.
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
    /// Returns the parts in the form of [`one_pass`].
    pub(crate) fn apart(self) -> (TrackRun, Vec<Judged>) {
        (TrackRun { boxes: self.boxes, seconds: self.seconds, read: self.read }, self.judged)
    }
}

impl Finished for Kept {
    fn is_of(&self, frames: usize) -> bool {
        self.boxes.len() == frames && self.judged.len() + 1 == frames
    }
}

/// A configuration, or one for each half, on sequences.
pub(crate) struct Runs<'a> {
    entries: Vec<Entry>,
    sequences: &'a [Sequence],
    data: &'a [Data],
    store: &'a Store,
}

impl<'a> Runs<'a> {
    /// Creates the runs that are or will be stored in `store`; `data` belongs to the sequences.
    pub(crate) fn new(entries: Vec<Entry>, sequences: &'a [Sequence], data: &'a [Data], store: &'a Store) -> Self {
        Self { entries, sequences, data, store }
    }

    /// Returns the run of a sequence with a seed, stored or newly made.
    pub(crate) fn one(&self, sequence: &Sequence, seed: u64) -> Result<Kept> {
        let i = self.sequences.iter().position(|it| it.name == sequence.name).expect("one of the sequences");
        self.store.one(&self.key(seed, i), sequence.truth.len(), || make(self.entry(i), sequence, seed))
    }

    /// Returns the runs of each seed with each sequence, in this order; makes missing ones in parallel, each in one thread. `None` if the
    /// program was stopped, or does only a part.
    pub(crate) fn all(&self, seeds: &[u64]) -> Result<Option<Vec<Kept>>> {
        let jobs: Vec<(u64, usize)> =
            seeds.iter().flat_map(|seed| (0..self.sequences.len()).map(move |sequence| (*seed, sequence))).collect();
        let key = |(seed, i): &(u64, usize)| self.key(*seed, *i);
        let make = |(seed, i): &(u64, usize)| make(self.entry(*i), &self.sequences[*i], *seed);
        let frames = |(_, i): &(u64, usize)| self.sequences[*i].truth.len();
        let kept: Option<Vec<Kept>> = self.store.finished("eval", &jobs, &frames, &key, &make)?.into_iter().collect();
        Ok(kept.filter(|_| self.store.shard.is_none()))
    }

    /// Removes the files of these runs, and their folder if it is then empty.
    pub(crate) fn forget(&self, seeds: &[u64]) -> Result<()> {
        let all = |seed: &u64| (0..self.sequences.len()).map(|i| self.key(*seed, i)).collect::<Vec<_>>();
        self.store.forget(seeds.iter().flat_map(all))?;
        // Other files in the folder do not belong to this evaluation.
        let _ = std::fs::remove_file(Settings::file(&self.store.folder));
        Ok(())
    }

    /// Returns the configuration for a sequence.
    fn entry(&self, i: usize) -> &Entry {
        self.entries.get(self.sequences[i].origin.half as usize).unwrap_or(&self.entries[0])
    }

    fn key(&self, seed: u64, i: usize) -> String {
        key("eval", self.entry(i), &self.sequences[i], &self.data[i], seed)
    }
}

/// Returns the key of a run's file: a digest of its purpose and all its dependencies, including the boxes and pictures of the sequence.
pub(crate) fn key(purpose: &str, entry: &Entry, sequence: &Sequence, data: &Data, seed: u64) -> String {
    experiment::digest(&[purpose, &entry.key, &sequence.name, &data.digest(), &seed.to_string()].map(str::as_bytes))
}

/// Makes a run; also returns the text of its file.
pub(crate) fn make(entry: &Entry, sequence: &Sequence, seed: u64) -> Result<(Kept, Vec<u8>)> {
    let (TrackRun { boxes, seconds, read }, judged) = one_pass(&entry.blueprint, sequence, seed)?;
    let kept = Kept { sequence: sequence.name.clone(), seed, boxes, seconds, read, judged };
    let text = runs::text(&kept)?;
    Ok((kept, text))
}
