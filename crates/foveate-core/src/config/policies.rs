//! Names → policies.

use serde::{Deserialize, Serialize};

use super::bandits::{Exp3AsPrintedConfig, Exp3Config, Exp3IxConfig, Exp3SConfig};
use super::own::OwnPart;
use super::parts::Parts;
use super::ranges::Ranges;
use crate::gaze::{
    Anchor, Bayes, Circular, ExploreThenCommit, Fixed, GpUcb, Grid, Hedge, Policy, Pool, Random, Schedule,
};
use crate::geometry::Gaze;
use foveate_base::Result;
use foveate_base::error::within;

/// The policies there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields, remote = "Self")]
#[non_exhaustive]
pub enum PolicyConfig {
    /// Always the same gaze.
    Fixed {
        /// Horizontal, template units.
        #[serde(default)]
        u: f64,
        /// Vertical, downwards, template units.
        #[serde(default)]
        v: f64,
    },
    /// A random gaze of the grid (section 4.1).
    Random {
        /// The gazes.
        #[serde(default)]
        grid: Grid,
    },
    /// The grid's gazes in order (section 4.1).
    Circular {
        /// The gazes.
        #[serde(default)]
        grid: Grid,
    },
    /// Hedge, with full information (section 4.2).
    Hedge {
        /// The gazes.
        #[serde(default)]
        grid: Grid,
        /// Learning rate, above 0. The default follows the theory for any number of frames.
        #[serde(default = "anytime")]
        gamma: Schedule,
    },
    /// A logarithmic opinion pool: all gazes of the grid in every frame, with learned weights.
    Pool {
        /// The gazes.
        #[serde(default)]
        grid: Grid,
        /// Learning rate, above 0. The default follows the theory for any number of frames.
        #[serde(default = "anytime")]
        gamma: Schedule,
        /// Share of the learned weights that fades each frame, 0 to 1.
        #[serde(default = "fading")]
        forget: f64,
        /// Sum of the weights, 0.001 to 1000. The default is the number of gazes.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        looks: Option<f64>,
    },
    /// Scores all gazes of the grid for some frames, then keeps the best one; all again while the target is lost. For a retina that covers
    /// one patch of the target.
    ExploreThenCommit {
        /// The gazes.
        #[serde(default)]
        grid: Grid,
        /// Frames of exploration.
        #[serde(default = "exploring")]
        frames: u64,
        /// Interval of later exploration in frames; 0 never explores again.
        #[serde(default)]
        every: u64,
    },
    /// EXP3: the reward of one gaze a frame (section 4.3), with the unbiased estimate of Auer et al.
    Exp3(Exp3Config),
    /// EXP3 as printed, which divides by another probability than that of the draw.
    Exp3AsPrinted(Exp3AsPrintedConfig),
    /// EXP3-IX (Neu 2015): explores by damping its estimates.
    Exp3Ix(Exp3IxConfig),
    /// EXP3.S (Auer et al. 2002): gazes share weight, for rewards that change.
    Exp3S(Exp3SConfig),
    /// Bayesian optimisation over a continuous square of gazes (section 4.4).
    GpUcb(Bayes),
    /// Two gazes a frame: the centre and the choice of another policy.
    Anchor {
        /// The other policy.
        policy: Box<PolicyConfig>,
    },
    /// A registered one.
    #[serde(skip)]
    Own(OwnPart),
}

fn anytime() -> Schedule {
    Schedule::Anytime
}

fn exploring() -> u64 {
    30
}

fn fading() -> f64 {
    0.05
}

/// The policy of these settings.
pub(super) fn policy(config: &PolicyConfig, parts: &Parts) -> Result<Box<dyn Policy>> {
    Ok(match config {
        PolicyConfig::Fixed { u, v } => Box::new(Fixed::new(Gaze { u: *u, v: *v, arm: None })),
        PolicyConfig::Random { grid } => Box::new(Random::new(grid.gazes())),
        PolicyConfig::Circular { grid } => Box::new(Circular::new(grid.gazes())),
        PolicyConfig::Hedge { grid, gamma } => Box::new(Hedge::new(grid.gazes(), *gamma)?),
        PolicyConfig::Pool { grid, gamma, forget, looks } => {
            let gazes = grid.gazes();
            let looks = looks.unwrap_or(gazes.len() as f64);
            Box::new(Pool::new(gazes, *gamma, *forget, looks)?)
        }
        PolicyConfig::ExploreThenCommit { grid, frames, every } => {
            Box::new(ExploreThenCommit::new(grid.gazes(), *frames, *every)?)
        }
        PolicyConfig::Exp3(c) => c.build()?,
        PolicyConfig::Exp3AsPrinted(c) => c.build()?,
        PolicyConfig::Exp3Ix(c) => c.build()?,
        PolicyConfig::Exp3S(c) => c.build()?,
        PolicyConfig::GpUcb(settings) => Box::new(GpUcb::new(settings.clone())?),
        PolicyConfig::Anchor { policy: inner } => Box::new(Anchor::new(Gaze::CENTRE, policy(inner, parts)?)),
        PolicyConfig::Own(part) => parts.policy(part)?,
    })
}

impl PolicyConfig {
    /// Returns whether it plans more than one gaze a frame.
    pub(super) fn looks_often(&self) -> bool {
        matches!(self, Self::Hedge { .. } | Self::Pool { .. } | Self::Anchor { .. })
    }
    /// Whether it may commit to a gaze other than the centre, so that the appearance is learned again at that gaze.
    pub(super) fn commits_elsewhere(&self) -> bool {
        match self {
            Self::Fixed { u, v } => (*u, *v) != (0.0, 0.0),
            _ => !self.gazes_to_commit_to().is_empty(),
        }
    }
    /// The gazes that it chooses one of and commits to; none if it does not choose.
    pub(super) fn gazes_to_commit_to(&self) -> Vec<Gaze> {
        match self {
            Self::ExploreThenCommit { grid, .. } => grid.gazes(),
            _ => vec![],
        }
    }
    /// Returns whether it needs the first picture beside the rewards.
    #[cfg(feature = "learn")]
    fn needs_first_picture(&self) -> bool {
        match self {
            Self::GpUcb(settings) => settings.saliency > 0.0 || settings.rehearsal > 0.0,
            Self::Anchor { policy } => policy.needs_first_picture(),
            _ => false,
        }
    }
    /// Fails if it needs a first picture, which a recogniser does not have.
    #[cfg(feature = "learn")]
    pub(super) fn recognises(&self) -> Result<()> {
        if !self.needs_first_picture() {
            return Ok(());
        }
        Err(foveate_base::Error::Config(
            "recogniser.policy: a recogniser has no first picture to predict rewards from; leave out saliency and rehearsal"
                .into(),
        ))
    }
    /// Returns whether its prior is the reward of each gaze in the first picture.
    pub(super) fn rehearses(&self) -> bool {
        matches!(self, Self::GpUcb(settings) if settings.rehearsal > 0.0)
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
            Self::ExploreThenCommit { grid, frames, every } => {
                within("policy.every", *every as f64, 0.0, 1e6)?;
                within("policy.frames", *frames as f64, 0.0, 1e6)?;
                grid.check()
            }
            Self::Exp3(c) => c.check(),
            Self::Exp3AsPrinted(c) => c.check(),
            Self::Exp3Ix(c) => c.check(),
            Self::Exp3S(c) => c.check(),
            Self::GpUcb(settings) => settings.check(),
            Self::Anchor { policy } => policy.ranges(),
            Self::Own(_) => Ok(()),
        }
    }
}
