//! Runs of `foveate eval` that are kept in files, so that several processes or machines may share them out (`--shard`, `--merge`).

use foveate::config::Blueprint;
use foveate::lab::eval::confidence::Judged;
use foveate::lab::eval::{Sequence, TrackRun, experiment};
use foveate::{BBox, Error, Result};
use serde::{Deserialize, Serialize};

use super::one_pass::one_pass;
use crate::cmd::reproduce::runner::{Entry, Finished, Store};

/// A finished run, as its file has it.
#[derive(Clone, Serialize, Deserialize)]
pub struct Kept {
    pub sequence: String,
    pub seed: u64,
    boxes: Vec<BBox>,
    seconds: Vec<f64>,
    read: Option<[f64; 2]>,
    judged: Vec<Judged>,
}

impl Kept {
    /// As [`one_pass`] answers it.
    pub fn apart(self) -> (TrackRun, Vec<Judged>) {
        (TrackRun { boxes: self.boxes, seconds: self.seconds, read: self.read }, self.judged)
    }
}

impl Finished for Kept {
    fn is_of(&self, frames: usize) -> bool {
        self.boxes.len() == frames && self.judged.len() + 1 == frames
    }
}

/// The run of each sequence with each seed; those that are not kept yet are made, each in one thread. `None` where it was asked
/// to stop, or to do a part only.
pub fn runs(blueprint: Blueprint, sequences: &[Sequence], seeds: &[u64], store: &Store) -> Result<Option<Vec<Kept>>> {
    sequences.iter().try_for_each(|sequence| sequence.init().map(|_| ()))?;
    let entry = Entry::of(blueprint, &program()?)?;
    let digests: Vec<String> = sequences.iter().map(pictures).collect::<Result<_>>()?;
    let jobs: Vec<(u64, usize)> =
        seeds.iter().flat_map(|seed| (0..sequences.len()).map(move |sequence| (*seed, sequence))).collect();
    let key = |(seed, i): &(u64, usize)| {
        let parts = ["eval", &entry.key, &sequences[*i].name, &digests[*i], &seed.to_string()];
        experiment::digest(&parts.map(str::as_bytes))
    };
    let make = |(seed, i): &(u64, usize)| {
        let (run, judged) = one_pass(&entry.blueprint, &sequences[*i], *seed)?;
        let TrackRun { boxes, seconds, read } = run;
        let kept = Kept { sequence: sequences[*i].name.clone(), seed: *seed, boxes, seconds, read, judged };
        let text = serde_json::to_vec(&kept).map_err(|e| Error::Invalid(e.to_string()))?;
        Ok((kept, text))
    };
    let frames = |(_, i): &(u64, usize)| sequences[*i].truth.len();
    let kept: Option<Vec<Kept>> = store.finished("eval", &jobs, &frames, &key, &make)?.into_iter().collect();
    Ok(kept.filter(|_| store.shard.is_none()))
}

/// A name for the program itself: a rebuilt one may track otherwise.
pub fn program() -> Result<String> {
    let path = crate::invocation::program();
    Ok(experiment::digest(&[&std::fs::read(path).map_err(Error::io(path, "cannot read"))?]))
}

/// A name for the pictures and the truth of a sequence: its true boxes, and the pictures' names and sizes.
pub fn pictures(sequence: &Sequence) -> Result<String> {
    let folder = &sequence.images;
    let cannot = || Error::io(folder, "cannot read this folder");
    let mut all = vec![];
    for entry in std::fs::read_dir(folder).map_err(cannot())? {
        let entry = entry.map_err(cannot())?;
        all.push(format!("{} {}", entry.file_name().to_string_lossy(), entry.metadata().map_err(cannot())?.len()));
    }
    all.sort();
    let truth = format!("{:?}", sequence.truth);
    Ok(experiment::digest(&[truth.as_bytes(), all.join("\n").as_bytes()]))
}
