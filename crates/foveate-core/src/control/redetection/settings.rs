//! Settings of the search for a lost target, and their ranges.

use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

use super::MOST;

/// Settings of the search; lengths are in template units (1 = half the target's box).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RedetectionSettings {
    /// Frames between two searches.
    pub every: u64,
    /// Distance of neighbouring places; it grows if there were more than 16,000, above 0 to 10.
    pub step: f64,
    /// Approximate number of places scored in a frame. Larger pictures are searched in parts.
    pub budget: usize,
    /// Share of the particles that restart, 0 to 1.
    pub share: f64,
    /// Number of places they restart from, 1 to 1000.
    pub places: usize,
    /// Least fit of a place: 0 is the reference log-likelihood of frame 1 on the target, 1 that off it, 0 to 2.
    pub fit: f64,
    /// Standard deviation about a place, above 0 to 10.
    pub spread: f64,
    /// Prior probability that a lost target is anywhere in the picture, above 0 to 1.
    pub chance: f64,
}

impl Default for RedetectionSettings {
    fn default() -> Self {
        Self { every: 4, step: 0.3, budget: MOST as usize, share: 0.3, places: 8, fit: 0.2, spread: 0.15, chance: 0.5 }
    }
}

impl RedetectionSettings {
    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, found: f64| {
            Err(Error::Config(format!("redetection.{name} is {expected}; it is {found}")))
        };
        match self {
            s if !(1..=1_000_000).contains(&s.every) => wrong("every", "1 to 1000000 frames", s.every as f64),
            s if !(1e-3..=10.0).contains(&s.step) => wrong("step", "0.001 to 10 template units", s.step),
            s if !(64..=MOST as usize).contains(&s.budget) => wrong("budget", "64 to 16000 places", s.budget as f64),
            s if !(0.0..=1.0).contains(&s.share) => wrong("share", "0 to 1", s.share),
            s if !(1..=1000).contains(&s.places) => wrong("places", "1 to 1000", s.places as f64),
            s if !(0.0..=2.0).contains(&s.fit) => wrong("fit", "0 to 2", s.fit),
            s if !(1e-3..=10.0).contains(&s.spread) => wrong("spread", "0.001 to 10 template units", s.spread),
            s if !(1e-9..=1.0).contains(&s.chance) => wrong("chance", "a billionth to 1", s.chance),
            _ => Ok(()),
        }
    }
}
