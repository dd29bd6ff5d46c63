//! Measures of the paper's experiments.

pub mod learning;
pub mod multi;
pub mod policy_set;
pub mod recognised;
pub mod recovery;
pub mod tally;
pub mod timeline;
