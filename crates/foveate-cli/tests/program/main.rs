//! The program as a user meets it. One program of tests: they run beside each other, and are linked once.

mod annotate;
mod batch;
#[path = "../browser/mod.rs"]
mod browser;
mod commands;
mod convert;
mod facade;
mod files;
mod kernels;
mod measure;
mod pages;
#[path = "../place/mod.rs"]
mod place;
mod recognise;
mod results;
mod sandbox;
mod synth_eval;
mod track;
mod trax;
