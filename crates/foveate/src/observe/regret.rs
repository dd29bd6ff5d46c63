//! regret.csv and regret.svg: what looking elsewhere would have earned.

use std::path::Path;

use super::Observer;
use super::sink::Sink;
use crate::Result;
use crate::eval::regret::Ledger;
use crate::geometry::{BBox, Gaze};
use crate::scene::Frame;
use crate::step::Step;

/// Keeps the rewards of the policy's gaze and of fixed ones; at the end, when it is known which fixed gaze was best,
/// writes the regret ([`Ledger::csv`]) and its plot. The sums go on where the target is given again.
///
/// The gazes must be scored: [`crate::config::Blueprint::shadowing`].
#[derive(Debug)]
pub struct RegretFiles {
    ledger: Ledger,
    table: Sink,
    plot: Sink,
    finished: bool,
}

impl RegretFiles {
    /// Starts regret.csv and regret.svg in a folder. Fails where it cannot be written.
    pub fn create(folder: &Path, gazes: Vec<Gaze>) -> Result<Self> {
        let sink = |name: &str| Sink::create(folder.join(name));
        let (table, plot) = (sink("regret.csv")?, sink("regret.svg")?);
        Ok(Self { ledger: Ledger::new(gazes), table, plot, finished: false })
    }
    /// What was entered so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }
}

impl Observer for RegretFiles {
    fn start(&mut self, _: &Frame, _: &BBox) -> Result<()> {
        Ok(())
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.ledger.enter(step)
    }
    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            self.table.write(self.ledger.csv().as_bytes())?;
            self.plot.write(self.ledger.plot().as_bytes())?;
        }
        self.table.finish().and(self.plot.finish())
    }
}
