//! One target: what was given to follow, and what is believed of it after a frame.

use crate::geometry::{Extent, State};
use crate::reference::ReferenceLikelihood;
use serde::{Deserialize, Serialize};

/// What was given to follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Target {
    pub state: State,
    /// Half the size of its box at scale 1.
    pub extent: Extent,
    /// Pixels per template unit at scale 1.
    pub unit: f64,
    /// The log-likelihoods to expect on the target and elsewhere.
    pub reference: ReferenceLikelihood,
}

/// What is believed after a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    /// Mean of the belief.
    pub mean: State,
    /// Its covariance over x, y, vx, vy, log scale, angle.
    pub covariance: [[f64; 6]; 6],
    /// Effective sample size, 1 to N.
    pub ess: f64,
}
