//! Follow an object through video by learning where to look.
//!
//! The particle filter with gaze control of Denil, Bazzani, Larochelle and de Freitas (2012). A tracker never sees the whole
//! frame: each particle, a guess of where the target is, looks at it through a small retina, sharp at one gaze and coarse
//! around it, and weighs itself by how well that matches the first frame. A policy learns which gaze tells most.
//!
//! ```text
//!            WHAT is it?               WHERE is it?                WHERE TO LOOK?
//!            identity                  control                     gaze
//!
//!  frame ─►  h(x, a): glimpse     ─►   wₜ ∝ wₜ₋₁ p(h|x,a) p/q  ─►   rₜ = reward(wₜ)
//!  scene     through retina            belief bₜ: N states         πₜ₊₁ learns from rₜ
//!            and encoder               with weights                     │
//!               ▲                          │ select, predict            │ aₜ₊₁: the next gaze
//!               │                          ▼                            │
//!               └───────────────────── x̃ ~ q(xₜ|xₜ₋₁) ◄─────────────────┘
//!                                          │
//!                                          └─►  Step  ─►  observe: tables, trace, video, report
//! ```
//!
//! | in the paper | here |
//! | --- | --- |
//! | the full algorithm (section 5) | [`tracker::Tracker`], its results [`step::Step`] |
//! | xₜ, aₜ, and where a gaze falls | [`geometry::State`], [`geometry::Gaze`], [`geometry::Fixation`] |
//! | vₜ, the foveated glimpse | [`identity::Retina`]: [`identity::Foveal`], on a [`identity::Pyramid`] |
//! | hₜ, first-layer features | [`identity::Encoder`]: [`identity::encoder::RbmEncoder`], [`identity::encoder::Raw`], [`identity::oriented::Oriented`] |
//! | the RBM and its training | [`rbm::Rbm`], [`rbm::Trainer`]; what it learns from, [`training`] |
//! | h⁽²⁾ₜ, zₜ: the multi-fixation RBM (section 2.2) | [`rbm::fixations::FixationRbm`], [`rbm::fixations::Trainer`]; what it learns from, [`training::sequences`] |
//! | p(cₜ \| h⁽²⁾ₜ) | [`softmax::Softmax`]; both on the last Δ looks: [`identity::MultiFixation`] |
//! | where to look for the class (future work in section 2.2) | [`rbm::fixations::Controller`] |
//! | d(h, τ) | [`identity::Distance`]: [`identity::distance::Kind`] |
//! | p(hₜ \| xₜ, aₜ) | [`identity::Appearance`]: [`identity::GazeAppearance`]; what is learned while tracking: [`identity::discriminant::Discriminant`] |
//! | p(xₜ \| xₜ₋₁), q | [`control::Dynamics`]: [`control::Autoregressive`]; with the camera: [`control::Guide`], as restless as the target: [`control::Pace`]; of its shape: [`control::Aspect`]; [`control::Proposal`]: [`control::Prior`], [`control::Mixture`] |
//! | p(detections \| xₜ), which the paper has not | [`control::Sighting`] |
//! | bₜ | [`control::Belief`] |
//! | selection | [`control::Resampling`] |
//! | rₜ | [`control::Reward`]: [`control::Concentration`] (the paper's), [`control::LogConcentration`], [`control::VarianceReduction`] |
//! | πₜ | [`gaze::Policy`]: [`gaze::Fixed`], [`gaze::Random`], [`gaze::Circular`], [`gaze::Hedge`], [`gaze::Exp3`], [`gaze::Anchor`], [`gaze::Pool`] |
//! | the digit videos (sections 6.1, 6.2) | [`scene::synthetic::Clutter`], [`scene::synthetic::Occlusion`] |
//!
//! # A run
//!
//! ```
//! use foveate::config::Config;
//! use foveate::scene::synthetic::{Clutter, Drawn};
//! use foveate::scene::{Digits, Scene};
//! use std::path::Path;
//!
//! // The world: a drawn 3 moves among four other digits; where it really is, is known.
//! let scene = Clutter { digit: 3, frames: 15, distractors: 4, ..Clutter::default() };
//! let video = scene.video(&Digits::drawn(1, 2))?;
//! let truth = video.truth().to_vec();
//!
//! // The tracker. What is left out has defaults; lengths are in half boxes.
//! let config = Config::parse(
//!     r#"
//!     particles = 200
//!     dynamics = { kind = "autoregressive" }
//!     retina = { kind = "foveal", side = 28, rings = [[16, 1], [24, 2]] }
//!     encoder = { kind = "raw", standardise = false }
//!     likelihood = { distance = { presence = { extra = 0.3, cap = 0.5 } }, sharpness = 60 }
//!     policy = { kind = "hedge", gamma = 5.0 }
//!     "#,
//!     "example",
//! )?;
//! let mut tracker = config.check(Path::new("."))?.tracker(1, 0)?;
//!
//! // The loop: a box in the first frame, then nothing but pixels.
//! for frame in video.source() {
//!     let frame = frame?;
//!     let (x, y) = truth[frame.index].centre();
//!     if frame.index == 0 {
//!         tracker.start(&frame, truth[0])?;
//!         continue;
//!     }
//!     let step = tracker.step(Scene { frame: &frame, detections: &[] });
//!     assert!((step.estimate.x - x).hypot(step.estimate.y - y) < 4.0);
//!     assert_eq!(step.rewards.len(), 9); // full information: Hedge asks for every gaze
//! }
//! # Ok::<(), foveate::Error>(())
//! ```
//!
//! Configurations choose the parts by name ([`config`]); every part is a trait with one to three methods that matter, and
//! every trait has its laws ([`conformance`]). The same seed gives the same track, for any number of threads ([`rng`]).
#![forbid(unsafe_code)]

mod alarm;
pub mod assignment;
pub mod autoencoder;
pub mod bench;
pub mod config;
pub mod conformance;
pub mod control;
pub mod error;
pub mod eval;
pub mod files;
pub mod gaze;
pub mod geometry;
pub mod gp;
pub mod identity;
pub mod kmeans;
pub mod many;
pub mod observe;
mod quiet;
pub mod rbm;
pub mod recognition;
pub mod rng;
pub mod rows;
pub mod run;
pub mod scene;
pub mod softmax;
pub mod start;
pub mod step;
pub mod tracker;
pub mod training;

pub use error::{Error, Result};

/// The code in the README is compiled with the documentation's tests.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
