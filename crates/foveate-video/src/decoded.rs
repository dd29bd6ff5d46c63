//! What decoders give: pictures, or why there is none.

use foveate_base::Error;
use foveate_core::scene::Image;

/// Why a frame did not come.
#[derive(Debug)]
pub(crate) enum DecodeError {
    /// Another decoder may do it.
    Unsupported(String),
    /// No decoder can.
    Damaged(String),
}

impl DecodeError {
    /// Damage without a known cause.
    pub(crate) fn damaged(found: impl std::fmt::Display) -> Self {
        Self::Damaged(format!("{found}; the file is damaged or cut off, copy it again"))
    }
}

/// What may not be taken for a file: no decoder can do without.
impl From<Error> for DecodeError {
    fn from(error: Error) -> Self {
        Self::Damaged(error.to_string())
    }
}

/// A picture and its time in seconds from the first.
pub(crate) type Picture = (Image, f64);

/// A result of a decoder.
pub(crate) type Decoded<T> = std::result::Result<T, DecodeError>;
