#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod filters;
pub mod rbm;
pub mod softmax;
pub mod training;

/// Returns true as soon as a computation is to stop. Long computations call it between pieces of work and then end with
/// [`foveate_base::Error::Stopped`]; it is called from several threads at once.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);
