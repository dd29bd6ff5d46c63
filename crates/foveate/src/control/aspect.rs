//! How wide for its height the target is: its aspect, followed slowly.
//!
//! The particles share one shape, of the area their scale says. After each frame that is not lost the estimate is scored in
//! three shapes, width × exp(a) and height × exp(−a) with a at, below and above the present one by `trial`; with v the vertex
//! of the parabola through the three scores, no farther than `trial`,
//! ```text
//! a ← (1 − pull) (a + rate · v)
//! ```
//! so that what nothing speaks for returns to frame 1's shape.
//!
//! Deviation: the paper's targets have one shape for ever.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::geometry::Extent;
use crate::{Error, Result};

/// How the shape follows the target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Aspect {
    /// Share of the way to the best shape that is gone in a frame, above 0 to 1.
    pub rate: f64,
    /// How far off the shapes on trial are, natural logarithm of width and of one over height, 0.001 to 0.5.
    pub trial: f64,
    /// Share of the way back to frame 1's shape that is gone in a frame, 0 to 1.
    pub pull: f64,
    /// How far a is from frame 1's shape.
    #[serde(skip)]
    log: f64,
}

/// The largest |a|: width over height may grow or shrink by a factor of e² = 7.4.
const MOST: f64 = 1.0;

impl Default for Aspect {
    fn default() -> Self {
        Self { rate: 0.1, trial: 0.1, pull: 0.02, log: 0.0 }
    }
}

/// A shape of the same area, wider by exp(a).
fn wider(extent: Extent, a: f64) -> Extent {
    Extent { half_w: extent.half_w * a.exp(), half_h: extent.half_h * (-a).exp() }
}

impl Aspect {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        for (name, value, least, most) in
            [("rate", self.rate, 1e-6, 1.0), ("trial", self.trial, 1e-3, 0.5), ("pull", self.pull, 0.0, 1.0)]
        {
            if !(least..=most).contains(&value) {
                return Err(Error::Config(format!("aspect.{name} is a number from {least} to {most}; it is {value}")));
            }
        }
        Ok(())
    }
    /// The shapes to score, around the present one: narrower, as it is, wider.
    pub fn trials(&self, present: Extent) -> [Extent; 3] {
        [-self.trial, 0.0, self.trial].map(|a| wider(present, a))
    }
    /// The next shape, from the scores (log-likelihoods, nats) of the three on trial.
    pub fn learn(&mut self, present: Extent, [narrower, same, wide]: [f64; 3]) -> Extent {
        let (slope, bend) = (wide - narrower, 2.0 * same - wide - narrower);
        let vertex = if bend > 0.0 { 0.5 * slope / bend } else { slope.signum() };
        if !(slope.is_finite() && bend.is_finite()) || slope == 0.0 {
            return present;
        }
        let to = (1.0 - self.pull) * (self.log + self.rate * self.trial * vertex.clamp(-1.0, 1.0));
        let to = to.clamp(-MOST, MOST);
        let next = wider(present, to - self.log);
        self.log = to;
        next
    }
    /// The target was just given in its shape.
    pub fn reset(&mut self) {
        self.log = 0.0;
    }
    /// What was learned.
    pub fn save(&self) -> Value {
        json!(self.log)
    }
    /// Goes on from what `save` gave.
    pub fn load(&mut self, saved: &Value) -> Result<()> {
        self.log = saved.as_f64().filter(|a| a.abs() <= MOST).ok_or_else(|| {
            Error::Invalid(format!(
                "saved aspect: expected a number from -{MOST} to {MOST}, found {saved}; load a state that was saved with the \
                 same configuration"
            ))
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    /// Follows scores that are a parabola about a shape, and says how far it went.
    fn after(mut aspect: Aspect, best: f64, frames: usize) -> (f64, Extent) {
        let mut extent = FIRST;
        for _ in 0..frames {
            let scores = aspect.trials(extent).map(|e| {
                let a = 0.5 * (e.half_w / e.half_h / FIRST.half_w * FIRST.half_h).ln();
                -30.0 * (a - best).powi(2)
            });
            extent = aspect.learn(extent, scores);
        }
        (aspect.log, extent)
    }

    /// For a parabola the vertex is exact: steps of `rate` of what lacks, `trial` at most, and a balance with the pull.
    #[test]
    fn it_goes_to_the_best_shape_in_closed_form() {
        let free = Aspect { pull: 0.0, ..Aspect::default() };
        assert!((after(free, 0.05, 1).0 - 0.1 * 0.05).abs() < 1e-12);
        assert!((after(free, 0.4, 1).0 - 0.1 * 0.1).abs() < 1e-12, "no farther than the trial");
        assert!((after(free, 0.4, 500).0 - 0.4).abs() < 1e-9);
        let pulled = Aspect { pull: 0.05, ..Aspect::default() };
        // a = (1 − p) (a + r (b − a)) at rest.
        let rest = 0.95 * 0.1 * 0.06 / (1.0 - 0.95 * 0.9);
        assert!((after(pulled, 0.06, 500).0 - rest).abs() < 1e-9);
        let (log, extent) = after(free, -0.3, 200);
        assert!((extent.mean() - FIRST.mean()).abs() < 1e-9, "the area stays");
        assert!((extent.half_w / FIRST.half_w - log.exp()).abs() < 1e-9);
        assert_eq!(after(free, 3.0, 10_000).0, MOST);
    }

    #[test]
    fn scores_that_say_nothing_change_nothing() {
        let mut aspect = Aspect { pull: 0.0, ..Aspect::default() };
        for scores in [[f64::NEG_INFINITY, 0.0, -1.0], [f64::NAN; 3], [f64::NEG_INFINITY; 3], [-1.0; 3]] {
            assert_eq!(aspect.learn(FIRST, scores), FIRST);
        }
        assert!(aspect.learn(FIRST, [-3.0, -2.0, -0.5]).half_w > FIRST.half_w, "without a vertex it goes uphill");
        let saved = aspect.save();
        let mut other = Aspect::default();
        other.load(&saved).expect("it was saved");
        assert_eq!(other.log, aspect.log);
        for rubbish in [json!(null), json!("a"), json!(7.0), json!({})] {
            assert!(other.load(&rubbish).is_err(), "{rubbish}");
        }
        assert_eq!(other.log, aspect.log);
    }

    #[test]
    fn settings_are_checked() {
        let it = Aspect::default();
        assert!(it.check().is_ok());
        for (bad, name) in [
            (Aspect { rate: 0.0, ..it }, "aspect.rate"),
            (Aspect { trial: f64::NAN, ..it }, "aspect.trial"),
            (Aspect { pull: 1.5, ..it }, "aspect.pull"),
        ] {
            assert!(bad.check().expect_err(name).to_string().contains(name));
        }
    }
}
