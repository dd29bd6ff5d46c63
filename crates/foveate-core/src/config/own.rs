//! A component of a user's own, as a configuration names it.

use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};

use foveate_base::{Error, Result};

/// A section whose `kind` the library does not have: the name of a registered component, and its settings.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnPart {
    kind: String,
    settings: toml::Table,
}

impl OwnPart {
    pub(super) fn new(kind: String, settings: toml::Table) -> Self {
        Self { kind, settings }
    }
    /// The name of the component.
    pub fn kind(&self) -> &str {
        &self.kind
    }
    /// The settings as a type of the component's own.
    ///
    /// # Errors
    /// [`Error::Config`] if they do not fit.
    pub(super) fn settings<S: DeserializeOwned>(&self, section: &str) -> Result<S> {
        let read = S::deserialize(toml::Value::Table(self.settings.clone()));
        read.map_err(|e| {
            let why = super::plainly::plainly(e.message());
            Error::Config(format!("{section}, kind `{}`: {why}", self.kind))
        })
    }
}

impl Serialize for OwnPart {
    fn serialize<S: Serializer>(&self, s: S) -> std::result::Result<S::Ok, S::Error> {
        let mut table = self.settings.clone();
        table.insert("kind".into(), toml::Value::String(self.kind.clone()));
        table.serialize(s)
    }
}
