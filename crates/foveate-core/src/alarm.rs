//! The class of the target as evidence of loss: a class that is no longer recognised indicates a loss.
//!
//! b(c) ∝ exp Σₜ log pₜ(c), over the confident frames, is the posterior of the target's class. The decision of each frame at the estimate
//! should agree with it: aₜ = Σ_c b(c) pₜ(c). The shortfall of aₜ from its usual value on this target, smoothed over frames, is an
//! evidence deficit: a tracker on a look-alike of another class is lost, however well the look-alike fits. While the class is uncertain,
//! the deficit is 0.
//!
//! Deviation: in the paper nothing flows from identity back to location.

use crate::gaze::Context;
use crate::identity::accumulate::{Accumulate, Accumulator};
use crate::saved_state::{SavedState, Valid, Validate};
use foveate_base::Result;
use serde::{Deserialize, Serialize};

/// Weight of the newest frame in the smoothed deficit: single decisions can be wrong for some frames in a row.
const MEMORY: f64 = 0.1;
/// Evidence deficit, 0 to 1, from which a frame no longer updates the class.
const CONFIDENT: f64 = 0.3;
/// Probability of the most likely class above which the class is known.
const KNOWN: f64 = 0.9;

/// The posterior of the target's class, and the deficit.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Alarm {
    accumulator: Accumulator,
    /// b(c), which follows from the accumulated evidence.
    #[serde(skip)]
    belief: Vec<f64>,
    past: Past,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Past {
    /// Sum of the agreement over `frames` confident frames with a known class.
    agreed: f64,
    frames: u64,
    /// Smoothed evidence deficit, 0 to 1.
    deficit: f64,
}

impl Alarm {
    /// Creates an alarm without evidence on `classes` classes.
    ///
    /// # Errors
    /// If there are fewer than two classes.
    pub(crate) fn new(classes: usize) -> Result<Self> {
        let accumulator = Accumulator::new(Accumulate::Sum, classes)?;
        Ok(Self { accumulator, belief: vec![1.0 / classes as f64; classes], past: Past::default() })
    }
    /// Updates posterior and deficit with log pₜ(c), the frame's own decision at the estimate, and the frame's context.
    pub(crate) fn update(&mut self, log_p: &[f64], context: &Context) {
        let agrees: f64 = self.belief.iter().zip(log_p).map(|(b, q)| b * q.exp()).sum();
        let known = self.belief.iter().any(|b| *b > KNOWN);
        let p = &mut self.past;
        if known && p.frames > 0 {
            let usual = (p.agreed / p.frames as f64).max(f64::MIN_POSITIVE);
            p.deficit += MEMORY * ((1.0 - agrees / usual).clamp(0.0, 1.0) - p.deficit);
        }
        if !context.lost && context.deficit < CONFIDENT {
            if known {
                p.agreed += agrees;
                p.frames += 1;
            }
            self.accumulator.add(log_p);
            self.accumulator.posterior(&mut self.belief);
        }
    }
    /// Returns the evidence deficit of the class, 0 to 1.
    pub(crate) fn deficit(&self) -> f64 {
        self.past.deficit
    }
    /// Resets the posterior and the deficit for another target.
    pub(crate) fn reset(&mut self) {
        self.accumulator.reset();
        self.accumulator.posterior(&mut self.belief);
        self.past = Past::default();
    }
    /// Restores a state that was saved.
    pub(crate) fn load(&mut self, saved: &SavedState) -> Result<()> {
        let Self { accumulator, past, .. } = saved.state("alarm of the recogniser", self)?;
        (self.accumulator, self.past) = (accumulator, past);
        self.accumulator.posterior(&mut self.belief);
        Ok(())
    }
}

impl Validate<Self> for Alarm {
    fn validate(&self, of: &Self) -> Valid {
        let Past { deficit, agreed, .. } = self.past;
        if !(0.0..=1.0).contains(&deficit) || !(0.0..=1e18).contains(&agreed) {
            return Err(format!("its deficit is {deficit}, its agreement {agreed}"));
        }
        self.accumulator.validate(&of.accumulator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alarm() -> Alarm {
        Alarm::new(2).expect("two classes")
    }

    const SURE: Context = Context { ess: 1.0, deficit: 0.0, frame_deficit: 0.0, spread: 0.0, lost: false };

    #[test]
    fn another_class_raises_the_deficit_and_its_return_lowers_it() {
        let (mine, other) = ([0.9f64.ln(), 0.1f64.ln()], [0.1f64.ln(), 0.9f64.ln()]);
        let mut g = alarm();
        for _ in 0..20 {
            g.update(&mine, &SURE);
            assert_eq!(g.deficit(), 0.0, "it is what it was");
        }
        // b is (1, 0) up to 1e-19, the usual agreement is 0.9 except in the first frames, and the other class falls short by 8/9.
        let lost = |g: &mut Alarm, log_p: &[f64]| {
            let mut frames = (1..100).map(|t| {
                let doubtful = Context { deficit: 0.5, ..SURE };
                g.update(log_p, &doubtful);
                (t, g.deficit())
            });
            frames.find(|(_, deficit)| (*deficit > 0.6) == (log_p[0] < log_p[1])).expect("in a hundred frames")
        };
        let exact = |t: i32| 8.0 / 9.0 * (1.0 - 0.9f64.powi(t));
        let (frame, deficit) = lost(&mut g, &other);
        assert!(exact(frame) > 0.6 && exact(frame - 1) <= 0.6, "{frame}");
        assert!((deficit - exact(frame)).abs() < 1e-3);
        let mut again = alarm();
        again.load(&SavedState::new(&g)).expect("it was saved");
        assert_eq!((lost(&mut again, &mine), again.past), (lost(&mut g, &mine), g.past));
        g.reset();
        assert_eq!((g.past, &*g.belief), (Past::default(), &[0.5, 0.5][..]));
    }

    #[test]
    fn an_unknown_class_has_no_deficit() {
        let mut g = alarm();
        for t in 0..50 {
            let log_p = [[0.6f64.ln(), 0.4f64.ln()], [0.4f64.ln(), 0.6f64.ln()]][t % 2];
            g.update(&log_p, &SURE);
            assert_eq!(g.deficit(), 0.0);
        }
        // Nor does the deficit of a class that was known change.
        g.past = Past { agreed: 4.5, frames: 5, deficit: 0.25 };
        g.update(&[0.01f64.ln(), 0.99f64.ln()], &Context { deficit: 0.5, ..SURE });
        assert_eq!(g.deficit(), 0.25);
        assert!(g.load(&SavedState::new(&Alarm::new(3).expect("three classes"))).is_err());
        let mut damaged = alarm();
        damaged.past.deficit = 7.0;
        assert!(g.load(&SavedState::new(&damaged)).is_err());
    }
}
