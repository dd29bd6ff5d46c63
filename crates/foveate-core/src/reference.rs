//! What the first frame says of evidence to come.

use serde::{Deserialize, Serialize};

/// Reference likelihoods, nats a look: evidence is judged by where it lies between them. Calibration on the first frame
/// measures both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceLikelihood {
    /// On the target, a pixel or so off.
    pub on: f64,
    /// Elsewhere in the picture.
    pub off: f64,
}
