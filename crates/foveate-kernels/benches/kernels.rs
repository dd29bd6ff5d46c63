//! Rates of the kernels beside the limits of this core, one JSON line each: `cargo bench -p foveate-kernels`.
//!
//! The clock is the thread's CPU time; a figure is the median of 15 runs of at least 10 ms.
fn main() {}
