//! What taps read: a plane of samples.

/// Samples of an image, or of its box means, on a grid of spacing 1.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a> {
    /// Rows one after another, `stride` apart.
    pub data: &'a [f32],
    /// Samples in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// Distance of a row's start from the next one's, at least `width`.
    pub stride: usize,
    /// Image coordinates of the first sample.
    pub x0: f32,
    /// See `x0`.
    pub y0: f32,
}

/// Cells that are computed at a time.
pub(crate) const CELLS: usize = 16;
/// `values`, at least one, filled up with the last.
pub(crate) fn padded(values: &[f32]) -> [f32; CELLS] {
    let mut block = [values[values.len() - 1]; CELLS];
    block[..values.len()].copy_from_slice(values);
    block
}
