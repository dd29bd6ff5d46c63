//! Two looks a frame: a fixed one that holds the target, and the policy's own.
//!
//! Not in the paper. In trials "centre + chosen" was the only policy of partial information that was reliable.

use super::{Plan, Policy, Portrait};
use crate::Result;
use crate::geometry::Gaze;
use crate::rng::Rng;
use serde_json::Value;

/// Uses one gaze, the centre unless told otherwise, in every frame beside those of another policy.
///
/// The other policy learns from its own gazes' rewards only. Where the anchor is one of them, it is looked
/// at once: the same look twice would count its evidence twice.
pub struct Anchor {
    gaze: Gaze,
    inner: Box<dyn Policy>,
    own: Plan,
}

impl Anchor {
    /// The centre beside `inner`.
    pub fn centre(inner: Box<dyn Policy>) -> Self {
        Self::new(Gaze::CENTRE, inner)
    }
    /// Any gaze beside `inner`.
    pub fn new(gaze: Gaze, inner: Box<dyn Policy>) -> Self {
        Self { gaze, inner, own: Plan::new() }
    }
}

impl Policy for Anchor {
    fn plan(&mut self, plan: &mut Plan, rng: &mut Rng) {
        self.inner.plan(&mut self.own, rng);
        plan.clone_from(&self.own);
        plan.mark(self.own.chosen_index());
        match self.own.gazes().iter().position(|g| (g.u, g.v) == (self.gaze.u, self.gaze.v)) {
            Some(k) => plan.use_also(k),
            None => plan.push(self.gaze, true),
        }
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        let own = self.own.gazes().len();
        assert_eq!(plan.gazes().get(..own), Some(self.own.gazes()), "an anchor learns from the plan it made");
        self.inner.learn(&self.own, &rewards[..own]);
    }
    fn portrait(&self) -> Portrait<'_> {
        self.inner.portrait()
    }
    fn save(&self) -> Value {
        self.inner.save()
    }
    fn load(&mut self, saved: &Value) -> Result<()> {
        self.inner.load(saved)
    }
    fn reset(&mut self) {
        self.inner.reset();
    }
}
