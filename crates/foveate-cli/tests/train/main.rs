//! `foveate train` as a user meets it. One program of tests: they run beside each other, and are linked once.

mod classifier;
mod confidence;
mod fixations;
mod kmeans;
mod photographs;
#[path = "../place/mod.rs"]
mod place;
mod rbm;
mod training;
mod variation;
