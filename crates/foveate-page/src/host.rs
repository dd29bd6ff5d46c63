//! What differs between the programs that show the page.

use std::path::PathBuf;
use std::time::Duration;

use foveate_base::Result;
use foveate_core::config::{BUILTIN, Config, OFFERED, about};
use serde_json::{Value, json};

use crate::player::Frames;
use crate::tracking::Setup;

/// A program that shows the page.
pub trait Host: Sized + Sync {
    /// Videos as this host opens them.
    type Video: Video;
    /// The text files that are offered of a video, of [`FILES`](crate::FILES).
    const TEXTS: &[&str];

    /// Time since a fixed moment; zero always where there is no clock. One message to track takes no longer than 60 ms by it.
    fn now() -> Duration;

    /// What the page begins with: `pick`, whether a box is only to be reported; `roots`, folders and videos to choose from;
    /// `configs`, as [`offered`] gives them; `config` and `policy`, which are chosen at first.
    ///
    /// # Errors
    /// The list of videos cannot be read.
    fn hello(&self) -> Result<Value>;

    /// What to track with: a configuration by its name, with another policy or seed where they are given.
    ///
    /// # Errors
    /// The page may not ask for it, or it does not fit.
    fn setup(&self, config: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup>;

    /// A new folder for results, which the session removes; `None` keeps them in memory.
    ///
    /// # Errors
    /// It cannot be made.
    fn folder(&self) -> Result<Option<PathBuf>> {
        Ok(None)
    }

    /// Runs work on the threads that answer messages.
    fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        work()
    }
}

/// A video that is open.
pub trait Video: Send {
    /// Its frames, to be looked at.
    fn frames(&mut self) -> &mut dyn Frames;
    /// A new reader of its frames.
    fn reader(&self) -> Box<dyn Frames>;
    /// A new reader for the tracker.
    fn tracked(&self) -> Box<dyn Frames> {
        self.reader()
    }
    /// Bits a second, where it is a file.
    fn bit_rate(&self) -> Option<f64> {
        None
    }
}

/// The shipped configurations for one target, of those that fit, by purpose: group, name, title, and use.
pub fn offered(fits: impl Fn(Config) -> bool) -> Vec<Value> {
    let single = |config: Config| config.multi_target.is_none() && fits(config);
    let all = OFFERED.iter().flat_map(|(group, some)| some.iter().map(move |(name, title)| (group, name, title)));
    all.filter_map(|(group, name, title)| {
        let (_, text) = BUILTIN.iter().find(|builtin| builtin.0 == *name)?;
        Config::parse(text, name)
            .is_ok_and(&single)
            .then(|| json!({ "group": group, "name": name, "title": title, "for": about(text) }))
    })
    .collect()
}
