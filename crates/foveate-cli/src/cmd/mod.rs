//! One file a command: its arguments, and what it does.

pub mod completions;
pub mod configs;
mod configure;
pub mod convert;
pub mod demo;
pub mod eval;
pub mod look;
pub mod man;
pub mod reproduce;
mod results;
pub mod serve;
pub mod synth;
pub mod tiles;
pub mod track;
pub mod train;
pub mod trax;
mod videos;
