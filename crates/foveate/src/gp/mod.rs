//! Atoms of Bayesian optimisation (section 4.4). They know no tracking.

pub mod direct;
