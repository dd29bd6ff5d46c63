//! What is believed of a track: followed, hidden, lost, found again. `confidence.rs` says when which.

use serde::{Deserialize, Serialize};

/// What is believed of the track as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// All is well.
    #[default]
    Tracking,
    /// Nothing in view fits, since a moment: it may come back where it went.
    Occluded,
    /// Nothing has fitted for long: it may be anywhere.
    Lost,
    /// It was lost, and something has fitted for some frames now.
    Found,
}

impl Standing {
    /// In words, for people and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
            Self::Found => "found",
        }
    }
    /// Whether the box means nothing.
    pub fn is_out(self) -> bool {
        matches!(self, Self::Occluded | Self::Lost)
    }
}
