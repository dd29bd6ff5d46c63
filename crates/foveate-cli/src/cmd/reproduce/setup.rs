//! What experiments are run on: digits, sequences, finished runs; and what the command line changes of them.

use std::path::PathBuf;

use foveate::Result;
use foveate::lab::{Digits, Split};

use super::runner::{Entry, Finished, Following, Job, Store};

/// Digits drawn of each class where there is no MNIST.
const DRAWN: usize = 40;

/// What experiments are run on.
pub struct Setup {
    pub digits: Digits,
    /// What the digits are.
    pub from: String,
    /// Whether they are MNIST's.
    pub mnist: bool,
    /// The folder whose `tracking/` has real sequences.
    pub data: PathBuf,
    pub store: Store,
    /// Where files go.
    pub out: PathBuf,
    /// Settings that take the place of those of every configuration.
    pub settings: Vec<String>,
    pub quick: bool,
}

impl Setup {
    /// On the data of a folder; without one, of $FOVEATE_DATA or `data`, or digits drawn by a pen.
    pub fn of(data: Option<PathBuf>, store: Store, out: PathBuf) -> Result<Self> {
        let usual = || std::env::var_os("FOVEATE_DATA").map_or_else(|| "data".into(), PathBuf::from);
        let (given, data) = (data.is_some(), data.unwrap_or_else(usual));
        let (digits, from, mnist) = match Digits::load(&data, Split::Test) {
            Ok(digits) => (digits, "MNIST test digits", true),
            Err(error) if given => return Err(error),
            Err(error) => {
                let note = "digits drawn by a pen, NOT MNIST: figures are not to be compared with those on MNIST";
                note!("foveate: {note} ({error}; --data DIR says where they are)");
                (Digits::drawn(1, DRAWN), note, false)
            }
        };
        Ok(Self { digits, from: from.into(), mnist, data, store, out, settings: vec![], quick: false })
    }

    /// [`Store::runs`] on its digits.
    pub fn runs<R: Finished>(
        &self,
        name: &str,
        entries: &[Entry],
        jobs: &[Job],
        follow: &Following<R>,
    ) -> Result<Vec<Option<R>>> {
        self.store.runs(name, entries, jobs, (&self.digits, &self.from), follow)
    }
}
