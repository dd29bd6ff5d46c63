//! Numbers that make no sense are refused where they are read, so that the error shows their line.

use serde::{Deserialize, Deserializer};

use crate::control::{
    CameraMotion, ConfidenceModel, ConsistencySettings, DetectionLikelihood, DistractorSettings, LocalSearchSettings,
    RedetectionSettings, Resampling,
};
use crate::identity::{box_regression, colour, discriminant};
use crate::multi;
use crate::scene::SensorSettings;
use crate::start::StartSpread;
use foveate_base::Result;

/// Settings with numbers in them: not one may be NaN, infinite or out of range.
pub(super) trait Ranges {
    /// Fails naming the key.
    fn ranges(&self) -> Result<()>;
}

/// Reads a section and checks its numbers; the error then has the section's place in the file.
pub(super) fn in_range<'de, D: Deserializer<'de>, T: Deserialize<'de> + Ranges>(
    d: D,
) -> std::result::Result<T, D::Error> {
    let section = T::deserialize(d)?;
    section.ranges().map_err(serde::de::Error::custom)?;
    Ok(section)
}

/// Reads a whole number from 1 to `most`; `what` is its name in the error.
fn count<'de, D: Deserializer<'de>>(d: D, most: usize, what: &str) -> std::result::Result<usize, D::Error> {
    let n = usize::deserialize(d)?;
    if (1..=most).contains(&n) {
        return Ok(n);
    }
    Err(serde::de::Error::custom(format!("expected {what}, got {n}")))
}

/// Reads the number of particles.
pub(super) fn particles<'de, D: Deserializer<'de>>(d: D) -> std::result::Result<usize, D::Error> {
    count(d, 1_000_000, "1 to 1000000 particles (100 to 1000 are usual)")
}

/// Reads the number of members of a committee.
pub(super) fn committee<'de, D: Deserializer<'de>>(d: D) -> std::result::Result<usize, D::Error> {
    count(d, 64, "a committee of 1 to 64 trackers (3 to 7 are usual)")
}

/// A single tracker has no vote.
pub(super) fn alone() -> usize {
    1
}

pub(super) fn is_alone(members: &usize) -> bool {
    *members == alone()
}

/// A section that is left out is in range.
impl<T: Ranges> Ranges for Option<T> {
    fn ranges(&self) -> Result<()> {
        self.as_ref().map_or(Ok(()), T::ranges)
    }
}

/// Sections of other modules, which check themselves.
macro_rules! checked {
    ($($section:ty),* $(,)?) => {$(
        impl Ranges for $section {
            fn ranges(&self) -> Result<()> {
                self.check()
            }
        }
    )*};
}

checked!(
    CameraMotion,
    ConfidenceModel,
    ConsistencySettings,
    DetectionLikelihood,
    DistractorSettings,
    SensorSettings,
    LocalSearchSettings,
    RedetectionSettings,
    Resampling,
    StartSpread,
    box_regression::Settings,
    colour::Settings,
    discriminant::Settings,
    discriminant::Variation,
    multi::Settings,
);
#[cfg(feature = "learn")]
checked!(crate::identity::online::Settings);
