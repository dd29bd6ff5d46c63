//! WHERE TO LOOK? Policies over gazes, which learn from rewards (section 4).
//!
//! A [`Policy`] writes a [`Plan`]: the gazes to score, and those among them that move the belief. A plan contains all gazes (full
//! information: Hedge) or one (partial information: baselines, bandits). A policy receives gazes and rewards, never pixels.

/// Implements learning and state of a policy by those of the policy in one of its fields.
macro_rules! learned_by {
    ($field:ident) => {
        fn snapshot(&self) -> $crate::gaze::PolicySnapshot<'_> {
            self.$field.snapshot()
        }
        fn save(&self) -> $crate::saved_state::SavedState {
            self.$field.save()
        }
        fn load(&mut self, saved: &$crate::saved_state::SavedState) -> foveate_base::Result<()> {
            self.$field.load(saved)
        }
        fn reset(&mut self) {
            self.$field.reset();
        }
        fn expectation(&self) -> Option<$crate::gaze::Expectation> {
            self.$field.expectation()
        }
        fn init_prior(&mut self, worth: &mut dyn FnMut($crate::geometry::Gaze) -> f64) {
            self.$field.init_prior(worth);
        }
    };
}

mod anchor;
mod baseline;
mod bayes;
mod commit;
mod exp3;
mod gains;
mod gp_ucb;
mod grid;
mod hedge;
mod pool;
mod prior;
mod schedule;
mod shadow;

pub use self::anchor::Anchor;
pub use self::baseline::{Circular, Fixed, Random};
pub use self::bayes::Bayes;
pub use self::commit::ExploreThenCommit;
pub use self::exp3::{Exp3, Variant};
pub use self::gp_ucb::GpUcb;
pub use self::grid::Grid;
pub use self::hedge::Hedge;
pub use self::pool::Pool;
pub use self::schedule::Schedule;
pub use self::shadow::Shadow;

use crate::geometry::Gaze;
use crate::saved_state::{SavedState, refused};
use foveate_base::Result;
use foveate_base::rng::Rng;
use serde::{Deserialize, Serialize};

/// The gazes of one frame: each is scored, the used ones move the belief, and one is the policy's own choice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    gazes: Vec<Gaze>,
    weights: Vec<f64>,
    marked: Option<usize>,
    recorded: Vec<Gaze>,
}

impl Plan {
    /// Creates an empty plan.
    pub const fn new() -> Self {
        Self { gazes: Vec::new(), weights: Vec::new(), marked: None, recorded: Vec::new() }
    }
    /// Removes all gazes; keeps the memory.
    pub fn clear(&mut self) {
        self.gazes.clear();
        self.weights.clear();
        self.marked = None;
        self.recorded.clear();
    }
    /// Plans one gaze, and uses it.
    pub fn only(&mut self, gaze: Gaze) {
        self.clear();
        self.weigh(gaze, 1.0);
    }
    /// Plans all of `gazes`, and uses the one at `chosen`.
    pub fn all(&mut self, gazes: &[Gaze], chosen: usize) {
        assert!(chosen < gazes.len(), "gaze {chosen} of {} cannot be chosen", gazes.len());
        self.clear();
        for (k, &gaze) in gazes.iter().enumerate() {
            self.weigh(gaze, f64::from(u8::from(k == chosen)));
        }
    }
    /// Adds one gaze. `weight` multiplies its log-likelihood, finite and at least 0; at 0 the gaze is only scored.
    pub fn weigh(&mut self, gaze: Gaze, weight: f64) {
        self.gazes.push(gaze);
        self.weights.push(weight);
    }
    /// Uses the gaze at `k` too, with a weight of at least 1.
    pub fn use_also(&mut self, k: usize) {
        self.weights[k] = self.weights[k].max(1.0);
    }
    /// Sets which of the used gazes is the policy's own choice; by default it is the first used one.
    pub fn mark(&mut self, k: usize) {
        assert!(self.weights[k] > 0.0, "the choice must be one of the used gazes");
        self.marked = Some(k);
    }
    /// Records the reward of a gaze for observers only: it neither moves the belief nor reaches `learn`.
    pub fn record(&mut self, gaze: Gaze) {
        self.recorded.push(gaze);
    }
    /// Returns the gazes that are recorded for observers only.
    pub fn recorded(&self) -> &[Gaze] {
        &self.recorded
    }
    /// Returns the gazes to score, in the order of the rewards.
    pub fn gazes(&self) -> &[Gaze] {
        &self.gazes
    }
    /// Returns the gazes that move the belief, at least one, with their indices.
    pub fn used(&self) -> impl Iterator<Item = (usize, Gaze)> {
        let all = self.gazes.iter().copied().zip(&self.weights).enumerate();
        all.filter(|(_, (_, weight))| **weight > 0.0).map(|(k, (gaze, _))| (k, gaze))
    }
    /// Returns the factor of each gaze's log-likelihood: 1 for a used gaze, 0 for a gaze that is only scored, any other value if the
    /// policy weighs its gazes.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
    /// Returns the sum of the weights of the used gazes: the effective number of looks.
    pub fn looks(&self) -> f64 {
        self.weights.iter().sum()
    }
    /// Returns the index of the policy's own choice. Panics if no gaze is used, which a policy must not cause.
    pub fn chosen_index(&self) -> usize {
        let first = || self.used().next().expect("a plan uses one gaze at least").0;
        self.marked.unwrap_or_else(first)
    }
    /// Returns the policy's own choice, which is reported as the gaze.
    pub fn chosen(&self) -> Gaze {
        self.gazes[self.chosen_index()]
    }
}

/// The confidence of the tracker at the end of the previous frame, against which a policy may weigh exploration (the paper's last
/// paragraph). [`Default`] is the context of the first frame, with full confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Context {
    /// Effective sample size as a fraction of the particles, above 0 to 1.
    pub ess: f64,
    /// Evidence deficit: 0 if the looks fit as on the target, 1 if they fit as elsewhere; smoothed over frames, 0 to 2.
    pub deficit: f64,
    /// Evidence deficit of the last frame alone, 0 to 2.
    pub frame_deficit: f64,
    /// Standard deviation of the belief about place, in template units (1 is half the target's box).
    pub spread: f64,
    /// Whether the tracker searches for a lost target.
    pub lost: bool,
}

impl Default for Context {
    fn default() -> Self {
        Self { ess: 1.0, deficit: 0.0, frame_deficit: 0.0, spread: 0.0, lost: false }
    }
}

/// The reward surface over the template that a policy has estimated.
pub trait Surface: Sync {
    /// Half the side of its square of gazes, template units.
    fn reach(&self) -> f64;
    /// Mean and standard deviation of the estimated reward of looking at (u, v).
    fn at(&self, u: f64, v: f64) -> (f64, f64);
    /// The gazes that it was estimated from, oldest first.
    fn fixations(&self) -> &[Gaze];
    /// The gaze with the largest mean; `None` before the first reward.
    fn best(&self) -> Option<Gaze>;
}

/// The learned state of a policy, for display.
#[derive(Clone, Copy)]
pub enum PolicySnapshot<'a> {
    /// Nothing to show.
    Blank,
    /// The probability of each gaze in the next frame, or its share of the weights if all are used; the values sum to 1.
    Arms {
        /// The gazes.
        gazes: &'a [Gaze],
        /// One probability for each gaze.
        probabilities: &'a [f64],
    },
    /// The estimated reward of each gaze of a continuous space, computed on demand.
    Surface(&'a dyn Surface),
}

foveate_base::opaque_debug!(PolicySnapshot<'a>);

/// The kind of prior that a policy computes before the first look, from the picture in which the target is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expectation {
    /// Saliency at the place of a gaze (Itti, Koch and Niebur).
    Saliency,
    /// The reward of a gaze on that picture with an uncertain place of the target: how well the gaze localises it.
    Rehearsal,
}

/// Chooses gazes, and learns from their rewards.
///
/// Each frame calls `plan` once, then `learn` once with that plan. `plan` must use at least one gaze and draw from `rng` alone. `save` and
/// `load` must carry everything learned, bit for bit: a policy that loads a state continues exactly as the policy that saved it.
pub trait Policy: Send + Sync {
    /// Replaces the plan by the gazes of the next frame. Most policies ignore the context.
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng);
    /// Learns from rewards in [0, 1]; `rewards[k]` belongs to `plan.gazes()[k]`.
    fn learn(&mut self, plan: &Plan, rewards: &[f64]);
    /// The only gaze of all later frames, if the policy has committed to one: the appearance then takes it
    /// ([`crate::identity::Appearance::commit_gaze`]).
    fn committed_gaze(&self) -> Option<Gaze> {
        None
    }
    /// Returns the learned state, for observers only.
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Blank
    }
    /// Returns everything that was learned.
    fn save(&self) -> SavedState {
        SavedState::empty()
    }
    /// Restores a state that `save` returned for a policy with the same settings. If the state does not fit, this fails and changes
    /// nothing.
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        if saved.is_empty() { Ok(()) } else { Err(refused("policy", "this policy learns nothing")) }
    }
    /// Resets everything that was learned.
    fn reset(&mut self) {}
    /// The value of a gaze that [`Policy::init_prior`] receives; `None` for most policies, which have no prior.
    fn expectation(&self) -> Option<Expectation> {
        None
    }
    /// Sets the prior after `reset`, on the picture in which the target is given. `worth` computes the value of a gaze, 0 to 1, of the kind
    /// of [`Policy::expectation`]; a call takes as long as a look.
    fn init_prior(&mut self, _worth: &mut dyn FnMut(Gaze) -> f64) {}
}
