//! Settings of the search for a lost target, and their ranges.

use super::MOST;

foveate_base::settings! {
    /// Settings of the search; lengths are in template units (1 = half the target's box).
    pub struct RedetectionSettings in "redetection" {
        /// Frames between two searches.
        pub every: u64 = 4; 1.0 to 1e6,
        /// Distance of neighbouring places, above 0 to 10; larger in pictures that would have more than 16,000 places.
        pub step: f64 = 0.3; 1e-3 to 10.0,
        /// Approximate number of places scored in a frame. Larger pictures are searched over several frames.
        pub budget: usize = MOST as usize; 64.0 to MOST,
        /// Share of the particles that restart, 0 to 1.
        pub share: f64 = 0.3; 0.0 to 1.0,
        /// Number of places they restart from, 1 to 1000.
        pub places: usize = 8; 1.0 to 1000.0,
        /// Least fit of a place: 0 is the reference log-likelihood of frame 1 on the target, 1 that off it, 0 to 2.
        pub fit: f64 = 0.2; 0.0 to 2.0,
        /// Standard deviation about a place, above 0 to 10.
        pub spread: f64 = 0.15; 1e-3 to 10.0,
        /// Prior probability that a lost target is anywhere in the picture, above 0 to 1.
        pub chance: f64 = 0.5; 1e-9 to 1.0,
    }
}

impl RedetectionSettings {}
