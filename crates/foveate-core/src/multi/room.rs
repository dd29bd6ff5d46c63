//! What targets take of the memory that the process may take.

use crate::geometry::BBox;

/// Bytes that targets take, about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Room {
    /// What a target keeps between frames, beside its template.
    pub kept: u64,
    /// What looking at one needs, in each thread.
    pub look: u64,
    /// How far the template reaches, in boxes, from the middle to each side.
    pub reach: f64,
}

impl Room {
    /// What `n` targets and another one in this box take, with those threads that look, in pictures of three planes.
    pub(crate) fn with(&self, n: usize, bbox: &BBox, size: (usize, usize)) -> u64 {
        let area = 3.0 * bbox.w * bbox.h * (self.reach * self.reach);
        let template = (area as u64).min(3u64.saturating_mul(size.0 as u64).saturating_mul(size.1 as u64));
        let threads = crate::threads::several() as u64;
        (self.kept.saturating_add(template).saturating_mul(n as u64 + 1)).saturating_add(threads * self.look)
    }
}
