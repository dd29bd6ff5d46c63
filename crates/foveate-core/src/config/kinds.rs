//! The kinds of components that the library has, as configurations name them.

/// Gaze policies.
pub const POLICIES: [&str; 12] = [
    "fixed",
    "random",
    "circular",
    "hedge",
    "pool",
    "explore-then-commit",
    "exp3",
    "exp3-as-printed",
    "exp3-ix",
    "exp3-s",
    "gp-ucb",
    "anchor",
];

#[cfg(feature = "learn")]
pub(super) const ENCODERS: [&str; 5] = ["rbm", "kmeans", "onnx", "oriented", "raw"];
#[cfg(not(feature = "learn"))]
pub(super) const ENCODERS: [&str; 3] = ["onnx", "oriented", "raw"];

pub(super) const PROPOSALS: [&str; 2] = ["prior", "mixture"];

pub(super) const DETECTORS: [&str; 5] = ["motion", "walkers", "saliency", "flow", "onnx"];

pub(super) const REWARDS: [&str; 4] = ["concentration", "log-concentration", "agreement", "variance-reduction"];
