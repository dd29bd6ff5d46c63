//! The state of a part in a saved tracker.

use std::fmt;

use foveate_base::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The state of a part: any value that serde can write. Only the part itself interprets it.
///
/// ```
/// use foveate_core::extend::SavedState;
///
/// let saved = SavedState::new(&(3, "three"));
/// assert_eq!(saved.read::<(usize, String)>()?, (3, "three".to_owned()));
/// assert!(saved.read::<Vec<f64>>().is_err());
/// # Ok::<(), foveate_core::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SavedState(Value);

impl SavedState {
    /// Returns the state of a part that learns nothing.
    pub fn empty() -> Self {
        Self::default()
    }
    /// Saves this value. Numbers that are not finite are lost.
    ///
    /// # Panics
    /// If the value cannot be JSON: it has a map whose keys are not text, or its `Serialize` fails.
    pub fn new(state: &impl Serialize) -> Self {
        Self(serde_json::to_value(state).expect("a state is plain data: maps have text as keys"))
    }
    /// Returns whether it is the state of a part that learns nothing.
    pub fn is_empty(&self) -> bool {
        self.0.is_null()
    }
    /// Returns the value that was saved.
    ///
    /// # Errors
    /// [`Error::Invalid`] if it has another type.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T> {
        T::deserialize(&self.0).map_err(|error| Error::Invalid(format!("the saved state does not fit: {error}")))
    }
}

/// Formats the value as JSON text.
impl fmt::Display for SavedState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
