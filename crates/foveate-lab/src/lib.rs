#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod crossings;
pub mod eval;
pub mod hide;
pub mod idx;
pub mod spline;
pub mod strokes;
pub mod synthetic;
pub mod training;

pub use idx::{Digits, Split};
