//! Follow one target or many through video, on a CPU.
//!
//! You give a box in the first picture. Every later picture answers a box, its covariance, a status, and the probability that the
//! target is lost. [`Tracker`] follows one target, [`MultiTracker`] many; a [`Profile`], a name or a [`Config`] chooses
//! their components.
//!
//! ```
//! use foveate::{BBox, Image, Profile, Tracker};
//!
//! // Pictures: a bright square that moves by 4 pixels a frame. Yours come from a video, a camera or a buffer.
//! let picture = |t: usize| {
//!     let inside = |x: usize, y: usize| (50 + 4 * t..74 + 4 * t).contains(&x) && (40..64).contains(&y);
//!     let pixels: Vec<u8> = (0..160 * 120).map(|i| if inside(i % 160, i / 160) { 200 } else { (i % 7) as u8 }).collect();
//!     Image::from_grey8(160, 120, &pixels)
//! };
//!
//! let mut tracker = Tracker::new(Profile::Fast)?;
//! tracker.init(&picture(0)?, BBox::new(46.0, 36.0, 32.0, 32.0))?; // left, top, width, height; pixels from 0
//! for t in 1..8 {
//!     let picture = picture(t)?;
//!     let seen = tracker.update(&picture)?;
//!     let (x, _) = seen.bbox.centre();
//!     assert!((x - (62.0 + 4.0 * t as f64)).abs() < 4.0 && seen.is_usable());
//! }
//! # Ok::<(), foveate::Error>(())
//! ```
//!
//! # The algorithm
//!
//! It is the particle filter with gaze control of Denil, Bazzani, Larochelle and de Freitas (2012). Each particle is a guess of where
//! the target is. It reads the picture through a retina about a gaze, and weighs itself by how well that fits the
//! template. A policy may learn which gaze is the most informative. In the profiles for real video the gaze is fixed and the retina has
//! one window; `docs/looking.md` compares the configurations that learn their gaze.
//!
//! ```text
//!            WHAT is it?               WHERE is it?                WHERE TO LOOK?
//!            identity                  control                     gaze
//!
//!  image ─►  h(x, a): glimpse     ─►   wₜ ∝ wₜ₋₁ p(h|x,a) p/q  ─►   rₜ = reward(wₜ)
//!  scene     through retina            belief bₜ: N states         πₜ₊₁ learns from rₜ
//!            and encoder               with weights                     │
//!               ▲                          │ select, predict            │ aₜ₊₁: the next gaze
//!               │                          ▼                            │
//!               └───────────────────── x̃ ~ q(xₜ|xₜ₋₁) ◄─────────────────┘
//!                                          │
//!                                          └─►  Seen  ─►  report: tables, trace, video, page
//! ```
//!
//! | in the paper | here |
//! | --- | --- |
//! | the full algorithm (section 5) | [`Tracker`]; everything that a frame computed: [`Seen`] |
//! | xₜ, aₜ, and where a gaze falls | [`geometry::State`], [`geometry::Gaze`], [`geometry::Fixation`] |
//! | vₜ, the foveated glimpse | [`identity::Retina`]: [`identity::Foveal`], on a [`identity::Pyramid`] |
//! | hₜ, first-layer features | [`identity::Encoder`]: [`identity::encoder::Raw`], [`identity::oriented::Oriented`]; with the feature `learn` RBMs and others, with `onnx` networks from ONNX files |
//! | the RBM and its training; h⁽²⁾ₜ, the multi-fixation RBM (section 2.2) | `learn::rbm`; their training data, `lab::training` |
//! | p(cₜ \| h⁽²⁾ₜ) | [`identity::Recognizer`], `learn::softmax` |
//! | d(h, τ) | [`identity::Distance`]: [`identity::distance::Kind`] |
//! | p(hₜ \| xₜ, aₜ) | [`identity::Appearance`]: [`identity::GazeAppearance`]; learned while tracking: [`identity::discriminant::Discriminant`], [`identity::colour::Colour`] |
//! | p(xₜ \| xₜ₋₁), q | [`control::Dynamics`]: [`control::Autoregressive`]; camera motion: [`control::CameraMotion`]; [`control::Proposal`]: [`control::Prior`], [`control::Mixture`] |
//! | p(detections \| xₜ), which the paper does not have | [`control::DetectionLikelihood`] |
//! | bₜ | [`control::Belief`] |
//! | selection | [`control::Resampling`] |
//! | rₜ | [`control::Reward`]: [`control::Concentration`] (the paper's), [`control::LogConcentration`], [`control::VarianceReduction`], [`control::Agreement`] |
//! | πₜ | [`gaze::Policy`]: [`gaze::Fixed`], [`gaze::Random`], [`gaze::Circular`], [`gaze::Hedge`], [`gaze::Exp3`], [`gaze::GpUcb`], [`gaze::Pool`], [`gaze::ExploreThenCommit`], [`gaze::Anchor`] |
//! | the digit videos (sections 6.1, 6.2) | `lab::synthetic` |
//!
//! Configurations choose the components by name ([`config`]). Every component is a trait with one to three methods that matter, and every trait has its
//! laws ([`conformance`]). The same seed gives the same track, for any number of threads ([`rng`]).
//!
//! # Components of your own
//!
//! A policy, an encoder, an observation model, a proposal, a detector or a reward of your own is a type that implements one trait of
//! [`extend`]. Register it by name in [`extend::Parts`]; a configuration with these components may then name it, for one target and for many.
//! The laws that it must keep are functions in [`extend::conformance`]. `docs/extend.md` shows each step, and how your own binary gets the
//! whole program with your components.
//!
//! # Features
//!
//! | feature | default | adds |
//! | --- | --- | --- |
//! | `threads` | yes | particles and targets in parallel; results do not change |
//! | `video` | yes | `video`: image folders, MP4, the ffmpeg program, annotation files |
//! | `report` | yes | `report`: tables, annotated video, the report page, runs from a source to observers |
//! | `learn` | no | `learn`: RBMs, k-means, softmax; learned encoders and recognisers, and the models that ship |
//! | `onnx` | no | encoders and object detectors from ONNX files (`encoder.kind`, `detector.kind`: `onnx`); its build takes minutes |
//! | `lab` | no | `lab`: evaluation, training runs, synthetic scenes |
#![forbid(unsafe_code)]

pub use foveate_base::{Error, Result, files, memory};
pub use foveate_core::{
    BBox, Config, Detection, Image, MultiTracker, Phase, Profile, Seen, Status, Tracker, config, extend, geometry,
};
pub use foveate_gp as gp;
#[cfg(feature = "lab")]
pub use foveate_lab as lab;
#[cfg(feature = "learn")]
pub use foveate_learn as learn;
#[cfg(feature = "report")]
pub use foveate_report as report;
#[cfg(feature = "video")]
pub use foveate_video as video;

// For the other crates, the tests and the benchmarks of the project: without any promise of stability.
#[doc(hidden)]
pub use foveate_base::{error, quiet, rng, rows, sink, text, thread};
#[doc(hidden)]
pub use foveate_core::{
    Filter, GazeControl, KernelLevel, Monitor, Parts, assignment, conformance, control, gaze, identity, multi,
    recognition, reference, scene, seen, start, tracker,
};

/// The code of the documents runs as tests.
#[cfg(all(doctest, feature = "video"))]
mod documents {
    #[doc = include_str!("../../../README.md")]
    struct Readme;
    #[doc = include_str!("../../../docs/questions.md")]
    struct Questions;
    #[doc = include_str!("../../../docs/configuration.md")]
    struct Configuration;
}
