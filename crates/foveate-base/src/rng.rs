//! Randomness named by (seed, target, frame, purpose, index), so that nothing else can change it.
//!
//! No module owns a generator. A caller that needs many independent draws uses stream `i` of [`Streams`]. Its bits
//! depend on its name alone, not on the number of threads, on observers, or on other targets in the scene.

use std::convert::Infallible;

use rand::{RngExt, TryRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

/// The generator behind every draw: xoshiro256++ (Blackman & Vigna 2019).
///
/// It has the draws that parts need most; for others it is a generator of the crate `rand`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rng(Xoshiro256PlusPlus);

impl Rng {
    /// A number from 0 to below 1, each as likely as another.
    pub fn uniform(&mut self) -> f64 {
        self.random()
    }
    /// A whole number from 0 to below `n`, each as likely as another.
    ///
    /// # Panics
    /// If `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.random_range(..n)
    }
}

impl TryRng for Rng {
    type Error = Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        self.0.try_next_u32()
    }
    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        self.0.try_next_u64()
    }
    #[inline]
    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        self.0.try_fill_bytes(bytes)
    }
}

/// The purpose of a draw. Two purposes never share bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// The first particles, from p(x₀).
    Start = 1,
    /// The proposal: x̃ₜ ~ q.
    Predict = 2,
    /// The policy's choice of gaze.
    Look = 3,
    /// Resampling.
    Select = 4,
    /// Calibration of the likelihood on the first frame.
    Calibrate = 5,
    /// The recogniser's own choice of gaze.
    Recognize = 6,
    /// Synthetic scenes.
    Scene = 7,
    /// Training: initial weights, shuffles, Gibbs chains.
    Train = 8,
    /// Where a lost target's particles start again.
    Redetection = 9,
    /// Where the particles of a target that has leapt start again.
    LocalSearch = 10,
    /// Where the particles start again at the place with the colours of the target.
    ColourSearch = 11,
    /// Motion during dropped frames.
    Dropped = 12,
}

/// A family of independent random streams with one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Streams {
    key: u64,
}

impl Streams {
    /// The streams of one target under one seed.
    pub fn new(seed: u64, target: u64) -> Self {
        Self { key: mix(mix(seed ^ 0x666f_7665_6174_6531) ^ target) }
    }
    /// The streams of one frame for one purpose.
    pub fn at(self, frame: u64, purpose: Purpose) -> Self {
        Self { key: mix(mix(self.key ^ frame) ^ ((purpose as u64) << 32)) }
    }
    /// Stream `i`.
    pub fn rng(self, i: u64) -> Rng {
        Rng(Xoshiro256PlusPlus::seed_from_u64(mix(self.key ^ mix(i))))
    }
}

/// SplitMix64's finalizer after its increment: a bijection of u64 that scatters neighbouring names.
fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn names_are_distinct_and_repeatable() {
        let s = Streams::new(1, 0);
        let draw = |streams: Streams, i| -> u64 { streams.rng(i).random() };
        let base = draw(s.at(1, Purpose::Predict), 0);
        assert_eq!(base, draw(Streams::new(1, 0).at(1, Purpose::Predict), 0));
        for other in [
            draw(s.at(1, Purpose::Predict), 1),
            draw(s.at(2, Purpose::Predict), 0),
            draw(s.at(1, Purpose::Select), 0),
            draw(Streams::new(2, 0).at(1, Purpose::Predict), 0),
            draw(Streams::new(1, 1).at(1, Purpose::Predict), 0),
        ] {
            assert_ne!(base, other);
        }
    }
}
