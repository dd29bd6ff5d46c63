//! The contrast of a box: how much more its pixels belong to the target than those around it.

use crate::geometry::{Extent, State};
use crate::identity::integral::Integral;

/// How far the ring goes that a state's box is compared with.
pub(in crate::identity) const RING: f64 = 1.5;
/// Contrast of frame 1 from which on the cue has its whole weight.
pub(in crate::identity) const FULL: f64 = 0.4;
/// Less contrast than this is none.
pub(in crate::identity) const LEAST: f64 = 0.02;
/// Bins with a smaller share of all pixels are ignored.
pub(in crate::identity) const EMPTY: f32 = 1e-4;
/// How far off a distance may lie.
pub(in crate::identity) const RANGE: (f64, f64) = (-0.2, 1.2);

/// Mean probability inside the box minus that in a ring around it. Pixels outside the picture are background.
pub(super) fn contrast(sums: &Integral, s: &State, extent: Extent) -> f64 {
    if sums.is_empty() {
        return 0.0;
    }
    let (w, h) = s.half(extent);
    let (inside, n) = sums.over(s.x - w, s.y - h, s.x + w, s.y + h);
    let (all, m) = sums.over(s.x - RING * w, s.y - RING * h, s.x + RING * w, s.y + RING * h);
    let whole = sums.samples(2.0 * w, 2.0 * h);
    inside / whole.max(n).max(1.0) - (all - inside) / (m - n).max(1.0)
}
