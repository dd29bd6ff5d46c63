//! Restricted Boltzmann machines: the features of the identity pathway (section 2.1), and how they are learned.
//!
//! Atoms: nothing here knows of images, gazes or targets; data are rows of numbers.

mod checkpoint;
pub(crate) mod course;
pub mod factored;
pub mod fixations;
mod hmc;
pub(crate) mod io;
pub mod likelihood;
pub mod monitor;
#[cfg(test)]
mod oracle_tests;
pub(crate) mod product;
pub(crate) mod progress;
#[allow(clippy::module_inception)]
mod rbm;
mod recipe;
pub(crate) mod train;
mod units;
mod whiten;

pub use self::io::Metadata;
pub use self::product::warm;
pub use self::rbm::{Rbm, Visible};
pub use self::recipe::{Negative, Recipe, Sparsity};
pub use self::train::Trainer;
pub use self::whiten::Whitening;
