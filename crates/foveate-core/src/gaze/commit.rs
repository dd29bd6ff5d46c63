//! Explore, then commit (Perchet et al., 2016; Garivier et al., 2016): all gazes for a number of frames, then the best of them.
//!
//! While the policy explores, it scores all gazes of a frame with equal weights and adds up their rewards. Then it uses the gaze with the
//! largest sum ([`Policy::committed_gaze`]). The appearance has learned all gazes with one weight vector, or it is trained again under that
//! gaze, from the first frame on. At intervals the policy explores for one frame again, and may change its choice. While the target is
//! lost, it looks at all gazes, too (the paper's conclusions); their rewards then do not count. Use it with a sensor that reads only a part
//! of the target: to read the whole target is expensive, and pays only until the best gaze is known.
//!
//! Deviation: the paper's policies choose anew in every frame. The discriminant ([`Discriminant`](crate::identity::Discriminant)) learns
//! most about what it sees in every frame.

use super::gains::{Gains, GainsState};
use super::{Context, Plan, Policy, PolicySnapshot, Schedule};
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};
use serde_json::json;

/// Scores all gazes for a number of frames, then uses the best of them, and scores all again in every n-th frame and while the target is
/// lost.
#[derive(Clone, Debug)]
pub struct ExploreThenCommit {
    gains: Gains,
    frames: u64,
    /// Frames between two explorations; 0 for no further exploration.
    every: u64,
    /// Frames so far.
    t: u64,
    /// Whether the target is lost in this frame.
    lost: bool,
}

impl ExploreThenCommit {
    /// Creates a policy over these gazes (at least one). It explores for `frames` frames, and later in every `every`-th frame; 0 for
    /// never.
    pub fn new(gazes: Vec<Gaze>, frames: u64, every: u64) -> Result<Self> {
        if gazes.is_empty() {
            return Err(Error::Config("explore-then-commit needs one gaze at least to choose from".into()));
        }
        Ok(Self { gains: Gains::new(gazes, Schedule::Anytime), frames, every, t: 0, lost: false })
    }
    /// Returns whether the rewards of this frame count.
    fn explores(&self) -> bool {
        !self.lost && (self.t < self.frames || self.every > 0 && self.t.is_multiple_of(self.every))
    }
    /// Returns the gaze with the largest reward; among equal ones the one nearest to the centre.
    fn best(&self) -> usize {
        let Gains { gazes, state: GainsState { gain, .. }, .. } = &self.gains;
        let better =
            |a: &usize, b: &usize| gain[*a].total_cmp(&gain[*b]).then(far(&gazes[*b]).total_cmp(&far(&gazes[*a])));
        (0..gazes.len()).max_by(better).expect("one gaze at least")
    }
    /// Gives all gazes equal weights while the policy explores; then uses the best one.
    fn weigh(&mut self) {
        let n = self.gains.gazes.len();
        let best = (self.t >= self.frames).then(|| self.best());
        let share = |k: usize| best.map_or(1.0 / n as f64, |best| f64::from(u8::from(k == best)));
        self.gains.p.iter_mut().enumerate().for_each(|(k, p)| *p = share(k));
    }
}

fn far(gaze: &Gaze) -> f64 {
    gaze.u.hypot(gaze.v)
}

impl Policy for ExploreThenCommit {
    fn plan(&mut self, context: &Context, plan: &mut Plan, _: &mut Rng) {
        self.lost = context.lost;
        let gazes = &self.gains.gazes;
        if !self.lost && !self.explores() {
            return plan.only(gazes[self.best()]);
        }
        plan.clear();
        gazes.iter().for_each(|gaze| plan.weigh(*gaze, 1.0 / gazes.len() as f64));
        let nearest = (0..gazes.len()).min_by(|a, b| far(&gazes[*a]).total_cmp(&far(&gazes[*b])));
        plan.mark(nearest.expect("one gaze at least"));
    }
    fn learn(&mut self, _: &Plan, rewards: &[f64]) {
        let explored = self.explores();
        self.t = self.t.saturating_add(1);
        if explored {
            let gain = &mut self.gains.state.gain;
            assert_eq!(rewards.len(), gain.len(), "one reward for each gaze");
            gain.iter_mut().zip(rewards).for_each(|(gain, reward)| *gain += reward);
            self.gains.count();
        }
        self.weigh();
    }
    fn committed_gaze(&self) -> Option<Gaze> {
        (self.t >= self.frames).then(|| self.gains.gazes[self.best()])
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Arms { gazes: &self.gains.gazes, probabilities: &self.gains.p }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&json!({ "gains": self.gains.state, "t": self.t }))
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        (self.gains.state, self.t) = (saved.part_state("gains", &self.gains)?, saved.part_read("t")?);
        self.weigh();
        Ok(())
    }
    fn reset(&mut self) {
        self.gains.reset();
        self.t = 0;
        self.weigh();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::gaze::Grid;
    use foveate_base::rng::{Purpose, Streams};

    fn policy(frames: u64, every: u64) -> ExploreThenCommit {
        ExploreThenCommit::new(Grid::default().gazes(), frames, every).expect("nine gazes")
    }

    #[test]
    fn it_keeps_the_law() {
        conformance::policy(&|| Box::new(policy(10, 0)));
        conformance::policy(&|| Box::new(policy(10, 7)));
        conformance::policy(&|| Box::new(policy(1000, 1)));
        assert!(ExploreThenCommit::new(vec![], 10, 0).is_err());
    }

    /// All nine gazes for ten frames and in every fifth frame later, otherwise the best one; with equal rewards or no exploration, the
    /// centre.
    #[test]
    fn it_explores_and_then_commits() {
        let (mut plan, mut rng) = (Plan::new(), Streams::new(1, 0).at(0, Purpose::Look).rng(0));
        for (frames, every, best) in [(10, 0, Some(7)), (10, 5, Some(7)), (10, 0, None), (0, 0, None)] {
            let mut it = policy(frames, every);
            for t in 0..20 {
                it.plan(&Context::default(), &mut plan, &mut rng);
                let explores = t < frames || every > 0 && t % every == 0;
                assert_eq!(plan.gazes().len(), if explores { 9 } else { 1 });
                assert!((plan.looks() - 1.0).abs() < 1e-12, "as many looks as one");
                assert_eq!(it.committed_gaze().is_some(), t >= frames);
                let arm = if explores { 4 } else { best.unwrap_or(4) };
                assert_eq!(plan.chosen().arm, Some(arm));
                let reward = |gaze: &Gaze| if gaze.arm == best && explores { 0.6 } else { 0.5 };
                let rewards: Vec<f64> = plan.gazes().iter().map(reward).collect();
                it.learn(&plan, &rewards);
            }
        }
    }

    /// While the target is lost it looks at all gazes and counts no reward; then it returns to the gaze that was best before.
    #[test]
    fn it_looks_at_all_gazes_while_the_target_is_lost() {
        let (mut plan, mut rng) = (Plan::new(), Streams::new(1, 0).at(0, Purpose::Look).rng(0));
        let mut it = policy(4, 5);
        for t in 0..30 {
            let lost = (10..20).contains(&t);
            it.plan(&Context { lost, ..Context::default() }, &mut plan, &mut rng);
            assert_eq!(plan.gazes().len(), if lost || t < 4 || t % 5 == 0 { 9 } else { 1 }, "frame {t}");
            let good = if lost { 2 } else { 7 };
            let rewards: Vec<f64> = plan.gazes().iter().map(|g| f64::from(u8::from(g.arm == Some(good)))).collect();
            it.learn(&plan, &rewards);
            assert!(t < 3 || it.committed_gaze().and_then(|gaze| gaze.arm) == Some(7), "frame {t}");
        }
    }

    /// A gaze that earns more later is chosen later.
    #[test]
    fn it_changes_to_a_better_gaze() {
        let (mut plan, mut rng) = (Plan::new(), Streams::new(1, 0).at(0, Purpose::Look).rng(0));
        let mut it = policy(4, 2);
        let mut chosen = vec![];
        for t in 0..40 {
            it.plan(&Context::default(), &mut plan, &mut rng);
            let good = if t < 8 { 1 } else { 6 };
            let rewards: Vec<f64> = plan.gazes().iter().map(|g| if g.arm == Some(good) { 0.9 } else { 0.1 }).collect();
            it.learn(&plan, &rewards);
            chosen.extend(it.committed_gaze().and_then(|gaze| gaze.arm));
        }
        chosen.dedup();
        assert_eq!(chosen, [1, 6]);
    }
}
