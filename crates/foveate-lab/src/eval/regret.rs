//! regret.csv and regret.svg: the regret against other gazes.

use std::path::Path;

use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_core::Seen;
use foveate_core::config::PolicyConfig;
use foveate_core::gaze::Grid;
use foveate_core::geometry::Gaze;
use foveate_report::Observer;
use foveate_report::chart::{Axis, Chart, Mark, render};
use foveate_report::regret::RegretLog;
use foveate_video::Frame;

/// Number of frames over which plots average rewards.
const WINDOW: usize = 20;

/// Returns the gazes for measuring a policy's regret: 3 × 3 over its reach.
pub fn comparison_gazes(policy: &PolicyConfig) -> Grid {
    Grid { n: 3, reach: reach(policy).unwrap_or(Grid::default().reach) }
}

/// Returns a policy's reach in template units; `None` for a single gaze.
pub fn reach(policy: &PolicyConfig) -> Option<f64> {
    match policy {
        PolicyConfig::Random { grid }
        | PolicyConfig::Circular { grid }
        | PolicyConfig::Hedge { grid, .. }
        | PolicyConfig::Pool { grid, .. }
        | PolicyConfig::ExploreThenCommit { grid, .. } => Some(grid.reach),
        PolicyConfig::Exp3(c) => Some(c.grid.reach),
        PolicyConfig::Exp3AsPrinted(c) => Some(c.grid.reach),
        PolicyConfig::Exp3Ix(c) => Some(c.grid.reach),
        PolicyConfig::Exp3S(c) => Some(c.grid.reach),
        PolicyConfig::GpUcb(bayes) => Some(bayes.reach),
        PolicyConfig::Anchor { policy } => reach(policy),
        // A fixed gaze, or a user-defined policy.
        _ => None,
    }
}

/// Records the rewards of the policy's gaze and of fixed ones. At the end, when the best fixed gaze is known, writes the regret
/// ([`RegretLog::csv`]) and its plot. The sums continue over restarts of the target.
///
/// The gazes must be scored: [`foveate_core::config::Blueprint::shadowing`].
#[derive(Debug)]
pub struct RegretFiles {
    log: RegretLog,
    table: Sink,
    plot: Sink,
    finished: bool,
}

impl RegretFiles {
    /// Starts regret.csv and regret.svg in a folder. Fails if it cannot be written.
    pub fn create(folder: &Path, gazes: Vec<Gaze>) -> Result<Self> {
        let sink = |name: &str| Sink::create(folder.join(name));
        let (table, plot) = (sink("regret.csv")?, sink("regret.svg")?);
        Ok(Self { log: RegretLog::new(gazes), table, plot, finished: false })
    }
    /// Returns the current log.
    pub fn log(&self) -> &RegretLog {
        &self.log
    }
}

impl Observer for RegretFiles {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        targets.iter().filter(|seen| !seen.is_given()).try_for_each(|seen| self.log.enter(frame, seen))
    }
    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            self.table.write(self.log.csv().as_bytes())?;
            self.plot.write(plot(&self.log).as_bytes())?;
        }
        self.table.finish().and(self.plot.finish())
    }
}

/// Plots rewards and cumulative regret over the frames, as SVG text.
pub fn plot(log: &RegretLog) -> String {
    let regret = log.regret().unwrap_or_default();
    let k = log.gazes().len().max(1) as f64;
    let of = |reward: &dyn Fn(usize) -> f64| smooth(&(0..log.frames()).map(reward).collect::<Vec<_>>());
    let best = log.gazes().get(regret.best).copied().unwrap_or(Gaze::CENTRE);
    let line = |name: &str, values: &[f64], colour, dash| {
        let points = log.numbers().iter().zip(values).map(|(t, v)| (*t as f64, *v));
        Mark::line(colour, 2.0, points).dashed(dash).named(name)
    };
    let [fixed, policy, spread] = [("#D55E00", "8 4"), ("#0072B2", "none"), ("#000000", "2 3")];
    let best_name = format!("best fixed, ({:.2}, {:.2})", best.u, best.v);
    let mean = |t: usize| log.offered(t).iter().sum::<f64>() / k;
    let rewards = vec![
        line(&best_name, &of(&|t| log.offered(t)[regret.best]), fixed.0, fixed.1),
        line("the policy", &of(&|t| log.earned()[t]), policy.0, policy.1),
        line("mean of all gazes", &of(&mean), spread.0, spread.1),
    ];
    let sums = vec![
        line("the policy", &regret.cumulative, policy.0, policy.1),
        line("a gaze at random", &regret.at_random, spread.0, spread.1),
    ];
    let chart = |title: String, y_label: &str, marks| {
        let (x, y) = (Axis::new("frame"), Axis::new(y_label));
        Chart { title, x, y, marks }
    };
    let charts = [
        chart(format!("Reward, mean of the last {WINDOW} frames"), "reward of a look", rewards),
        chart("Regret against the best fixed gaze in hindsight".into(), "summed regret", sums),
    ];
    render(&charts, 2, [640.0, 400.0])
}

/// Returns the mean of each value and those before it, at most [`WINDOW`].
fn smooth(values: &[f64]) -> Vec<f64> {
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    (0..values.len()).map(|t| mean(&values[(t + 1).saturating_sub(WINDOW)..=t])).collect()
}
