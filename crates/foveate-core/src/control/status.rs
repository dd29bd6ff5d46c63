//! The status of a track. `confidence.rs` has the rules.

use serde::{Deserialize, Serialize};

/// Status of the track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The evidence fits.
    #[default]
    Tracking,
    /// No evidence in view since a few frames: it may come back where it was.
    Occluded,
    /// No evidence for long: it may be anywhere.
    Lost,
    /// It was lost, and the evidence has fitted again for some frames.
    Reacquired,
}

impl Status {
    /// In words, for people and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
            Self::Reacquired => "reacquired",
        }
    }
    /// Whether the box is no result: occluded or lost.
    pub fn is_occluded_or_lost(self) -> bool {
        matches!(self, Self::Occluded | Self::Lost)
    }
}
