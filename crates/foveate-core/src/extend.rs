//! Parts of your own: the traits to implement, their laws, and the names under which a configuration finds them.
//!
//! Register a constructor under a name in [`Parts`]. A configuration with these parts may then have a section with `kind = "name"`; the
//! other keys of the section are the settings that the constructor receives.

pub use crate::config::{EncoderSite, ObservationSite, Parts, ProposalSite};
pub use crate::conformance;
pub use crate::control::{Proposal, Reward};
pub use crate::gaze::Policy;
pub use crate::identity::{Appearance, Encoder};
pub use crate::saved_state::SavedState;
pub use crate::scene::Detector;
pub use foveate_base::rng::{Rng, Streams};
