//! Follow an object through video, and recognise it, by learning where to look.
#![forbid(unsafe_code)]

pub mod error;
pub mod eval;
pub mod files;
pub mod geometry;
pub mod rng;
pub mod rows;
pub mod scene;

pub use error::{Error, Result};
