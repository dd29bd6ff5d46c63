#![doc = include_str!("../README.md")]
//!
//! # How it works
//!
//! Gaussian process regression (Rasmussen & Williams 2006).
//!
//! r = f(a) + σₙ δ, f ~ GP(0, k). Given the newest observations ([`Gp::push`]) the posterior of f at a is
//!
//! m(a) = kᵀ (K + σₙ² I)⁻¹ r, s²(a) = k(a, a) − kᵀ (K + σₙ² I)⁻¹ k ([`Gp::predict`], [`Gp::predict_many`]),
//!
//! and the hyper-parameters are those of the largest posterior density under their [`Priors`] ([`Gp::fit`]).
//!
//! The mean is zero: to standardise the values is the caller's business. Cost: an observation takes n² operations while the
//! window fills, n³/6 once it slides; a prediction n²/2; a step of the fit n³/2. Memory: 24 bytes × window², all taken at the start.
//!
//! # Guarantees
//! - No call but [`Gp::save`] (and [`Gp::predict`] beyond 1024 points) allocates, and none panics or returns a number that is not finite, whatever the values: duplicate points, constant or huge
//!   values, no noise. Points and values beyond ±1e100 count as ±1e100, hyper-parameters outside [1e-12, 1e12] (noise: [0, 1e12])
//!   as the nearest inside.
//! - 1e-10 σₘ² is added to the diagonal ([`Gp::jitter`]); a hundred times that, and so on, should the factor break down.
//! - The state depends only on kernel, window, hyper-parameters, points and values, to the last bit: a process
//!   restored from [`Gp::save`] continues with the same bits.
#![forbid(unsafe_code)]

mod bfgs;
pub mod direct;
mod factor;
mod fit;
#[cfg(test)]
mod functions;
mod hyper;
mod kernel;
pub mod optimiser;
#[cfg(test)]
mod oracle_tests;
mod posterior;

pub use fit::Fit;
pub use hyper::{Priors, StudentT};
pub use kernel::{Hyper, Kernel};
pub use posterior::{Gp, Saved};
