//! The numbers of a model.

/// The largest number of a model, either way: products of four, summed up over a million, are numbers still.
pub(super) const LARGEST: f32 = 1e8;

/// Whether a model may have this number: a finite one that its file is read with.
pub(crate) fn is_usable(x: f32) -> bool {
    x.abs() <= LARGEST
}
