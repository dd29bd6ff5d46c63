#![doc = include_str!("../README.md")]
//!
//! [`App::ask`] answers a message, [`App::picture`] gives a frame's pixels, [`App::push`] takes those of a camera. In a browser
//! they are called through the functions of `exports.rs`, and files are read through the one function that the page gives.
//! [`Package`] is the tracker of the JavaScript package, behind one more function.

#![deny(unsafe_code)]

mod app;
#[cfg(target_arch = "wasm32")]
#[allow(unsafe_code)] // for names that the linker must not change; no block of it
mod exports;
mod lesson;
mod open;
mod package;
mod store;

pub use app::App;
pub use package::Package;
pub use store::{Paths, Store};
