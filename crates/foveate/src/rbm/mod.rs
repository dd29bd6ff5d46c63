//! Restricted Boltzmann machines: the features of the identity pathway (section 3.2), and how they are learned.
//!
//! Atoms: nothing here knows of images, gazes or targets; data are rows of numbers.

pub mod likelihood;
pub mod monitor;
#[cfg(test)]
mod oracle_tests;
mod product;
#[allow(clippy::module_inception)]
mod rbm;
mod recipe;
mod train;
mod units;

pub use self::rbm::{Rbm, Visible};
pub struct Metadata {
    pub retina: String,
}
impl Rbm {
    pub fn from_bytes(_: &[u8], _: &std::path::Path) -> crate::Result<(Rbm, Metadata)> {
        todo!()
    }
    pub fn load(_: &std::path::Path) -> crate::Result<(Rbm, Metadata)> {
        todo!()
    }
}
pub use self::recipe::{Negative, Recipe, Sparsity};
pub use self::train::Trainer;
