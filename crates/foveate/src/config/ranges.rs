//! Numbers that make no sense are refused where they are read, so that the error shows their line.

use serde::{Deserialize, Deserializer};

use super::{Config, DynamicsConfig, LikelihoodConfig, PolicyConfig, RetinaConfig, RewardConfig};
use crate::control::{Around, Aspect, Confidence, Guide, Pace, Resampling, Search, Sighting, Vigilance};
use crate::identity::discriminant;
use crate::identity::distance::Kind;
use crate::identity::retina::Foveal;
use crate::many;
use crate::start::StartSpread;
use crate::{Error, Result};

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

/// Reads the number of particles.
pub(super) fn particles<'de, D: Deserializer<'de>>(d: D) -> std::result::Result<usize, D::Error> {
    let n = usize::deserialize(d)?;
    if (1..=1_000_000).contains(&n) {
        return Ok(n);
    }
    Err(serde::de::Error::custom(format!("expected 1 to 1000000 particles (100 to 1000 are usual), got {n}")))
}

pub(super) fn within(key: &str, value: f64, least: f64, most: f64) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::Config(format!("{key} is a number from {least} to {most}; it is {value}")))
}

impl Ranges for Config {
    fn ranges(&self) -> Result<()> {
        if !(1..=1_000_000).contains(&self.particles) {
            return Err(Error::Config(format!("particles is a number from 1 to 1000000; it is {}", self.particles)));
        }
        self.resampling.ranges()?;
        self.dynamics.ranges()?;
        self.aspect.ranges()?;
        self.pace.ranges()?;
        self.proposal.ranges()?;
        self.sighting.ranges()?;
        self.guide.ranges()?;
        self.start.ranges()?;
        self.retina.ranges()?;
        self.likelihood.ranges()?;
        self.policy.ranges()?;
        self.reward.ranges()?;
        self.vigilance.ranges()?;
        self.confidence.ranges()?;
        self.recogniser.ranges()?;
        self.discriminant.ranges()?;
        self.rivals.ranges()?;
        self.search.ranges()?;
        self.many.ranges()
    }
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

checked!(Around, Aspect, Confidence, Guide, Pace, Resampling, Search, Sighting, StartSpread, Vigilance);
checked!(discriminant::Settings, many::Settings);

impl Ranges for DynamicsConfig {
    fn ranges(&self) -> Result<()> {
        let Self::Autoregressive(motion) = self;
        motion.check()?;
        within("dynamics.velocity", motion.velocity, 0.0, 100.0)?;
        within("dynamics.position", motion.position, 0.0, 100.0)?;
        within("dynamics.log_scale", motion.log_scale, 0.0, 5.0)?;
        within("dynamics.angle", motion.angle, 0.0, 100.0)
    }
}

impl Ranges for RetinaConfig {
    fn ranges(&self) -> Result<()> {
        let Self::Foveal(config) = self;
        Foveal::new(config.clone()).map(|_| ())
    }
}

impl Ranges for LikelihoodConfig {
    fn ranges(&self) -> Result<()> {
        super::sharpness(self)?;
        within("likelihood.dim_familiar", self.dim_familiar.into(), 0.0, 1.0)?;
        if let Some(sharpness) = self.sharpness {
            within("likelihood.sharpness", sharpness, 1e-9, 1e9)?;
        }
        if let Some(rule) = self.calibrate {
            within("likelihood.calibrate.nats", rule.nats, 1e-9, 1e9)?;
            within("likelihood.calibrate.least", rule.least, 1e-9, 1e9)?;
            within("likelihood.calibrate.most", rule.most, rule.least, 1e9)?;
        }
        if let Kind::Presence { extra, cap } = self.distance {
            within("likelihood.distance.presence.extra", extra.into(), 0.0, 1.0)?;
            within("likelihood.distance.presence.cap", cap.into(), 1e-6, 1e6)?;
        }
        Ok(())
    }
}

impl Ranges for PolicyConfig {
    fn ranges(&self) -> Result<()> {
        match self {
            Self::Fixed { u, v } => {
                within("policy.u", *u, -10.0, 10.0)?;
                within("policy.v", *v, -10.0, 10.0)
            }
            Self::Random { grid } | Self::Circular { grid } => grid.check(),
            Self::Hedge { grid, gamma } => {
                gamma.check("policy.gamma", 1e9)?;
                grid.check()
            }
            Self::Pool { grid, gamma, forget, looks } => {
                gamma.check("policy.gamma", 1e9)?;
                within("policy.forget", *forget, 0.0, 1.0)?;
                within("policy.looks", looks.unwrap_or(1.0), 1e-3, 1e3)?;
                grid.check()
            }
            Self::Exp3(c) => c.ranges(),
            Self::Exp3AsPrinted(c) => c.ranges(),
            Self::Exp3Ix(c) => c.ranges(),
            Self::Exp3S(c) => c.ranges(),
            Self::GpUcb(settings) => settings.check(),
            Self::Anchor { policy } => policy.ranges(),
        }
    }
}

impl Ranges for RewardConfig {
    fn ranges(&self) -> Result<()> {
        super::reward(*self).map(|_| ())
    }
}
