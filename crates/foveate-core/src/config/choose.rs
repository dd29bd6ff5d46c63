//! How a configuration is chosen: by profile, by the name of one that ships, or given whole.

use super::Config;
use foveate_base::{Error, Result};

/// The configurations for any target in real video, by what they cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profile {
    /// A fifth of the particles, about twice the speed of the other: `natural-fast`.
    Fast,
    /// Fewest failures: `natural`.
    #[default]
    Balanced,
}

impl Profile {
    /// The name of its configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "natural-fast",
            Self::Balanced => "natural",
        }
    }
}

/// What stands for a configuration.
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
