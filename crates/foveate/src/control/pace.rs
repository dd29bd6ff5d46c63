//! Motion noise that follows the target's own unrest.
//!
//! With zᵢ the noise that led from parent i to its child, along an axis, in standard deviations of the configured noise,
//! and wᵢ the child's weight after the look,
//! ```text
//! m ← m + rate · (Σ wᵢ zᵢ² − m)
//! s = √m / usual, at least `least`, at most `most`
//! ```
//! and the next frame's noises of place and velocity are s times the configured ones. Σ wᵢ zᵢ² is what the noise's variance
//! is expected to have been, given what was seen: a step of online expectation maximisation.
//!
//! Deviation: the paper's motion noise never changes. Zhou, Chellappa & Moghaddam (2004) adapt theirs to the error of
//! prediction, within limits, as is done here.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::Dynamics;
use crate::geometry::State;
use crate::{Error, Result};

/// How the motion noise adapts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Pace {
    /// Share of the newest frame in the smoothed square of the noise, above 0 to 1.
    pub rate: f64,
    /// Noise, in standard deviations of the configured one, at which the configured one is kept; 0.01 to 100.
    pub usual: f64,
    /// Least factor of the noises, 0.01 to 1.
    pub least: f64,
    /// Largest factor of the noises, 1 to 100.
    pub most: f64,
    /// Smoothed square of the noise, in squares of `usual`; None until something was learned.
    #[serde(skip)]
    square: Option<f64>,
}

impl Default for Pace {
    fn default() -> Self {
        Self { rate: 0.1, usual: 1.0, least: 0.3, most: 3.0, square: None }
    }
}

impl Pace {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("rate", self.rate, 1e-6, 1.0),
            ("usual", self.usual, 0.01, 100.0),
            ("least", self.least, 0.01, 1.0),
            ("most", self.most, 1.0, 100.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Error::Config(format!("pace.{name} is a number from {least} to {most}; it is {value}")));
            }
        }
        Ok(())
    }
    /// What the noises of place and velocity are multiplied by.
    pub fn factor(&self) -> f64 {
        self.square.unwrap_or(1.0).sqrt().clamp(self.least, self.most)
    }
    /// Learns from children, the parents they were drawn for, and the weights they have now; `motion` is the configured one.
    pub fn learn(&mut self, motion: &dyn Dynamics, parents: &[State], children: &[State], weights: &[f64]) {
        let spread = self.usual * motion.spread();
        let mut sum = 0.0;
        for ((parent, child), w) in parents.iter().zip(children).zip(weights) {
            let expected = motion.expected(parent);
            sum += w * 0.5 * ((child.x - expected.x).powi(2) + (child.y - expected.y).powi(2));
        }
        let seen = sum / (spread * spread);
        // Without noise, or of states that are nowhere, there is nothing to learn.
        if seen.is_finite() {
            let square = self.square.unwrap_or(1.0);
            self.square = Some(square + self.rate * (seen.min(self.most * self.most) - square));
        }
    }
    /// Moves a child to where it would be with `factor` times the noise.
    pub(super) fn stretch(&self, motion: &dyn Dynamics, parents: &[State], children: &mut [State]) {
        let factor = self.factor();
        if factor == 1.0 {
            return;
        }
        for (parent, child) in parents.iter().zip(children) {
            let expected = motion.expected(parent);
            let stretched = |mean: f64, drawn: f64| mean + factor * (drawn - mean);
            (child.x, child.y) = (stretched(expected.x, child.x), stretched(expected.y, child.y));
            (child.vx, child.vy) = (stretched(expected.vx, child.vx), stretched(expected.vy, child.vy));
        }
    }
    /// Forgets what was learned.
    pub fn reset(&mut self) {
        self.square = None;
    }
    /// What was learned.
    pub fn save(&self) -> Value {
        json!({ "square": self.square })
    }
    /// Goes on from what `save` gave.
    pub fn load(&mut self, saved: &Value) -> Result<()> {
        let square = saved.get("square");
        self.square = match square.map(|s| (s.is_null(), s.as_f64())) {
            Some((true, _)) => None,
            Some((_, Some(s))) if (0.0..=1e4).contains(&s) => Some(s),
            _ => {
                return Err(Error::Invalid(format!(
                    "saved pace: expected a square from 0 to 10000, or null, found {saved}; load a state that was saved with the \
                     same configuration"
                )));
            }
        };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::dynamics::tests::ALL;
    use crate::control::{Autoregressive, Mixing, Mixture, Prior, Proposal};
    use crate::geometry::BBox;
    use crate::rng::{Purpose, Streams};
    use crate::scene::{Detection, Scene};
    use crate::{conformance, conformance::blank_frame};
    use std::sync::Arc;

    const MOTION: Autoregressive = Autoregressive { leaps: 0.2, ..ALL };
    const FROM: State = State { x: 10.0, y: 20.0, vx: 2.0, vy: 1.0, log_scale: 0.2, angle: 0.5 };
    const QUICK: Pace = Pace { rate: 1.0, usual: 1.0, least: 0.2, most: 5.0, square: None };

    /// A pace that has seen noise `factor` times the configured one.
    fn after(factor: f64) -> Pace {
        Pace { square: Some(factor * factor), ..QUICK }
    }

    /// 20,000 draws of heavy tails: the mean square is within 5 % for all but one seed in 10⁴, and the seed is fixed.
    #[test]
    fn noise_is_measured_as_it_is() {
        const N: usize = 20_000;
        let (parents, mut children) = (vec![FROM; N], vec![FROM; N]);
        for factor in [0.5, 1.0, 3.0] {
            MOTION.scaled(factor).sample_each(&parents, &mut children, &mut Streams::new(3, 0).rng(0));
            for usual in [0.5, 1.0, 2.0] {
                let mut pace = Pace { usual, ..QUICK };
                pace.learn(&MOTION, &parents, &children, &vec![1.0 / N as f64; N]);
                let exact = (factor / usual).clamp(0.2, 5.0);
                assert!((pace.factor() / exact - 1.0).abs() < 0.05, "{} is not {exact}", pace.factor());
            }
        }
    }

    #[test]
    fn it_follows_what_weighs_by_the_printed_formula() {
        let mut pace = Pace { rate: 0.25, ..Pace::default() };
        assert_eq!(pace.factor(), 1.0);
        let expected = MOTION.expected(&FROM);
        let off = |z: f64| State { x: expected.x + z * MOTION.spread(), y: expected.y - z * MOTION.spread(), ..FROM };
        pace.learn(&MOTION, &[FROM; 3], &[off(1.0), off(2.0), off(100.0)], &[0.25, 0.75, 0.0]);
        let square: f64 = 1.0 + 0.25 * ((0.25 * 1.0 + 0.75 * 4.0) - 1.0);
        assert!((pace.factor() - square.sqrt()).abs() < 1e-12);
        for _ in 0..1000 {
            pace.learn(&MOTION, &[FROM], &[off(0.0)], &[1.0]);
        }
        assert_eq!(pace.factor(), pace.least);
        pace.learn(&MOTION, &[FROM], &[off(1e9)], &[1.0]);
        assert!(pace.factor() <= pace.most, "one frame goes no further than the limit, so that it comes back");
        let before = pace;
        pace.learn(&MOTION, &[FROM], &[off(f64::NAN)], &[1.0]);
        assert_eq!(pace, before);
        pace.reset();
        assert_eq!(pace.factor(), 1.0);
    }

    /// The law of a mixture compares it with the prior: both must have the same, stretched noise.
    #[test]
    fn stretched_noise_keeps_the_laws() {
        let found = [(12.5, 20.0, 2.5), (14.0, 22.0, 2.0)]
            .map(|(x, y, side)| Detection { bbox: BBox::around(x, y, side, side), score: 1.0 });
        let frame = blank_frame();
        let scene = Scene { frame: &frame, detections: &found };
        let normal = Autoregressive { leaps: 0.0, ..MOTION };
        for factor in [0.6, 1.0, 2.0] {
            let prior = |motion| Prior::new(Arc::new(motion)).paced(Some(after(factor)));
            conformance::proposal(&mut prior(MOTION), scene, &FROM);
            let mixing = Mixing { alpha: 0.4, spread: 0.5, size: None, gate: 8.0 };
            let mut mixture = Mixture::new(normal, mixing).paced(Some(after(factor)));
            conformance::proposal(&mut mixture, scene, &FROM);
            conformance::proposal_weights(&mut mixture, &mut prior(normal), scene, &FROM);
            // Noise that is stretched is noise of that size.
            let scaled = normal.scaled(factor);
            conformance::proposal_weights(&mut Prior::new(Arc::new(scaled)), &mut prior(normal), scene, &FROM);
        }
    }

    #[test]
    fn a_prior_draws_as_much_noise_as_it_learned() {
        let mut prior = Prior::new(Arc::new(MOTION)).paced(Some(QUICK));
        prior.size(10.0);
        let frame = blank_frame();
        let (mut children, mut owed) = ([FROM; 640], [0.0; 640]);
        let mut spread = |prior: &mut Prior, stream| {
            let streams = Streams::new(stream, 0).at(1, Purpose::Predict);
            let scene = Scene { frame: &frame, detections: &[] };
            prior.propose(scene, &[FROM; 640], &mut children, &mut owed, streams);
            let mean = MOTION.scaled(10.0).expected(&FROM).x;
            (children.iter().map(|c| (c.x - mean).powi(2)).sum::<f64>() / 640.0).sqrt()
        };
        let usual = spread(&mut prior, 1);
        let wide = MOTION.scaled(20.0).spread();
        let far = State { x: FROM.x + 0.9 * 2.0 + wide, y: FROM.y + 0.9 + wide, ..FROM };
        prior.learn(&[FROM], &[far], &[1.0]);
        assert!((spread(&mut prior, 1) / usual - 2.0).abs() < 1e-9, "twice the noise, of the same draws");
        let saved = prior.save();
        let mut other = Prior::new(Arc::new(MOTION)).paced(Some(QUICK));
        other.size(10.0);
        other.load(&saved).expect("it was saved");
        assert_eq!(spread(&mut other, 2).to_bits(), spread(&mut prior, 2).to_bits());
        for rubbish in
            [json!({ "rubbish": 1 }), json!([]), json!(7), json!({ "square": -1.0 }), json!({ "square": "a" })]
        {
            assert!(other.load(&rubbish).is_err(), "{rubbish}");
            assert_eq!(other.save(), saved);
        }
        assert!(Prior::new(Arc::new(MOTION)).load(&saved).is_err(), "one without a pace cannot go on from it");
    }

    #[test]
    fn settings_are_checked() {
        assert!(Pace::default().check().is_ok());
        for (bad, name) in [
            (Pace { rate: 0.0, ..QUICK }, "pace.rate"),
            (Pace { usual: f64::NAN, ..QUICK }, "pace.usual"),
            (Pace { least: 1.5, ..QUICK }, "pace.least"),
            (Pace { most: 0.5, ..QUICK }, "pace.most"),
        ] {
            assert!(bad.check().expect_err(name).to_string().contains(name));
        }
    }
}
