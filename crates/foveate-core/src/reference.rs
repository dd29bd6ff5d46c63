//! Reference values of the evidence, from the first frame.

use serde::{Deserialize, Serialize};

/// Reference log-likelihoods, nats per look, between which evidence is judged. Calibration on the first frame measures both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceLikelihood {
    /// Log-likelihood on the target, about a pixel off.
    pub on: f64,
    /// Log-likelihood elsewhere in the picture.
    pub off: f64,
}
