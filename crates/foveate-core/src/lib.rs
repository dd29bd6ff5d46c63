#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod alarm;
pub mod assignment;
pub mod config;
pub mod conformance;
pub mod control;
mod engine;
mod ensemble;
pub mod extend;
pub mod gaze;
pub mod geometry;
pub mod identity;
pub mod multi;
#[cfg(feature = "onnx")]
mod onnx;
mod origin;
pub mod recognition;
pub mod reference;
mod saved_state;
pub mod scene;
pub mod seen;
pub mod start;
mod threads;
mod times;
pub mod tracker;
mod tree;

pub use config::{Config, Profile};
pub use control::Status;
pub use engine::{Filter, GazeControl, Monitor, Parts};
pub use foveate_base::{Error, Result};
pub use foveate_kernels::Level as KernelLevel;
pub use geometry::BBox;
pub use multi::MultiTracker;
pub use scene::{Detection, Image};
pub use seen::{Phase, Seen};
pub use tracker::Tracker;
