//! The paper's experiments as a reader runs them.

#[path = "../../../crates/foveate-cli/tests/browser/mod.rs"]
mod browser;
#[cfg(debug_assertions)]
mod faults;
#[cfg(debug_assertions)]
#[path = "../../../crates/foveate-cli/tests/faults/job.rs"]
mod job;
mod mcrbm;
mod pages;
#[path = "../../../crates/foveate-cli/tests/train/photographs.rs"]
mod photographs;
#[path = "../../../crates/foveate-cli/tests/place/mod.rs"]
mod place;
mod recognise;
mod reproduce;
#[path = "../../../crates/foveate-cli/tests/train/training.rs"]
mod training;
