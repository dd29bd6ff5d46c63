#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod autoencoder;
pub mod filters;
pub mod network;
pub mod rbm;
pub mod softmax;
