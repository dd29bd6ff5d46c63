//! The multi-fixation RBM (section 2.2; Larochelle & Hinton 2010): glimpses from several places, gathered into one code.
//!
//! E(x₁..K, h, y) = −Σₖ hᵀW(k)(xₖ − μ) − bᵀΣₖxₖ − cᵀh − dᵀy − hᵀUy, with W(k) = Pᵀ diag(V zₖ) Fᵀ: third order, for the place zₖ of a
//! fixation gates the factors that lead from its glimpse xₖ to the hidden units h. xₖ has n_v values in 0 to 1, D factors
//! join them to n_h hidden units, y is one of n_c classes (none, for the paper's layer-by-layer training), K ≤ `window`.
//! zₖ is one-hot, or shares of the places around a continuous gaze ([`Code`]).
//!
//! Deviation: W(k) applies to xₖ minus the mean μ of the training data (Montavon & Müller 2012). Learning is several
//! times faster, and average fixations carry no evidence, however many there are.
//!
//! Deviation: the paper prints the three-way term of the energy with a plus. Its own conditional p(h | x, z) needs the minus.
//!
//! [`FixationRbm`] is the machine, [`Trainer`] trains it by a [`Cost`], [`Controller`] chooses the next fixation.

mod batch;
mod controller;
#[cfg(test)]
mod controller_tests;
mod data;
mod gradient;
mod io;
mod model;
#[cfg(test)]
mod oracle_tests;
mod parameters;
mod places;
mod recipe;
mod train;

pub use self::controller::Controller;
pub use self::data::Sequences;
pub use self::io::About;
pub use self::model::{FixationRbm, Reading};
pub use self::places::{Code, Places};
pub use self::recipe::{Cost, Gates, Recipe};
pub use self::train::Trainer;
