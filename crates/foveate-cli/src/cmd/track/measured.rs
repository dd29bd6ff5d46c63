//! What `foveate measure` adds to a run: the files of the measurement.

use std::path::Path;

use foveate::config::Blueprint;
use foveate::lab::measure::{FILES, Lines, MeasureFiles};
use foveate::report::Observer;
use foveate::report::run::check_box;
use foveate::text::counted;
use foveate::video::{open_with, without_password};
use foveate::{BBox, Error, Result, Tracker};

use super::args::{Args, Measure};
use super::init::Init;
use super::source::{Opened, is_endless};
use super::tolerant::FailedOutputs;
use crate::cmd::convert::{Boxes, Format};
use crate::cmd::of_file;

impl Args {
    /// Starts the target at the first box of a file, and restarts it at the others.
    pub(crate) fn start_at_key_frames(&mut self, path: &Path, format: Format) -> Result<()> {
        let [source] = &self.sources[..] else {
            return Err(Error::Invalid(
                "--keyframes has the boxes of one video; measure the others on their own".into(),
            ));
        };
        if is_endless(source) {
            return Err(Error::Invalid("--keyframes needs a file, not a stream; give --init".into()));
        }
        let about = open_with(source, &self.input.options())?.info().clone();
        let targets = Boxes::read_of_size(format, path, Some(about.size()))?.key_frames();
        let (Some(keys), 1) = (targets.values().next(), targets.len()) else {
            let count = counted(targets.len(), "target");
            return Err(Error::malformed(path, format!("it has {count} with key frames; expected one")));
        };
        for (k, (frame, bbox)) in keys.iter().filter_map(|(frame, bbox)| Some((*frame, (*bbox)?))).enumerate() {
            check_box(&format!("the box in frame {}", frame + 1), &bbox, &about).map_err(of_file(path))?;
            let bbox = self.input.scaled(&bbox);
            if k == 0 {
                self.init = vec![Init::Given(bbox)];
                self.input.start_at(frame);
            } else {
                self.reinit.push((frame + 1, bbox));
            }
        }
        Ok(())
    }
}

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
        let size = opened.source.info().size();
        if let Some([width, height]) = measure.settings.lens.and_then(|lens| lens.size)
            && (width, height) != (size.width, size.height)
        {
            return Err(Error::Invalid(format!(
                "--lens: it was calibrated with pictures of {width} x {height}, these are {} x {}; give the calibration of this size",
                size.width, size.height
            )));
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
