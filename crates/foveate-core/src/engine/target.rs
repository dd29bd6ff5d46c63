//! One target: its given box, and the belief after a frame.

use crate::geometry::{Covariance, Extent, State};
use crate::reference::ReferenceLikelihood;
use serde::{Deserialize, Serialize};

/// The target as it was given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Target {
    pub state: State,
    /// Half the size of the box at scale 1, pixels.
    pub extent: Extent,
    /// Pixels per template unit at scale 1.
    pub unit: f64,
    /// The expected log-likelihoods on the target and elsewhere.
    pub reference: ReferenceLikelihood,
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
}
