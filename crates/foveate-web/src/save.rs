//! report.html: the track is run once more, some frames at a time, as `foveate track` does it.

use std::collections::BTreeMap;

use foveate_base::sink::{Memory, Sink};
use foveate_base::{Error, Result};
use foveate_core::Tracker;
use foveate_core::geometry::BBox;
use foveate_report::interactive::{Frames, Setup};
use foveate_report::{Observer, Report, RunInfo};

/// A report in the making.
pub struct Saving {
    tracker: Tracker,
    player: Box<dyn Frames>,
    report: Report,
    out: Memory,
    given: BTreeMap<usize, BBox>,
    next: usize,
    last: usize,
    /// Frames so far.
    pub count: usize,
    /// The page, once it is whole.
    pub page: Option<Vec<u8>>,
}

impl Saving {
    pub fn begin(
        setup: &Setup,
        info: RunInfo,
        player: Box<dyn Frames>,
        given: BTreeMap<usize, BBox>,
        last: usize,
    ) -> Result<Self> {
        let first = given.keys().next().copied();
        let first = first.ok_or_else(|| Error::Invalid("there is no track yet; start one".into()))?;
        let (tracker, out) = (setup.blueprint.tracker(setup.seed)?, Memory::default());
        let report = Report::to(Sink::memory("report.html", out.clone()), info);
        Ok(Self { tracker, player, report, out, given, next: first, last, count: 0, page: None })
    }

    /// Goes on for at most so many frames.
    pub fn go_on(&mut self, frames: usize) -> Result<()> {
        for _ in 0..frames {
            if self.page.is_some() {
                break;
            }
            let frame = if self.next <= self.last { self.player.frame(self.next)? } else { None };
            let Some(frame) = frame else {
                self.report.finish()?;
                self.page = Some(self.out.take());
                break;
            };
            match self.given.get(&self.next) {
                Some(bbox) => {
                    self.tracker.init(&frame.image, *bbox)?;
                    self.report.start(&frame, bbox)?;
                }
                None => {
                    let seen = self.tracker.update(&frame.image)?;
                    self.report.observe(&frame, &seen.step)?;
                }
            }
            self.next += 1;
            self.count += 1;
        }
        Ok(())
    }
}
