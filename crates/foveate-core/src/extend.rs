//! Extension points: the traits to implement, their conformance tests, and the names under which a configuration finds your components.
//!
//! Register a constructor under a name in [`Parts`]. A configuration with these components may then have a section with `kind = "name"`; the
//! other keys of the section are the settings that the constructor receives. `docs/extend.md` shows a component of each kind.

pub use crate::config::{EncoderSite, ObservationSite, Parts, ProposalSite};
pub use crate::conformance;
pub use crate::control::{Autoregressive, Dynamics, Prior, Proposal, Reward};
pub use crate::gaze::{Context, Expectation, Grid, Plan, Policy, PolicySnapshot, Surface};
pub use crate::geometry::{Extent, Fixation, Gaze, Size, State};
pub use crate::identity::encoder::standardise;
pub use crate::identity::retina::{Cell, FovealConfig};
pub use crate::identity::{Appearance, Encoder, Foveal, Lesson, Memory, Percept, Retina, TemplateSource};
pub use crate::reference::ReferenceLikelihood;
pub use crate::saved_state::SavedState;
pub use crate::scene::detect::{Blobs, Score};
pub use crate::scene::sensor::Window;
pub use crate::scene::{Detector, Map, Regions, Scene};
pub use foveate_base::rng::{Purpose, Rng, Streams};
pub use foveate_base::rows::{Rows, RowsMut};
