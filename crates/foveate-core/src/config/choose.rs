//! How a configuration is chosen: by profile, by the name of one that ships, or given whole.

use super::Config;
use crate::tree::Node;
use foveate_base::{Error, Result};

/// The configurations for any target in real video, by their cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Profile {
    /// A quarter of the particles, nearly three times the speed of the other: `natural-fast`.
    Fast,
    /// One tracker with all components: `natural`.
    #[default]
    Balanced,
    /// Three `natural` trackers that vote: fewest failures, earliest reports of losses, a third of the speed on one core: `natural-committee`.
    Accurate,
}

impl Profile {
    /// The name of its configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "natural-fast",
            Self::Balanced => "natural",
            Self::Accurate => "natural-committee",
        }
    }
    /// A profile by its name in lower case: `fast`, `balanced` or `accurate`.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "fast" => Some(Self::Fast),
            "balanced" => Some(Self::Balanced),
            "accurate" => Some(Self::Accurate),
            _ => None,
        }
    }
}

impl Config {
    /// The configuration that a text names or holds: a profile, a configuration that ships, or TOML, which has more than one line.
    ///
    /// # Errors
    /// [`Error::Config`] where nothing has the name, or a line of the TOML is wrong.
    pub fn named_or_parsed(text: &str) -> Result<Self> {
        match Profile::named(text) {
            _ if text.contains('\n') => Self::parse(text, "the configuration"),
            Some(profile) => profile.config(),
            None => text.config(),
        }
    }

    /// The same with another gaze policy, of that one's default settings; as it is where it has that policy.
    ///
    /// # Errors
    /// [`Error::Config`] where no policy has the name.
    pub fn with_policy(self, name: &str) -> Result<Self> {
        match name {
            name if name == self.policy_kind() => Ok(self),
            // The only one with a setting that has no default.
            "anchor" => self.set(r#"policy={ kind = "anchor", policy = { kind = "hedge" } }"#),
            name => self.set(&format!("policy.kind={name}")),
        }
    }

    /// The name of its gaze policy.
    pub fn policy_kind(&self) -> String {
        Node::of(&self.policy).get("kind").and_then(|kind| kind.read().ok()).unwrap_or_default()
    }
}

/// A value that selects a configuration.
pub trait Configure {
    /// The configuration.
    fn config(self) -> Result<Config>;
}

impl Configure for Config {
    fn config(self) -> Result<Config> {
        Ok(self)
    }
}

impl Configure for &Config {
    fn config(self) -> Result<Config> {
        Ok(self.clone())
    }
}

impl Configure for Profile {
    fn config(self) -> Result<Config> {
        self.name().config()
    }
}

impl Configure for &str {
    fn config(self) -> Result<Config> {
        Config::builtin(self).unwrap_or_else(|| {
            let names = Config::names().join(", ");
            Err(Error::Config(format!("no configuration is called {self}; there are {names}")))
        })
    }
}
