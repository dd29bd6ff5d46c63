//! The states of parts in a saved tracker.

use std::fmt;
use std::str::FromStr;

use foveate_base::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::origin::Origin;
use crate::tree::Node;

/// The format number of saved trackers, of one target and of many.
pub(crate) const FORMAT: u32 = 25;

/// The state of a tracker or of a part: any value that serde can write. Only the part itself interprets it. As text it is JSON.
///
/// ```
/// use foveate_core::extend::SavedState;
///
/// let saved = SavedState::new(&(3, "three"));
/// assert_eq!(saved.read::<(usize, String)>()?, (3, "three".to_owned()));
/// assert!(saved.read::<Vec<f64>>().is_err());
/// assert_eq!(saved.to_string().parse::<SavedState>()?, saved);
/// # Ok::<(), foveate_core::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SavedState(Node);

/// A state that serde has read: it may be damaged, or of a part with other settings.
pub(crate) trait Validate<Settings: ?Sized = ()> {
    /// Fails with the problem if a part with these settings cannot continue from this state.
    fn validate(&self, settings: &Settings) -> Valid;
}

/// The problem of a state, if it has one.
pub(crate) type Valid = std::result::Result<(), String>;

/// Fails with the problem unless the condition holds.
pub(crate) fn ensure(holds: bool, problem: impl FnOnce() -> String) -> Valid {
    if holds { Ok(()) } else { Err(problem()) }
}

impl SavedState {
    /// Returns the state of a part that learns nothing.
    pub fn empty() -> Self {
        Self::default()
    }
    /// Saves this value; `None` is the empty state. Numbers that are not finite are lost.
    ///
    /// # Panics
    /// If the value cannot be JSON: it has a map whose keys are not text, or its `Serialize` fails.
    pub fn new(state: &impl Serialize) -> Self {
        Self(Node::of(state).into_json())
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
        self.0.read().map_err(|error| Error::Invalid(format!("the saved state does not fit: {error}")))
    }
    /// Returns the state of the part `name` if a part with these settings can continue from it.
    pub(crate) fn state<S: ?Sized, T: DeserializeOwned + Validate<S>>(&self, name: &str, settings: &S) -> Result<T> {
        let checked = |state: T| state.validate(settings).map(|()| state);
        let state = self.0.read().map_err(|error| error.to_string()).and_then(checked);
        state.map_err(|what| refused(name, &what))
    }
    /// Checks that a tracker of this origin was saved, in the present format.
    pub(crate) fn check_origin(&self, origin: &Origin) -> Result<()> {
        // Check the format first: a state of another format has other parts.
        let format = self.part("format").read::<u64>().ok();
        if format != Some(FORMAT.into()) {
            let found = format.map_or("no number".into(), |format| format.to_string());
            return Err(refused("tracker", &format!("its format is {found}, this version writes and reads {FORMAT}")));
        }
        origin.check(&self.part_read("origin")?).map_err(|what| refused("tracker", &what))
    }
    /// Returns the state of a part of this part; it is empty if there is none of this name.
    pub(crate) fn part(&self, name: &str) -> Self {
        Self(self.0.get(name).cloned().unwrap_or_default())
    }
    /// Returns the state of the part `name` of this part, which fits any settings.
    pub(crate) fn part_read<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let none = Node::default();
        self.0.get(name).unwrap_or(&none).read().map_err(|error| refused(name, &error.to_string()))
    }
    /// Returns the state of the part `name` of this part, as [`SavedState::state`].
    pub(crate) fn part_state<S: ?Sized, T: DeserializeOwned + Validate<S>>(
        &self,
        name: &str,
        settings: &S,
    ) -> Result<T> {
        self.part(name).state(name, settings)
    }
}

/// Returns the error for a saved part that cannot be used.
pub(crate) fn refused(name: &str, what: &str) -> Error {
    Error::Invalid(format!("the saved {name} cannot be used: {what}"))
}

/// Reads the JSON text that `to_string` writes.
impl FromStr for SavedState {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        let read = serde_json::from_str(text);
        read.map_err(|error| Error::Invalid(format!("the saved state cannot be used: expected JSON: {error}")))
    }
}

/// Formats the value as JSON text.
impl fmt::Display for SavedState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&serde_json::to_string(&self.0).expect("plain data"))
    }
}
