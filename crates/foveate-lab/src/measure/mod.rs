//! Motion in metres and seconds from a track, with errors: positions, velocities and accelerations over time, and fitted curves.
//!
//! | step | module |
//! | --- | --- |
//! | positions and covariances of a run, or of its track.csv | [`Track`], [`Position`], [`read`], [`parse`] |
//! | distortion of the lens | [`Lens`] |
//! | pixels to metres, origin, axes, clock, and their texts | [`Axes`], [`Ruler`], [`Clock`], [`parse_point`], [`parse_angle`], [`Earlier`] |
//! | frames to look at | [`Ask`] |
//! | a fixed-interval smoother | [`smooth`] |
//! | fits with parameter errors | [`fit`], [`Curve`] |
//! | measure.csv, fits.json, ask.csv, measure.trk | [`measure`], [`tables`] |
//! | the same and measure.html, from a run (feature `eval`) | `MeasureFiles`, `write` |

mod ask;
mod fit;
mod lens;
mod linear;
mod measurement;
mod models;
#[cfg(feature = "eval")]
mod observer;
mod options;
#[cfg(feature = "eval")]
mod page;
mod requested;
mod smooth;
mod tables;
mod track;
mod trk;
mod units;

pub use ask::Ask;
pub use fit::{Fitted, Point, fit, student};
pub use lens::Lens;
pub use measurement::{Measurement, Row, Settings, measure};
pub use models::{Curve, Parameter};
#[cfg(feature = "eval")]
pub use observer::{FILES, Follower, Lines, MeasureFiles, write};
pub use options::{Earlier, parse_angle, parse_point};
pub use requested::{AXES, Fit, FitRequest, Value};
pub use smooth::{FAR, FEWEST, Sample, Smoothed, Smoothing, smooth};
pub use tables::{tables, text};
pub use track::{Position, Track, parse, read};
pub use units::{Axes, Clock, Ruler, Scale, unit, with_error};
