//! The settings of the optimiser.

use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// How to search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Values remembered, 2 to 2000: the newest. Memory is 24 bytes × window², taken at the start.
    pub window: usize,
    /// Points before the process is used, 2 to 1000; twice the variables and 3 if absent.
    pub warm_up: Option<usize>,
    /// Points at which DIRECT may read the bound, for each point proposed; 1 to 100,000.
    pub evaluations: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { window: 300, warm_up: None, evaluations: 1000 }
    }
}

impl Settings {
    /// # Errors
    /// [`Error::Config`] with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, found: usize| {
            Err(Error::Config(format!("optimiser: {name} is {expected}; it is {found}")))
        };
        match *self {
            Self { window, .. } if !(2..=2000).contains(&window) => wrong("window", "2 to 2000 values", window),
            Self { warm_up: Some(n), .. } if !(2..=1000).contains(&n) => wrong("warm_up", "2 to 1000 points", n),
            Self { evaluations: n, .. } if !(1..=100_000).contains(&n) => wrong("evaluations", "1 to 100000", n),
            _ => Ok(()),
        }
    }
}
