#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod crossings;
#[cfg(feature = "eval")]
pub mod eval;
#[cfg(feature = "eval")]
pub mod hide;
pub mod idx;
#[cfg(feature = "measure")]
pub mod measure;
pub mod spline;
pub mod strokes;
pub mod synthetic;
#[cfg(feature = "eval")]
pub mod training;

pub use idx::{Digits, Split};
