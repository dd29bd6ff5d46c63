//! The functions that are fuzzed, and the parsers of the program that are no library.
#![allow(dead_code)]

pub mod bodies;
#[path = "../../crates/foveate-cli/src/cmd/serve/http.rs"]
mod http;
#[path = "../../crates/foveate-cli/src/cmd/trax/message.rs"]
mod message;
