//! A component of a user's own, as a configuration names it.

use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};

use crate::tree::{Entry, Node, Value};
use foveate_base::{Error, Result};

/// A section whose `kind` the library does not have: the name of a registered component, and its settings.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnPart {
    kind: String,
    settings: Vec<Entry>,
}

impl OwnPart {
    pub(super) fn new(kind: String, settings: Vec<Entry>) -> Self {
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
        Node::from(Value::Section(self.settings.clone())).read().map_err(|problem| {
            let why = super::toml_errors::without_types(problem.message());
            Error::Config(format!("{section}, kind `{}`: {why}", self.kind))
        })
    }
}

impl Serialize for OwnPart {
    fn serialize<S: Serializer>(&self, s: S) -> std::result::Result<S::Ok, S::Error> {
        let mut all = self.settings.clone();
        all.push(Entry::new("kind", Value::Text(self.kind.clone())));
        all.sort_by(|a, b| a.key.cmp(&b.key));
        Node::from(Value::Section(all)).serialize(s)
    }
}
