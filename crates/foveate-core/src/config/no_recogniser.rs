//! No recogniser: this build has no learned weights.

use serde::{Deserialize, Deserializer, Serialize, de};

use super::ranges::Ranges;
use foveate_base::Result;

/// There is none without the feature `learn`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum RecogniserConfig {}

impl<'de> Deserialize<'de> for RecogniserConfig {
    fn deserialize<D: Deserializer<'de>>(_: D) -> std::result::Result<Self, D::Error> {
        Err(de::Error::custom("a recogniser needs the feature `learn`, which this build is without"))
    }
}

impl Ranges for RecogniserConfig {
    fn ranges(&self) -> Result<()> {
        match *self {}
    }
}
