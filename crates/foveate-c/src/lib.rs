#![doc = include_str!("../README.md")]
//!
//! This crate has no API for Rust: `include/foveate.h` declares the functions of `exports.rs`. It adds no algorithm. Every function
//! catches panics, checks its arguments and returns a code. A handle is a key of a table, not an address: a function that receives a
//! handle that was freed, or one that never existed, finds no entry and returns a code.
#![deny(unsafe_code)]

mod errors;
#[allow(unsafe_code)] // reads and writes the caller's memory, under names for the linker
mod exports;
mod handles;
#[cfg(test)]
mod header;
mod types;
