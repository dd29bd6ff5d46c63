//! report.html and annotated.mp4: the track is run once more, some frames at a time, as `foveate track` does it.

use std::collections::BTreeMap;

use foveate_base::sink::{Memory, Sink};
use foveate_base::{Error, Result};
use foveate_core::Tracker;
use foveate_core::geometry::BBox;
use foveate_report::interactive::{Frames, Setup};
use foveate_report::{Film, Observer, Report, RunInfo};

/// What is to be made.
#[derive(Clone, Copy)]
pub struct Wanted {
    pub report: bool,
    pub film: bool,
}

/// Files in the making.
pub struct Saving {
    tracker: Tracker,
    player: Box<dyn Frames>,
    making: Vec<(&'static str, Box<dyn Observer + Send>, Memory)>,
    given: BTreeMap<usize, BBox>,
    next: usize,
    last: usize,
    /// Frames so far.
    pub count: usize,
    /// Names and bytes, once they are whole.
    pub files: Option<Vec<(&'static str, Vec<u8>)>>,
}

impl Saving {
    pub fn begin(
        wanted: Wanted,
        setup: &Setup,
        info: RunInfo,
        player: Box<dyn Frames>,
        given: BTreeMap<usize, BBox>,
        last: usize,
    ) -> Result<Self> {
        let first = given.keys().next().copied();
        let first = first.ok_or_else(|| Error::Invalid("there is no track yet; start one".into()))?;
        let tracker = setup.blueprint.tracker(setup.seed)?;
        let mut making: Vec<(&'static str, Box<dyn Observer + Send>, Memory)> = vec![];
        if wanted.film {
            let (name, out) = ("annotated.mp4", Memory::default());
            making.push((name, Box::new(Film::to(out.clone(), name, &info)), out));
        }
        if wanted.report {
            let (name, out) = ("report.html", Memory::default());
            making.push((name, Box::new(Report::to(Sink::memory(name, out.clone()), info)), out));
        }
        Ok(Self { tracker, player, making, given, next: first, last, count: 0, files: None })
    }

    /// Goes on for at most so many frames.
    pub fn go_on(&mut self, frames: usize) -> Result<()> {
        for _ in 0..frames {
            if self.files.is_some() {
                break;
            }
            let frame = if self.next <= self.last { self.player.frame(self.next)? } else { None };
            let Some(frame) = frame else {
                let finished = self.making.drain(..).map(|(name, mut file, out)| {
                    file.finish()?;
                    Ok((name, out.take()))
                });
                self.files = Some(finished.collect::<Result<_>>()?);
                break;
            };
            let mut files = self.making.iter_mut().map(|(_, file, _)| file);
            match self.given.get(&self.next) {
                Some(bbox) => {
                    self.tracker.init(&frame.image, *bbox)?;
                    files.try_for_each(|file| file.start(&frame, bbox))?;
                }
                None => {
                    let seen = self.tracker.update(&frame.image)?;
                    files.try_for_each(|file| file.observe(&frame, &seen))?;
                }
            }
            self.next += 1;
            self.count += 1;
        }
        Ok(())
    }
}
