//! What `foveate measure` adds to a run: the files of the measurement.

use std::path::Path;

use foveate::config::Blueprint;
use foveate::lab::measure::{FILES, Lines, MeasureFiles};
use foveate::report::Observer;
use foveate::report::run::check_box;
use foveate::video::without_password;
use foveate::{BBox, Error, Result, Tracker};

use super::args::Measure;
use super::source::Opened;
use super::tolerant::FailedOutputs;

/// A checked measurement.
pub(super) struct Measured {
    measure: Measure,
    /// The tracker of the reference and its first box.
    reference: Option<(Tracker, BBox)>,
    /// The results, after the run.
    pub lines: Lines,
}

impl Measured {
    /// Checks a measurement of one target in this source.
    pub(super) fn new(
        measure: &Measure,
        opened: &Opened,
        many: bool,
        (blueprint, seed): (&Blueprint, u64),
    ) -> Result<Self> {
        if many || opened.endless {
            let problem = "foveate measure needs one target in a file; give one --init, or use foveate track";
            return Err(Error::Invalid(problem.into()));
        }
        let Some(bbox) = measure.reference else {
            return Ok(Self { measure: measure.clone(), reference: None, lines: Lines::default() });
        };
        if opened.tiles.is_some() {
            return Err(Error::Invalid("--reference needs whole pictures, not tiles; leave it out".into()));
        }
        check_box("the box of --reference", &bbox, opened.source.info())?;
        // Its random streams are those of another target.
        let reference = Some((blueprint.tracker_of(seed, 1)?, bbox));
        Ok(Self { measure: measure.clone(), reference, lines: Lines::default() })
    }

    /// Starts the files in the folder of the results.
    pub(super) fn observer(self, folder: &Path, source: &Path, failed: &FailedOutputs) -> Result<Box<dyn Observer>> {
        const NAMES: &[&str] = &FILES;
        let source = without_password(&source.display().to_string()).into_owned();
        let files = MeasureFiles::create(folder, source, self.measure.settings, self.lines)?;
        let files = match self.reference {
            Some((tracker, bbox)) => files.relative_to(tracker, bbox),
            None => files,
        };
        Ok(failed.tolerate(NAMES, files, usize::MAX))
    }
}
