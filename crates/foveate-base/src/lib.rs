#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod error;
pub mod files;
pub mod memory;
pub mod quiet;
pub mod rng;
pub mod rows;
pub mod sink;
pub mod text;
pub mod thread;

pub use error::{Error, Result};
