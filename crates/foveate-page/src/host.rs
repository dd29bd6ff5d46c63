//! The interface to the programs that show the page.

use std::path::PathBuf;
use std::time::Duration;

use foveate_base::Result;
use foveate_core::config::{BUILTIN, Config, OFFERED, about};
use serde_json::{Value, json};

use crate::player::Frames;
use crate::tracking::Setup;

/// A program that shows the page.
pub trait Host: Sized + Sync {
    /// A video as this host opens it.
    type Video: Video;
    /// The text files that are offered for a video, from [`FILES`](crate::FILES).
    const TEXTS: &[&str];

    /// Returns the time since a fixed moment, or always zero without a clock. It limits one tracking message to 60 ms.
    fn now() -> Duration;

    /// Returns the initial settings of the page: `pick`, whether a box is only reported; `roots`, the available folders and videos;
    /// `configs`, from [`offered`]; `config` and `policy`, the initial selection.
    ///
    /// # Errors
    /// The list of videos cannot be read.
    fn hello(&self) -> Result<Value>;

    /// Returns the tracking setup: a named configuration, with another policy or seed if given.
    ///
    /// # Errors
    /// The page may not use it, or it does not fit.
    fn setup(&self, config: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup>;

    /// Creates a new folder for results, which the session removes; `None` keeps them in memory.
    ///
    /// # Errors
    /// The folder cannot be created.
    fn folder(&self) -> Result<Option<PathBuf>> {
        Ok(None)
    }

    /// Runs work on the threads that answer messages.
    fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        work()
    }
}

/// An open video.
pub trait Video: Send {
    /// Returns its frames, for display.
    fn frames(&mut self) -> &mut dyn Frames;
    /// Returns a new reader of its frames.
    fn reader(&self) -> Box<dyn Frames>;
    /// Returns a new reader for the tracker.
    fn tracked(&self) -> Box<dyn Frames> {
        self.reader()
    }
    /// Returns the bit rate of a file, bits per second.
    fn bit_rate(&self) -> Option<f64> {
        None
    }
}

/// Returns the shipped configurations for one target that satisfy `fits`, by purpose: group, name, title, and use.
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
