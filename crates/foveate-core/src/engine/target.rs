//! One target: its given box, and the belief after a frame.

use crate::geometry::{Covariance, Extent, State};
use crate::reference::ReferenceLikelihood;
use serde::{Deserialize, Serialize};

/// The given target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Target {
    pub state: State,
    /// Half the size of the box at scale 1, pixels.
    pub extent: Extent,
    /// Pixels per template unit at scale 1.
    pub unit: f64,
    /// The target's share of each side of the box that was drawn and is reported, above 0 to 1.
    pub share: f64,
    /// Whether it was moved to a given box since the first one.
    #[serde(default)]
    pub moved: bool,
    /// The expected log-likelihoods on the target and elsewhere.
    pub reference: ReferenceLikelihood,
}

impl Target {
    /// Returns half the size of the reported box at scale 1, pixels.
    pub(crate) fn drawn(&self) -> Extent {
        let Extent { half_w, half_h } = self.extent;
        Extent { half_w: half_w / self.share, half_h: half_h / self.share }
    }
}

/// The belief after a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    /// Mean of the belief.
    pub mean: State,
    /// Covariance over x, y, vx, vy, log scale, angle, log aspect.
    pub covariance: Covariance,
    /// Effective sample size, 1 to N.
    pub ess: f64,
    /// Displacement since the last frame, right and down, pixels.
    pub moved: [f64; 2],
}
