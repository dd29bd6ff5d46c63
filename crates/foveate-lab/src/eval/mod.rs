//! How good a track is: one-pass evaluation as OTB does it, and centre errors as the paper does.
//!
//! One pass (OPE): the tracker gets the truth in frame 1 and nothing more. [`metrics`] scores one track,
//! [`curves`] keeps and draws success and precision, [`sequence`] finds sequences in folders,
//! [`compare`] scores folders of results or runs a tracker, [`table`] shows trackers side by side, [`cases`] run by run,
//! [`by_attribute`] by what makes a sequence hard. [`choice`] chooses settings on some sequences and judges them on others.
//! Scores equal those of the got10k toolkit's OTB experiment (0.1.3) on the same boxes.

pub mod attributes;
pub mod by_attribute;
pub mod cases;
pub mod catalogue;
pub mod centres;
pub mod choice;
pub mod choice_table;
pub mod compare;
pub mod confidence;
pub mod confidence_cross;
pub mod confidence_fit;
pub mod confidence_plot;
pub mod curves;
pub mod experiment;
pub mod localisation_fit;
pub mod masks;
pub mod metrics;
pub mod mot;
pub mod regret;
pub mod reliability;
pub mod sequence;
pub mod table;

pub use cases::Case;
pub use centres::{CentreScore, score_centres};
pub use compare::{Evaluation, Row, TrackRun, run_all, score_folder, track_files};
pub use curves::Curves;
pub use metrics::{Score, score};
pub use reliability::Reliability;
pub use sequence::{Sequence, find_sequences, of_half};
