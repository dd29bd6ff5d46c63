//! Regret: the difference between other gazes' rewards and the policy's.
//!
//! A [`RegretLog`] holds the reward of the policy's own gaze in each frame, and the rewards of some fixed gazes in the same frames, scored
//! by [`foveate_core::gaze::Shadow`]. The best fixed gaze is known only in hindsight: it has the largest sum over all frames, argmaxₖ Σₜ
//! rₜ(k). Regret is its reward minus the policy's, per frame and cumulative (section 4.2; theorem 2.2 of Cesa-Bianchi & Lugosi 2006 bounds
//! it for Hedge).
//!
//! All gazes are scored under the belief that results from the policy's own gazes. Regret does not predict the track with another gaze in
//! every frame: run the tracker with that gaze instead.

use crate::columns::REGRET;
use crate::csv::Rows;
use foveate_base::{Error, Result};
use foveate_core::Seen;
use foveate_core::geometry::Gaze;
use foveate_video::Frame;

/// The rewards of a run: of the policy's own gaze, and of some fixed gazes, frame by frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegretLog {
    gazes: Vec<Gaze>,
    frames: Vec<usize>,
    chosen: Vec<Gaze>,
    earned: Vec<f64>,
    /// One reward per gaze, frame after frame.
    offered: Vec<f64>,
}

/// Regret against the best fixed gaze of all frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Regret {
    /// Index of the best fixed gaze; the first of several.
    pub best: usize,
    /// Its reward minus the policy's in each frame, −1 to 1; one value per frame.
    pub instantaneous: Vec<f64>,
    /// Cumulative regret: the sum up to and including each frame.
    pub cumulative: Vec<f64>,
    /// Expected cumulative regret of a policy that draws a fixed gaze uniformly at random.
    pub at_random: Vec<f64>,
    /// Cumulative regret against the best gaze so far; its last value is that of `cumulative`.
    pub until_then: Vec<f64>,
}

impl RegretLog {
    /// Creates an empty log with these fixed gazes.
    pub fn new(gazes: Vec<Gaze>) -> Self {
        Self { gazes, ..Self::default() }
    }
    /// Returns the fixed gazes.
    pub fn gazes(&self) -> &[Gaze] {
        &self.gazes
    }
    /// Returns the numbers of the logged frames, counted from 1.
    pub fn numbers(&self) -> &[usize] {
        &self.frames
    }
    /// Returns the number of logged frames.
    pub fn frames(&self) -> usize {
        self.earned.len()
    }
    /// Returns the policy's reward in each frame, 0 to 1.
    pub fn earned(&self) -> &[f64] {
        &self.earned
    }
    /// Returns the rewards of the fixed gazes in frame `t` of the log, counted from 0; one per gaze, 0 to 1.
    ///
    /// # Panics
    /// The log has no such frame.
    pub fn offered(&self, t: usize) -> &[f64] {
        &self.offered[t * self.gazes.len()..][..self.gazes.len()]
    }

    /// Adds a frame. Of the gazes used, the policy's chosen gaze counts.
    ///
    /// # Errors
    /// A fixed gaze was not scored in this frame; the log stays unchanged.
    pub fn enter(&mut self, frame: &Frame, seen: &Seen<'_>) -> Result<()> {
        let offered = self.offered.len();
        for gaze in &self.gazes {
            let Some(reward) = seen.reward_of(*gaze) else {
                self.offered.truncate(offered);
                return Err(Error::Invalid(format!(
                    "regret needs the reward of gaze ({}, {}) in every frame, and frame {} has none; have these gazes \
                     scored with Blueprint::shadowing",
                    gaze.u,
                    gaze.v,
                    frame.index + 1
                )));
            };
            self.offered.push(reward);
        }
        self.frames.push(frame.index + 1);
        self.chosen.push(seen.plan.chosen());
        self.earned.push(seen.rewards[seen.plan.chosen_index()]);
        Ok(())
    }

    /// Adds a frame by plain numbers: its number counted from 1, the policy's gaze and reward, and one reward per fixed gaze.
    ///
    /// # Panics
    /// There is not one reward for each fixed gaze.
    pub fn push(&mut self, frame: usize, chosen: Gaze, earned: f64, offered: &[f64]) {
        assert_eq!(offered.len(), self.gazes.len(), "one reward for each gaze");
        self.frames.push(frame);
        self.chosen.push(chosen);
        self.earned.push(earned);
        self.offered.extend_from_slice(offered);
    }

    /// Returns the regret; `None` if there is no frame or no gaze.
    pub fn regret(&self) -> Option<Regret> {
        if self.gazes.is_empty() || self.earned.is_empty() {
            return None;
        }
        let mut sums = vec![0.0; self.gazes.len()];
        let (mut own, mut until_then) = (0.0, Vec::with_capacity(self.frames()));
        for (t, earned) in self.earned.iter().enumerate() {
            sums.iter_mut().zip(self.offered(t)).for_each(|(sum, r)| *sum += r);
            own += earned;
            until_then.push(sums.iter().copied().fold(f64::NEG_INFINITY, f64::max) - own);
        }
        let greatest = sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let best = sums.iter().position(|sum| *sum >= greatest).unwrap_or(0);
        let k = self.gazes.len() as f64;
        let behind = |t: usize, other: f64| self.offered(t)[best] - other;
        let instantaneous: Vec<f64> = (0..self.frames()).map(|t| behind(t, self.earned[t])).collect();
        let random = (0..self.frames()).map(|t| behind(t, self.offered(t).iter().sum::<f64>() / k));
        Some(Regret {
            best,
            cumulative: summed(instantaneous.iter().copied()),
            at_random: summed(random),
            instantaneous,
            until_then,
        })
    }

    /// Returns regret.csv: a header and one line per frame, with the columns [`REGRET`] and one reward column per fixed gaze.
    pub fn csv(&self) -> String {
        let fixed = REGRET[..REGRET.len() - 1].iter().map(|column| column.name.to_owned());
        let mut rows = Rows::new(fixed.chain(self.gazes.iter().map(|g| format!("reward_{}_{}", g.u, g.v))));
        if let Some(regret) = self.regret() {
            for t in 0..self.frames() {
                let (Gaze { u, v, .. }, offered) = (self.chosen[t], self.offered(t));
                rows.put(self.frames[t]);
                rows.put_all(&[u, v, self.earned[t], offered[regret.best]]);
                rows.put_all(&[regret.instantaneous[t], regret.cumulative[t], regret.until_then[t]]);
                rows.put_all(offered);
                rows.end();
            }
        }
        rows.text
    }
}

/// Returns the cumulative sums of the values.
fn summed(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    values
        .map(|value| {
            sum += value;
            sum
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use foveate_core::gaze::{Context, Grid, Hedge, Plan, Policy};
    use rand::RngExt;

    #[test]
    fn regret_is_what_brute_force_says() {
        let gazes = Grid::default().gazes();
        let mut rng = Streams::new(4, 0).rng(0);
        let mut log = RegretLog::new(gazes.clone());
        assert!(log.regret().is_none());
        let (mut rewards, mut choices) = (vec![], vec![]);
        for t in 0..60 {
            let offered: Vec<f64> = (0..9).map(|_| rng.random()).collect();
            let chosen = rng.random_range(0..9);
            log.push(t + 2, gazes[chosen], offered[chosen], &offered);
            rewards.push(offered);
            choices.push(chosen);
        }
        let regret = log.regret().expect("sixty frames");
        let total = |k: usize, until: usize| rewards[..until].iter().map(|r| r[k]).sum::<f64>();
        let own = |until: usize| (0..until).map(|t| rewards[t][choices[t]]).sum::<f64>();
        assert!((0..9).all(|k| total(k, 60) <= total(regret.best, 60)));
        for t in 0..60 {
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "frame {t}: {a} {b}");
            near(regret.instantaneous[t], rewards[t][regret.best] - rewards[t][choices[t]]);
            near(regret.cumulative[t], total(regret.best, t + 1) - own(t + 1));
            near(regret.until_then[t], (0..9).map(|k| total(k, t + 1)).fold(0.0, f64::max) - own(t + 1));
            near(regret.at_random[t], total(regret.best, t + 1) - (0..9).map(|k| total(k, t + 1)).sum::<f64>() / 9.0);
        }
        assert!((regret.cumulative[59] - regret.until_then[59]).abs() < 1e-12);
        let text = log.csv();
        let last: Vec<f64> =
            text.lines().last().expect("a line").split(',').map(|v| v.parse().expect("a number")).collect();
        assert_eq!((text.lines().count(), last.len(), last[0]), (61, 8 + 9, 61.0));
        assert_eq!(last[6], regret.cumulative[59], "numbers read back");
        assert_eq!(last[8..], rewards[59][..]);
    }

    /// Rewards of 0 and 1 that favour each gaze in turn for 50 frames; 20 runs of 1,000 frames, seeds 0 to 19. The bound holds for the
    /// expectation; a run deviates by less than √T / 2 = 16, and 4 standard deviations of a mean over 20 are 14.
    #[test]
    fn hedge_keeps_its_bound_here_too() {
        let (frames, gazes) = (1000, Grid::default().gazes());
        let mut sum = 0.0;
        for seed in 0..20 {
            let mut rng = Streams::new(seed, 0).at(0, Purpose::Look).rng(0);
            let mut hedge = Hedge::new(gazes.clone(), Hedge::gamma_for(9, frames)).expect("nine gazes");
            let (mut log, mut plan) = (RegretLog::new(gazes.clone()), Plan::new());
            for t in 0..frames {
                hedge.plan(&Context::default(), &mut plan, &mut rng);
                let rewards: Vec<f64> = (0..9).map(|k| if k == (t / 50) % 9 { 1.0 } else { 0.0 }).collect();
                log.push(t + 1, plan.chosen(), rewards[plan.chosen_index()], &rewards);
                hedge.learn(&plan, &rewards);
            }
            sum += log.regret().expect("frames").cumulative[frames - 1];
        }
        let bound = (frames as f64 * 9.0f64.ln() / 2.0).sqrt();
        assert!(sum / 20.0 < bound + 14.0, "{} is above {bound}", sum / 20.0);
    }
}
