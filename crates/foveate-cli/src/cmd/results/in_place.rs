//! Results that are written where they stay, as they come: those of an evaluation. `run.json` lists them before the first is
//! there, so that the next one in the folder knows them whatever happens.

use std::fs;
use std::path::{Path, PathBuf};

use foveate::{Error, Result};

use super::{Ended, MANIFEST, Manifest, manifest, not_ours};

/// Results in the making.
pub struct InPlace {
    out: PathBuf,
    names: Vec<String>,
}

impl InPlace {
    /// Removes what an earlier run left in a folder, but for what lies below one of the folders `read`, and lists the `names` to
    /// come, which are paths below it. Fails where the folder cannot be made or written.
    pub fn begin(out: &Path, mut names: Vec<String>, read: &[&Path]) -> Result<Self> {
        fs::create_dir_all(out).map_err(Error::io(out, "cannot create"))?;
        let cannot = || Error::io(out, "cannot find the folder for results");
        let whole = fs::canonicalize(out).map_err(cannot())?;
        let earlier = match manifest(out) {
            None if out.join(MANIFEST).exists() => return Err(not_ours(out)),
            earlier => earlier.map_or(vec![], |earlier| earlier.files),
        };
        let read: Vec<PathBuf> = read.iter().flat_map(fs::canonicalize).collect();
        for name in earlier {
            // A name may be anything: what it leads to must be a file below the folder.
            let Ok(path) = fs::canonicalize(out.join(&name)) else { continue };
            if !path.starts_with(&whole) || !path.is_file() {
                continue;
            }
            if read.iter().any(|folder| path.starts_with(folder)) {
                names.push(name);
                continue;
            }
            fs::remove_file(&path).map_err(Error::io(&path, "cannot remove"))?;
            let folders = path.ancestors().skip(1).take_while(|folder| **folder != whole);
            // Those that hold something else stay.
            let _ = folders.map(fs::remove_dir).find(std::result::Result::is_err);
        }
        let made = Self { out: out.to_owned(), names };
        made.list(false)?;
        Ok(made)
    }

    /// All that was to come is there.
    pub fn finish(mut self) -> Result<()> {
        let mut names = std::mem::take(&mut self.names);
        names.retain(|name| self.out.join(name).is_file());
        names.sort();
        names.dedup();
        self.names = names;
        self.list(true)
    }

    fn list(&self, complete: bool) -> Result<()> {
        let ended = if complete { Ended::Finished } else { Ended::Stopped };
        Manifest::of(complete, ended, None, &self.names).write(&self.out)
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
        run(&["table.txt", "ours/a.txt", "ours/seed-2/a.txt", "none"], &[]);
        assert_eq!(manifest(&out).expect("a list").files, ["ours/a.txt", "ours/seed-2/a.txt", "table.txt"]);
        write("ours/mine.txt");
        write("runs/kept.json");
        fs::write(place.path().join("precious"), "mine").expect("writable");
        let all = ["../precious", "/etc/hosts", "ours", "ours/a.txt", "ours/seed-2/a.txt", "table.txt"];
        let listed = all.map(str::to_owned);
        Manifest::of(true, Ended::Finished, None, &listed).write(&out).expect("writable");
        // What is read stays in the list, and goes the next time.
        run(&["table.txt"], &[&out.join("ours")]);
        assert!(out.join("ours/seed-2/a.txt").is_file());
        run(&["table.txt"], &[]);
        let there = |name: &str| out.join(name).exists();
        assert!(!there("ours/a.txt") && !there("ours/seed-2") && there("table.txt"));
        assert!(there("ours/mine.txt") && there("runs/kept.json") && place.path().join("precious").is_file());
        // One that was begun and not finished is known, too.
        drop(InPlace::begin(&out, vec!["table.txt".into(), "half.txt".into()], &[]).expect("begun"));
        write("half.txt");
        run(&["table.txt"], &[]);
        assert!(!there("half.txt"));
        fs::write(out.join(MANIFEST), "[1, 2]").expect("writable");
        assert!(InPlace::begin(&out, vec![], &[]).is_err());
    }
}
