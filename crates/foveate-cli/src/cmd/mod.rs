//! One file a command: its arguments, and what it does.

pub mod bench;
pub mod demo;
pub mod eval;
pub mod experiment;
pub mod look;
pub mod reproduce;
pub mod synth;
pub mod track;
pub mod train;
mod videos;
