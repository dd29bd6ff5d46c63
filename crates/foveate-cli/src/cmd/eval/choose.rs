//! Implements `foveate eval --choose`: runs candidates on all sequences, chooses on one half and tests on the other.
//!
//! Finished runs are kept in `runs/`, named by a digest of their dependencies, so that the same command resumes after an interruption. The
//! tracks of each candidate are in `candidates/`, in folders that `foveate eval --results` reads.

use std::path::Path;

use foveate::config::Config;
use foveate::files::Folder;
use foveate::lab::eval::choice::by_half;
use foveate::lab::eval::choice_table::{self, Choice};
use foveate::lab::eval::{Evaluation, Sequence, TrackRun, experiment, run_all, track_files};
use foveate::{Error, Result, files};

use super::grid::{Candidate, candidates};
use super::kept::{self, Kept};
use super::record::{Data, program};
use crate::runs::{Entry, Store};

/// The folder of candidates.
const CANDIDATES: &str = "candidates";

/// A run: indices of candidate and sequence, and the seed.
struct Job {
    candidate: usize,
    sequence: usize,
    seed: u64,
}

/// The checked candidates: each is a valid tracker, and both halves have sequences.
pub(super) struct Plan {
    candidates: Vec<Candidate>,
    entries: Vec<Entry>,
    present: Option<usize>,
}

impl Plan {
    /// Creates the plan from the settings of --choose. Writes nothing yet.
    pub(super) fn of(config: &Config, folder: &Folder, choices: &[String], sequences: &[Sequence]) -> Result<Self> {
        for half in ["a", "b"] {
            if !sequences.iter().any(|s| by_half(&s.origin) == half) {
                let all: Vec<&str> = sequences.iter().map(|s| s.name.as_str()).collect();
                return Err(Error::Invalid(format!(
                    "--choose chooses on one half of the sequences and judges on the other, but none of these is in half {half}: \
                     {}; give more sequences with --seqs",
                    all.join(", ")
                )));
            }
        }
        let candidates = candidates(config, choices)?;
        let program = program()?;
        let entry = |c: &Candidate| {
            let named = |e: Error| Error::Config(format!("--choose, candidate {}: {e}", c.name));
            Entry::of(c.config.clone().check(folder).map_err(named)?, &program)
        };
        let entries = candidates.iter().map(entry).collect::<Result<_>>()?;
        let present = candidates.iter().position(|c| c.config == *config);
        Ok(Self { candidates, entries, present })
    }

    /// Makes the runs missing in `store`; returns all tracks. `None` if the program was stopped, or does only a part.
    pub(super) fn run(
        &self,
        sequences: &[Sequence],
        data: &[Data],
        seeds: &[u64],
        store: &Store,
    ) -> Result<Option<Vec<Kept>>> {
        let jobs: Vec<Job> = (0..self.candidates.len())
            .flat_map(|c| seeds.iter().flat_map(move |seed| (0..sequences.len()).map(move |s| (c, *seed, s))))
            .map(|(candidate, seed, sequence)| Job { candidate, sequence, seed })
            .collect();
        let key = |job: &Job| {
            let (entry, sequence) = (&self.entries[job.candidate], &sequences[job.sequence]);
            kept::key("choose", entry, sequence, &data[job.sequence], job.seed)
        };
        let make = |job: &Job| kept::make(&self.entries[job.candidate], &sequences[job.sequence], job.seed);
        let frames = |job: &Job| sequences[job.sequence].truth.len();
        let tracks: Option<Vec<Kept>> = store.finished("choose", &jobs, &frames, &key, &make)?.into_iter().collect();
        Ok(tracks.filter(|_| store.shard.is_none()))
    }

    /// Returns the files in the results folder that [`Plan::judge`] and [`keep`] may write.
    pub(super) fn files(&self, sequences: &[Sequence], seeds: &[u64]) -> Vec<String> {
        let mut files: Vec<String> = ["cross.txt", "cross.json"].map(str::to_owned).to_vec();
        for c in &self.candidates {
            let folder = format!("{CANDIDATES}/{}", folder_name(&c.name));
            files.push(format!("{folder}/config.toml"));
            files.extend(track_files(&folder, sequences, seeds));
        }
        files
    }

    /// Returns the choice, and the cross-validated tracker.
    pub(super) fn judge(
        &self,
        sequences: &[Sequence],
        seeds: &[u64],
        out: &Path,
        tracks: &[Kept],
    ) -> Result<(Choice, Evaluation)> {
        let evaluations: Vec<Evaluation> = self.score(sequences, seeds, out, tracks)?;
        let choice = Choice::of(&evaluations, self.present).expect("both halves have sequences");
        let cross = choice.cross_validated("foveate, cross-validated", &evaluations);
        Ok((choice, cross))
    }

    /// Writes the tracks of each candidate to its own folder, and scores them.
    fn score(&self, sequences: &[Sequence], seeds: &[u64], out: &Path, tracks: &[Kept]) -> Result<Vec<Evaluation>> {
        let one = |(c, tracks): (&Candidate, &[Kept])| {
            let folder = out.join(CANDIDATES).join(folder_name(&c.name));
            std::fs::create_dir_all(&folder).map_err(Error::io(&folder, "cannot create"))?;
            files::write_inside(folder.join("config.toml"), c.config.to_toml().as_bytes())?;
            let again = |sequence: &Sequence, seed: u64| {
                let same = |t: &&Kept| t.sequence == sequence.name && t.seed == seed;
                let track = tracks.iter().find(same).expect("every job is done");
                Ok(TrackRun { read: None, ..track.clone().apart().0 })
            };
            run_all(&c.name, sequences, seeds, Some(&folder), &again, &mut |_| ())
        };
        self.candidates.iter().zip(tracks.chunks(seeds.len() * sequences.len())).map(one).collect()
    }
}

/// Writes a choice as cross.txt and cross.json, with the configuration and the seeds; returns the text.
pub(super) fn keep(choice: &Choice, configuration: &str, seeds: &[u64], out: &Path) -> Result<String> {
    let (text, mut json) = (choice_table::text(choice), choice_table::json(choice));
    json["configuration"] = configuration.into();
    json["seeds"] = seeds.into();
    let json = serde_json::to_string_pretty(&json).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write_inside(out.join("cross.txt"), text.as_bytes())?;
    files::write_inside(out.join("cross.json"), json.as_bytes())?;
    Ok(text)
}

/// Returns a candidate's folder name: its name, with `_` for characters that are unsuitable in file names.
fn folder_name(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._=-".contains(c);
    let short: String = name.chars().map(|c| if plain(c) { c } else { '_' }).take(100).collect();
    if short == name.replace(' ', "_") {
        short
    } else {
        format!("{short}-{}", &experiment::digest(&[name.as_bytes()])[..8])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_have_plain_names() {
        assert_eq!(folder_name("particles=400 camera_motion.share=0.5"), "particles=400_camera_motion.share=0.5");
        let two = [folder_name("a=[1, 2]"), folder_name("a=[1; 2]")];
        assert!(two[0].starts_with("a=_1__2_-") && two[0] != two[1], "{two:?}");
        assert!(folder_name(&"x".repeat(500)).len() < 120);
    }
}
