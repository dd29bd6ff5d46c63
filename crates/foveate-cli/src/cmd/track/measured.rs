//! What `foveate measure` adds to a run: the files of the measurement.

use std::path::Path;

use foveate::config::Blueprint;
use foveate::lab::measure::{FILES, Follower, Lines, MeasureFiles};
use foveate::report::Observer;
use foveate::report::run::check_box;
use foveate::text::counted;
use foveate::video::{Frame, open_with, without_password};
use foveate::{Error, Result, Seen};

use super::args::{Args, Measure};
use super::init::{Init, first_box};
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
        let mut boxes = Boxes::read_of_size(format, path, Some(about.size()))?;
        boxes.take_notes().iter().for_each(|lost| note!("foveate: {}: {lost}", path.display()));
        let mut targets = boxes.key_frames();
        targets.retain(|_, keys| keys.values().any(Option::is_some));
        let (Some(keys), 1) = (targets.values().next(), targets.len()) else {
            let count = counted(targets.len(), "target");
            return Err(Error::malformed(path, format!("it has {count} with key frames; expected one")));
        };
        // Key frames beyond --until wait for a later run.
        let until = self.until.and_then(|until| usize::try_from(until).ok()).unwrap_or(usize::MAX);
        let drawn =
            keys.iter().filter_map(|(frame, bbox)| Some((*frame, (*bbox)?))).filter(|(frame, _)| *frame < until);
        let Some((first, _)) = drawn.clone().next() else {
            return Err(Error::malformed(path, "it has no box in a frame that is tracked; expected at least one"));
        };
        let end = about.exact_frames().map_or(until, |frames| frames.min(until)).max(first);
        if let Some((gone, _)) = keys.range(first..end).find(|(_, bbox)| bbox.is_none()) {
            return Err(Error::malformed(
                path,
                format!(
                    "the target is outside the picture in frame {}, and measuring follows a target that stays in it; measure each part \
                     on its own, the first with --until {gone}, or delete such key frames",
                    gone + 1
                ),
            ));
        }
        let every = self.input.selection().every;
        for (k, (frame, bbox)) in drawn.enumerate() {
            if (frame - first) % every != 0 {
                let frame = frame + 1;
                return Err(Error::malformed(
                    path,
                    format!("--every {every} leaves out the key frame {frame}; give another step"),
                ));
            }
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
    reference: Option<Follower>,
    /// The points after the first one.
    others: Vec<Follower>,
    /// The results, after the run.
    pub lines: Lines,
}

impl Measured {
    /// Checks a measurement in this source.
    pub(super) fn new(
        (measure, args): (&Measure, &Args),
        (opened, source): (&Opened, &Path),
        many: bool,
        (blueprint, seed): (&Blueprint, u64),
    ) -> Result<Self> {
        if opened.endless {
            let problem = "foveate measure reads files; save the stream to one, and measure that";
            return Err(Error::malformed(source, problem));
        }
        if many {
            let problem = "foveate measure needs points, each with --init; for other targets use foveate track";
            return Err(Error::Invalid(problem.into()));
        }
        let about = opened.source.info();
        let mut measure = measure.clone();
        measure.settings.picture = Some([about.width, about.height]);
        measure.settings.check()?;
        let several = args.init.len() > 1;
        if opened.tiles.is_some() && (several || measure.reference.is_some()) {
            let problem = "--reference and several points need whole pictures, not tiles; give one --init";
            return Err(Error::Invalid(problem.into()));
        }
        for (given, name) in [
            (!args.reinit.is_empty(), "--reinit"),
            (args.save_state.is_some(), "--save-state"),
            (args.regret, "--regret"),
            (args.trace, "--trace"),
        ] {
            if several && given {
                return Err(Error::Invalid(format!("{name} is for one point; leave it out, or give one --init")));
            }
        }
        // The same streams as the first point: each point has the results that it has on its own.
        let mut others = vec![];
        for (i, init) in args.init.iter().enumerate().skip(1) {
            let bbox = first_box(source, Some(*init), &args.input)?;
            check_box(&format!("the first box of point {}", measure.names[i]), &bbox, about)?;
            others.push(Follower::new(blueprint.tracker(seed)?, bbox));
        }
        let mut reference = None;
        if let Some(bbox) = measure.reference {
            check_box("the box of --reference", &bbox, about)?;
            // With another seed than the points: their errors are independent of its errors.
            reference = Some(Follower::new(blueprint.tracker(seed.wrapping_add(1))?, bbox));
        }
        Ok(Self { measure, reference, others, lines: Lines::default() })
    }

    /// Returns whether there are several points.
    pub(super) fn is_several(&self) -> bool {
        !self.others.is_empty()
    }

    /// Starts the files in the folder of the results; they and the other observers receive all points.
    pub(super) fn observers(
        self,
        mut observers: Vec<Box<dyn Observer>>,
        (folder, source, scale): (&Path, &Path, f64),
        failed: &FailedOutputs,
    ) -> Result<Vec<Box<dyn Observer>>> {
        const NAMES: &[&str] = &FILES;
        let source = without_password(&source.display().to_string()).into_owned();
        let Measure { names, settings, .. } = self.measure;
        let mut files = MeasureFiles::create(folder, (source, scale), names, settings, self.lines)?;
        if let Some(reference) = self.reference {
            files = files.relative_to(reference);
        }
        observers.push(failed.tolerate(NAMES, files, usize::MAX));
        if self.others.is_empty() {
            return Ok(observers);
        }
        Ok(vec![Box::new(Points { others: self.others, observers })])
    }
}

/// Follows further points, and calls observers with all of them.
struct Points {
    others: Vec<Follower>,
    observers: Vec<Box<dyn Observer>>,
}

impl Observer for Points {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let mut all = targets.to_vec();
        for (other, id) in self.others.iter_mut().zip(2..) {
            let mut seen = other.follow(frame)?;
            seen.id = id;
            all.push(seen);
        }
        self.observers.observe(frame, &all)
    }

    fn finish(&mut self) -> Result<()> {
        self.observers.finish()
    }
}
