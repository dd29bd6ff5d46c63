//! The memory estimate of targets.

use crate::geometry::{BBox, Size};

/// Approximate bytes per target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MemoryEstimate {
    /// Bytes that a target keeps between frames, beside its template.
    pub kept: u64,
    /// Bytes that a look needs, in each thread.
    pub look: u64,
    /// Extent of the template from its centre to each side, in boxes.
    pub reach: f64,
}

impl MemoryEstimate {
    /// Returns the bytes that a target in this box keeps with its template, in pictures of three planes.
    pub(crate) fn of_one(&self, bbox: &BBox, size: Size) -> u64 {
        let area = 3.0 * bbox.w * bbox.h * (self.reach * self.reach);
        let template = (area as u64).min(3u64.saturating_mul(size.width as u64).saturating_mul(size.height as u64));
        self.kept.saturating_add(template)
    }

    /// Returns the bytes of `n` targets and another one in this box, with the buffers of all threads, in pictures of three planes.
    pub(crate) fn with(&self, n: usize, bbox: &BBox, size: Size) -> u64 {
        let threads = crate::threads::several() as u64;
        self.of_one(bbox, size).saturating_mul(n as u64 + 1).saturating_add(threads * self.look)
    }
}
