//! The levels and rectangles of a pyramid that a retina reads.

/// What one pyramid level must average.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Side of a cell in template units.
    pub side: f64,
    /// Channel: 0 grey, 1 and 2 colour opponents.
    pub channel: usize,
    /// Farthest cell centre from the gaze along an axis, template units.
    pub reach: f64,
}
