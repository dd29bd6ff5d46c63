//! The kinds of visible units.

use serde::{Deserialize, Serialize};

/// The kind of the visible units.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Visible {
    /// 0 or 1; values between are taken as probabilities ("soft data").
    Bernoulli,
    /// Real, of variance 1 around a mean: for data standardised row by row.
    Gaussian,
}
