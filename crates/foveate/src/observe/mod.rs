//! THE RESULTS GOING OUT: observers of a run, which read each step and write files; the loop does not know them.

pub mod draw;
mod font;
mod sink;
