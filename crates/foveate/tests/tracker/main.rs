//! The tracker through its public interface. One program of tests: they run beside each other, and are linked once.

mod attention;
mod box_regression;
mod committee;
#[path = "../common/mod.rs"]
mod common;
mod config;
mod damage;
mod determinism;
mod extend;
mod kalman;
mod leap;
mod motion;
mod multi;
mod observe;
mod otb;
mod pool;
mod proposals;
mod recognise;
mod recovery;
mod retina;
mod saliency;
mod second_opinion;
mod sensor;
mod status;
mod surface;
mod verbs;
