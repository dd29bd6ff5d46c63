//! Follow an object through video, and recognise it, by learning where to look.
#![forbid(unsafe_code)]

pub mod bench;
pub mod config;
pub mod conformance;
pub mod control;
pub mod error;
pub mod eval;
pub mod files;
pub mod gaze;
pub mod geometry;
pub mod identity;
pub mod observe;
mod quiet;
pub mod rbm;
pub mod rng;
pub mod rows;
pub mod run;
pub mod scene;
pub mod start;
pub mod step;
pub mod tracker;
pub mod training;

pub use error::{Error, Result};
