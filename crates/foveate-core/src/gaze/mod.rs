//! WHERE TO LOOK? Policies over gazes, which learn from rewards (section 4).
//!
//! A [`Policy`] writes a [`Plan`]: the gazes it wants rewards for, and which of them are used to move the
//! belief. All gazes (full information: Hedge) or one (partial: baselines, bandits) is thus a fact about the
//! plan's length. A policy sees gazes and rewards, never a pixel.

/// All that a policy learns is what another one, in a field of it, learns.
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
use crate::saved_state::SavedState;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// The gazes of one frame: each is scored, the used ones move the belief, one is the policy's own choice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    gazes: Vec<Gaze>,
    weights: Vec<f64>,
    marked: Option<usize>,
    recorded: Vec<Gaze>,
}

impl Plan {
    /// An empty plan.
    pub const fn new() -> Self {
        Self { gazes: Vec::new(), weights: Vec::new(), marked: None, recorded: Vec::new() }
    }
    /// Forgets all gazes; keeps the room.
    pub fn clear(&mut self) {
        self.gazes.clear();
        self.weights.clear();
        self.marked = None;
        self.recorded.clear();
    }
    /// Asks for one gaze, and uses it.
    pub fn only(&mut self, gaze: Gaze) {
        self.clear();
        self.weigh(gaze, 1.0);
    }
    /// Asks for all of `gazes`, and uses the one at `chosen`.
    pub fn all(&mut self, gazes: &[Gaze], chosen: usize) {
        assert!(chosen < gazes.len(), "gaze {chosen} of {} cannot be chosen", gazes.len());
        self.clear();
        for (k, &gaze) in gazes.iter().enumerate() {
            self.weigh(gaze, f64::from(u8::from(k == chosen)));
        }
    }
    /// Asks for one gaze more, and uses as much of its log-likelihood as `weight` says, finite and at least 0; at 0 it is only scored.
    pub fn weigh(&mut self, gaze: Gaze, weight: f64) {
        self.gazes.push(gaze);
        self.weights.push(weight);
    }
    /// Uses the gaze at `k` too, for one look at least.
    pub fn use_also(&mut self, k: usize) {
        self.weights[k] = self.weights[k].max(1.0);
    }
    /// Says which of the used gazes is the policy's own choice; otherwise it is the first used one.
    pub fn mark(&mut self, k: usize) {
        assert!(self.weights[k] > 0.0, "the choice must be one of the used gazes");
        self.marked = Some(k);
    }
    /// Asks for the reward of a gaze for observers alone: it neither moves the belief nor comes to `learn`.
    pub fn record(&mut self, gaze: Gaze) {
        self.recorded.push(gaze);
    }
    /// The gazes whose rewards are for observers alone.
    pub fn recorded(&self) -> &[Gaze] {
        &self.recorded
    }
    /// What to score, in the order of the rewards.
    pub fn gazes(&self) -> &[Gaze] {
        &self.gazes
    }
    /// The gazes that move the belief, one at least, with their indices.
    pub fn used(&self) -> impl Iterator<Item = (usize, Gaze)> {
        let all = self.gazes.iter().copied().zip(&self.weights).enumerate();
        all.filter(|(_, (_, weight))| **weight > 0.0).map(|(k, (gaze, _))| (k, gaze))
    }
    /// For each gaze, how much its log-likelihood counts: 1 for one that is used, 0 for one that is only scored, anything
    /// else where the policy weighs them.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
    /// How many looks the used gazes count for: the sum of their weights.
    pub fn looks(&self) -> f64 {
        self.weights.iter().sum()
    }
    /// Index of the policy's own choice. Panics if no gaze is used, which no policy may leave so.
    pub fn chosen_index(&self) -> usize {
        let first = || self.used().next().expect("a plan uses one gaze at least").0;
        self.marked.unwrap_or_else(first)
    }
    /// The policy's own choice: what it is said to look at.
    pub fn chosen(&self) -> Gaze {
        self.gazes[self.chosen_index()]
    }
}

/// How sure the tracker was at the end of the frame before: what a policy may weigh exploring against (the paper's
/// last paragraph). [`Default`] is the first frame's: all is well.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Context {
    /// Effective sample size as a share of the particles, above 0 to 1.
    pub ess: f64,
    /// 0 while the looks fit as they do on the target, 1 when they fit as elsewhere; smoothed over frames, 0 to 2.
    pub deficit: f64,
    /// The same of the last frame alone, 0 to 2.
    pub frame_deficit: f64,
    /// Standard deviation of the belief about place, in template units (1 is half the target's box).
    pub spread: f64,
    /// Whether the target is believed lost.
    pub lost: bool,
}

impl Default for Context {
    fn default() -> Self {
        Self { ess: 1.0, deficit: 0.0, frame_deficit: 0.0, spread: 0.0, lost: false }
    }
}

/// A reward surface over the template, as a policy believes it to be.
pub trait Surface: Sync {
    /// Half the side of the square of gazes it is over, in template units.
    fn reach(&self) -> f64;
    /// Mean and standard deviation of the believed reward of looking at (u, v).
    fn at(&self, u: f64, v: f64) -> (f64, f64);
    /// The gazes it was learned from, oldest first.
    fn fixations(&self) -> &[Gaze];
    /// The gaze with the largest mean. `None` before anything was learned.
    fn best(&self) -> Option<Gaze>;
}

/// What a policy has learned, for people to see.
#[derive(Clone, Copy)]
pub enum PolicySnapshot<'a> {
    /// Nothing to show.
    Blank,
    /// How likely each gaze is to be chosen next, or how much it weighs where all are; the shares sum to 1.
    Arms {
        /// The gazes.
        gazes: &'a [Gaze],
        /// As many probabilities.
        probabilities: &'a [f64],
    },
    /// What each gaze of a continuous space is believed to be worth; worked out where it is asked for.
    Surface(&'a dyn Surface),
}

/// What a policy wants to know of a gaze before the first look, from the picture in which the target is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expectation {
    /// How much what it looks at stands out (Itti, Koch and Niebur).
    Saliency,
    /// Its reward on that picture itself, had the target's place been uncertain: how much it tells of place.
    Rehearsal,
}

/// Chooses gazes, and learns from what they were worth.
///
/// One call of `plan`, then one of `learn` with that plan, each frame. `plan` must use one gaze at least and
/// draw from `rng` alone. `save` and `load` must carry all that was learned, bit for bit: a policy that loads
/// goes on as the one that saved would have.
pub trait Policy: Send + Sync {
    /// Replaces the plan by the gazes of the next frame. Most policies do not mind the context.
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng);
    /// Learns from rewards in [0, 1]; `rewards[k]` belongs to `plan.gazes()[k]`.
    fn learn(&mut self, plan: &Plan, rewards: &[f64]);
    /// The only gaze from now on, if the policy has committed to one: the target is then learned again under that gaze.
    fn committed_gaze(&self) -> Option<Gaze> {
        None
    }
    /// What was learned, for observers only.
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Blank
    }
    /// All that was learned.
    fn save(&self) -> SavedState {
        SavedState::empty()
    }
    /// Restores a state that `save` returned for a policy with the same settings. If the state does not fit, this fails and changes nothing.
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        if saved.is_empty() { Ok(()) } else { Err(misfit("nothing, for this policy learns nothing", saved)) }
    }
    /// Forgets all that was learned.
    fn reset(&mut self) {}
    /// The value of a gaze that [`Policy::init_prior`] receives; `None` for most policies, which have no prior.
    fn expectation(&self) -> Option<Expectation> {
        None
    }
    /// Sets the prior after `reset`, on the picture in which the target is given. `worth` computes the value of a gaze, 0 to 1, of the kind
    /// of [`Policy::expectation`]; a call takes as long as a look.
    fn init_prior(&mut self, _worth: &mut dyn FnMut(Gaze) -> f64) {}
}

/// A saved state that does not fit.
fn misfit(expected: &str, found: &SavedState) -> Error {
    let found: String = found.to_string().chars().take(80).collect();
    Error::Invalid(format!(
        "saved policy: expected {expected}, found {found}; load a state that was saved with the same policy and settings"
    ))
}
