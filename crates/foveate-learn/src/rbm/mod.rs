//! Restricted Boltzmann machines: the features of the identity pathway (section 2.1), and how they are learned.
//!
//! Building blocks without images, gazes or targets; data are rows of numbers.

pub mod fixations;
pub mod io;
pub mod likelihood;
pub mod monitor;
pub(crate) mod number;
pub mod online;
#[cfg(test)]
mod oracle_tests;
pub mod product;
#[allow(clippy::module_inception)]
mod rbm;
mod recipe;
pub mod train;
pub mod units;
mod visible;
mod whiten;

pub use self::io::Metadata;
pub use self::online::OnlineRbm;
pub use self::rbm::Rbm;
pub use self::recipe::{Negative, Recipe, Sparsity};
pub use self::train::Trainer;
pub use self::visible::Visible;
pub use self::whiten::Whitening;
