//! Results that are written to their final place as they are produced, as in an evaluation. `run.json` lists them before the first one
//! exists, so that the next evaluation in the folder recognises them after an interruption.

use std::fs;
use std::path::{Path, PathBuf};

use foveate::{Error, Result};

use super::{Ended, MANIFEST, Manifest, manifest, not_ours};
use crate::terminal;

/// A file that every evaluation writes.
const OURS: &str = "scores.json";

/// Results in progress. If dropped before [`InPlace::finish`], they are listed as those of a run that was stopped or failed.
pub(crate) struct InPlace {
    out: PathBuf,
    names: Vec<String>,
    /// Files of an earlier evaluation that the new one does not read.
    stale: Vec<String>,
    finished: bool,
}

impl InPlace {
    /// Lists the new `names`, which are paths below the folder, beside the files of an earlier evaluation. Fails if the folder cannot be
    /// created or written.
    pub(crate) fn begin(out: &Path, mut names: Vec<String>, read: &[&Path]) -> Result<Self> {
        fs::create_dir_all(out).map_err(Error::io(out, "cannot create"))?;
        let earlier = match manifest(out) {
            None if out.join(MANIFEST).exists() => return Err(not_ours(out)),
            earlier => earlier.map_or(vec![], |earlier| earlier.files),
        };
        let read: Vec<PathBuf> = read.iter().flat_map(fs::canonicalize).collect();
        let is_ours = earlier.iter().any(|name| name == OURS);
        let is_read = |name: &String| {
            fs::canonicalize(out.join(name)).is_ok_and(|path| read.iter().any(|read| path.starts_with(read)))
        };
        let (stale, kept): (Vec<_>, Vec<_>) = earlier.into_iter().partition(|name| is_ours && !is_read(name));
        names.extend(kept);
        let made = Self { out: out.to_owned(), names, stale, finished: false };
        made.list(false, Ended::Stopped)?;
        Ok(made)
    }

    /// Completes the results and removes the remaining files of an earlier evaluation.
    pub(crate) fn finish(mut self) -> Result<()> {
        self.finished = true;
        let whole = fs::canonicalize(&self.out).map_err(Error::io(&self.out, "cannot find the folder for results"))?;
        for name in std::mem::take(&mut self.stale) {
            if self.names.contains(&name) {
                continue;
            }
            // The name may be anything, so it must lead to a file below the folder.
            let Ok(path) = fs::canonicalize(self.out.join(&name)) else { continue };
            if !path.starts_with(&whole) || !path.is_file() {
                continue;
            }
            fs::remove_file(&path).map_err(Error::io(&path, "cannot remove"))?;
            let folders = path.ancestors().skip(1).take_while(|folder| **folder != whole);
            // Folders with other contents stay.
            let _ = folders.map(fs::remove_dir).find(std::result::Result::is_err);
        }
        let mut names = std::mem::take(&mut self.names);
        names.retain(|name| self.out.join(name).is_file());
        names.sort();
        names.dedup();
        self.names = names;
        self.list(true, Ended::Finished)
    }

    fn list(&self, complete: bool, ended: Ended) -> Result<()> {
        let names = [&self.names[..], &self.stale].concat();
        Manifest::of(complete, ended, None, &names).write(&self.out)
    }
}

impl Drop for InPlace {
    fn drop(&mut self) {
        if !self.finished {
            // The error that ended the evaluation is reported instead.
            let _ = self.list(false, if terminal::stopping() { Ended::Stopped } else { Ended::Error });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_earlier_one_left_goes_and_all_else_stays() {
        let place = tempfile::tempdir().expect("a temporary folder");
        let out = place.path().join("out");
        let write = |name: &str| {
            let path = out.join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(path, "text").expect("writable");
        };
        let run = |names: &[&str], read: &[&Path]| {
            let made = InPlace::begin(&out, names.iter().map(ToString::to_string).collect(), read).expect("begun");
            names.iter().filter(|name| **name != "none").for_each(|name| write(name));
            made.finish().expect("finished");
        };
        run(&["scores.json", "ours/a.txt", "ours/seed-2/a.txt", "none"], &[]);
        assert_eq!(manifest(&out).expect("a list").files, ["ours/a.txt", "ours/seed-2/a.txt", "scores.json"]);
        write("ours/mine.txt");
        write("runs/kept.json");
        fs::write(place.path().join("precious"), "mine").expect("writable");
        let all = ["../precious", "/etc/hosts", "ours", "ours/a.txt", "ours/seed-2/a.txt", "scores.json"];
        let listed = all.map(str::to_owned);
        Manifest::of(true, Ended::Finished, None, &listed).write(&out).expect("writable");
        // Files that are read stay in the list and are removed by the next evaluation.
        run(&["scores.json"], &[&out.join("ours")]);
        assert!(out.join("ours/seed-2/a.txt").is_file());
        run(&["scores.json"], &[]);
        let there = |name: &str| out.join(name).exists();
        assert!(!there("ours/a.txt") && !there("ours/seed-2") && there("scores.json"));
        assert!(there("ours/mine.txt") && there("runs/kept.json") && place.path().join("precious").is_file());
        // An unfinished evaluation is also listed and has removed nothing.
        drop(InPlace::begin(&out, vec!["half.txt".into()], &[]).expect("begun"));
        let broken = manifest(&out).expect("a list");
        assert!(there("scores.json") && !broken.complete && broken.ended == Some(Ended::Error));
        write("half.txt");
        run(&["scores.json"], &[]);
        assert!(!there("half.txt"));
        // Files of another command stay, and stay in the list.
        Manifest::of(true, Ended::Finished, None, &["boxes.txt".into()]).write(&out).expect("writable");
        write("boxes.txt");
        run(&["scores.json"], &[]);
        assert!(there("boxes.txt") && manifest(&out).expect("a list").files.contains(&"boxes.txt".into()));
        fs::write(out.join(MANIFEST), "[1, 2]").expect("writable");
        assert!(InPlace::begin(&out, vec![], &[]).is_err());
    }
}
