//! Measures of the paper's experiments.

pub(crate) mod learning;
pub(crate) mod multi;
pub(crate) mod policy_set;
pub(crate) mod recognised;
pub(crate) mod recovery;
pub(crate) mod tally;
pub(crate) mod timeline;
