//! One file a command: its arguments, and what it does.

pub mod eval;
pub mod synth;
pub mod train;
