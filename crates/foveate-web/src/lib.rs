#![doc = include_str!("../README.md")]
//!
//! [`App::ask`] answers a message, [`App::picture`] gives a frame's pixels, [`App::push`] takes those of a camera. In a browser
//! they are called through the functions of `exports.rs`, and files are read through the one function that the page gives.

mod app;
#[cfg(target_arch = "wasm32")]
mod exports;
mod lesson;
mod live;
mod log;
mod message;
mod save;
mod session;
mod store;

pub use app::App;
pub use store::{Paths, Store};
