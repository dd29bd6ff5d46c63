//! The inputs of experiments: digits, sequences, finished runs, and the changes of the command line.

use std::path::PathBuf;

use foveate::config::Config;
use foveate::lab::eval::experiment::digest;
use foveate::lab::synthetic::{Drawn, Synthetic};
use foveate::lab::{Digits, Split};
use foveate::{Result, Tracker};
use foveate_cli::note;
use foveate_cli::runs::{self, Entry, Finished, Store};
use serde::Serialize;

/// One run: the indices of its entry and its scene, the video, and the seed of the tracker's randomness.
pub(super) struct Job {
    pub entry: usize,
    pub scene: usize,
    pub video: Synthetic,
    pub seed: u64,
}

/// The file of a finished run.
#[derive(Serialize)]
struct Stored<'a, R> {
    configuration: &'a Config,
    video: &'a Synthetic,
    seed: u64,
    digits: &'a str,
    #[serde(flatten)]
    run: &'a R,
}

/// Follows the target of a video.
pub(super) type Following<R> = dyn Fn(&dyn Drawn, &mut Tracker) -> Result<R> + Sync;

/// Number of digits drawn of each class without MNIST.
const DRAWN: usize = 40;

/// The inputs of experiments.
pub(super) struct Setup {
    pub digits: Digits,
    /// Origin of the digits.
    pub from: String,
    /// Whether the digits are MNIST's.
    pub mnist: bool,
    /// The folder with real sequences in `tracking/`.
    pub data: PathBuf,
    pub store: Store,
    /// Output folder.
    pub out: PathBuf,
    /// Settings that replace those of every configuration.
    pub settings: Vec<String>,
    pub quick: bool,
}

impl Setup {
    /// Uses the data of a folder; by default of $FOVEATE_DATA or `data`, or digits drawn with pen strokes.
    pub(super) fn of(data: Option<PathBuf>, store: Store, out: PathBuf) -> Result<Self> {
        let usual = || std::env::var_os("FOVEATE_DATA").map_or_else(|| "data".into(), PathBuf::from);
        let (given, data) = (data.is_some(), data.unwrap_or_else(usual));
        let (digits, from, mnist) = match Digits::load(&data, Split::Test) {
            Ok(digits) => (digits, "MNIST test digits", true),
            Err(error) if given => return Err(error),
            Err(error) => {
                let note = "digits drawn by a pen, NOT MNIST: figures are not to be compared with those on MNIST";
                note!("foveate: {note} ({error}; name their folder with --data DIR)");
                (Digits::drawn(1, DRAWN), note, false)
            }
        };
        Ok(Self { digits, from: from.into(), mnist, data, store, out, settings: vec![], quick: false })
    }

    /// Returns the runs of all jobs, in their order; `follow` makes the missing ones.
    pub(super) fn runs<R: Finished>(
        &self,
        name: &str,
        entries: &[Entry],
        jobs: &[Job],
        follow: &Following<R>,
    ) -> Result<Vec<Option<R>>> {
        let pixels = runs::pixels(&self.digits);
        let key = |job: &Job| {
            let scene = serde_json::to_vec(&job.video).expect("settings are plain data");
            let seed = job.seed.to_le_bytes();
            digest(&[entries[job.entry].key.as_bytes(), &scene, &seed, pixels.as_bytes()])
        };
        let make = |job: &Job| {
            let blueprint = &entries[job.entry].blueprint;
            let mut tracker = blueprint.tracker_of(job.seed, u64::from(job.video.digit()))?;
            let run = follow(&*job.video.video(&self.digits)?, &mut tracker)?;
            let (configuration, video, seed) = (blueprint.config(), &job.video, job.seed);
            let stored = Stored { configuration, video, seed, digits: &self.from, run: &run };
            let text = runs::text(&stored)?;
            Ok((run, text))
        };
        self.store.finished(name, jobs, &|job| job.video.frames(), &key, &make)
    }
}
