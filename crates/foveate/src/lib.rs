//! Follow an object through video, and recognise it, by learning where to look.
#![forbid(unsafe_code)]

pub mod control;
pub mod error;
pub mod gaze;
pub mod geometry;
pub mod observe;
pub mod rbm;
pub mod rng;
pub mod rows;
pub mod scene;

pub use error::{Error, Result};
