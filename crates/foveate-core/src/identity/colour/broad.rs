//! The colours of frame 1 in broad bins, to find a target that is blurred by its motion.
//!
//! Blur mixes the colours of the target with those of the ground, so few pixels keep the bins of frame 1. Both histograms of frame 1 are
//! smoothed over neighbouring bins, and then recognise mixed colours too. Broad bins separate less than narrow ones, so they weigh no
//! particles.

use super::contrast::{EMPTY, FULL, RANGE, RING, contrast};
use crate::geometry::{Extent, State};
use crate::identity::integral::{Bins, GREY, Integral, parts, step};
use crate::scene::Image;

/// Smoothing by [w, 1 - 2w, w] along each axis of the bins: w, and how often. The standard deviation is 1.9 bins.
const WEIGHT: f32 = 0.3;
const PASSES: usize = 6;

/// p(target | bin) of smoothed histograms, and buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Broad {
    /// As [`Integral`] sums it.
    parts: Vec<u16>,
    /// The difference of the mean probabilities of target and surroundings in frame 1.
    contrast: f64,
    sums: Integral,
}

impl Broad {
    /// Of the histograms of target and surroundings in frame 1.
    pub(super) fn of(first: [&Vec<f32>; 2]) -> Self {
        let [target, around] = first.map(|it| smooth(it.clone()));
        let probability: Vec<f32> =
            target.iter().zip(&around).map(|(f, b)| (f + 0.5 * EMPTY) / (f + b + EMPTY)).collect();
        let mean = |shares: &[f32]| shares.iter().zip(&probability).map(|(s, p)| f64::from(s * p)).sum::<f64>();
        let mut it = Self { contrast: mean(first[0]) - mean(first[1]), ..Self::default() };
        parts(&probability, &mut it.parts);
        it
    }

    /// Writes the distance of the colours at each state from those of the target: 0 at the contrast of frame 1, 1 without contrast. Returns
    /// whether target and surroundings differ strongly enough in frame 1; if not, nothing is written.
    pub(super) fn distances(
        &mut self,
        image: &Image,
        states: &[State],
        extent: Extent,
        bins: &mut Bins,
        out: &mut [f64],
    ) -> bool {
        if self.contrast < FULL {
            return false;
        }
        let (mut region, mut least) = ([f64::MAX, f64::MAX, f64::MIN, f64::MIN], f64::MAX);
        for state in states {
            let (w, h) = state.half(extent);
            let [left, top, right, bottom] = region;
            region = [
                left.min(state.x - RING * w),
                top.min(state.y - RING * h),
                right.max(state.x + RING * w),
                bottom.max(state.y + RING * h),
            ];
            least = least.min(w.min(h));
        }
        self.sums.fill(image, region, step(least), &self.parts, bins);
        for (state, out) in states.iter().zip(out) {
            *out = 1.0 - (contrast(&self.sums, state, extent) / self.contrast).clamp(RANGE.0, RANGE.1);
        }
        true
    }
}

/// Smooths a histogram along each of its axes; its ends repeat.
fn smooth(mut shares: Vec<f32>) -> Vec<f32> {
    let (side, strides): (usize, &[usize]) = if shares.len() == GREY { (GREY, &[1]) } else { (16, &[1, 16, 256]) };
    let mut before = vec![0.0; shares.len()];
    for stride in strides.repeat(PASSES) {
        before.copy_from_slice(&shares);
        for (k, share) in shares.iter_mut().enumerate() {
            let place = k / stride % side;
            let below = before[if place > 0 { k - stride } else { k }];
            let above = before[if place + 1 < side { k + stride } else { k }];
            *share += WEIGHT * (below + above - 2.0 * before[k]);
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::super::{Colour, Settings};
    use super::*;

    const EXTENT: Extent = Extent { half_w: 12.0, half_h: 12.0 };

    /// An orange disc at `x`, blurred over `blur` pixels, on a ground of which both colours change along the way.
    fn picture(x: f64, blur: usize) -> Image {
        let pixel = |i: usize, j: usize| {
            let ground = if i < 60 { [90.0, 90.0, 150.0] } else { [150.0, 110.0, 110.0] };
            let orange = [250.0, 120.0, 30.0];
            let on = |k: usize| (i as f64 - x - k as f64).hypot(j as f64 - 32.0) <= 12.0;
            let share = (0..=blur).filter(|k| on(*k)).count() as f64 / (blur + 1) as f64;
            [0, 1, 2].map(|c| (share * orange[c] + (1.0 - share) * ground[c]) as u8)
        };
        let bytes: Vec<u8> = (0..64 * 128).flat_map(|k| pixel(k % 128, k / 128)).collect();
        Image::from_rgb8(128, 64, &bytes).expect("enough bytes")
    }

    /// A blurred target before ground that frame 1 does not have is near, the ground is far; narrow bins do not separate them.
    #[test]
    fn a_blurred_target_on_other_ground_is_near() {
        let at = |x: f64| State { x, y: 32.0, ..State::default() };
        let mut colour = Colour::new(Settings::default());
        colour.init(&picture(30.0, 0), &at(30.0), EXTENT);
        let (states, mut out) = ([at(99.0), at(60.0), at(30.0)], [0.0; 3]);
        assert!(colour.broad_distances(&picture(92.0, 14), &states, EXTENT, &mut out));
        assert!(out[0] < 0.5 && out[1] > 0.8 && out[2] > 0.8, "{out:?}");
    }

    /// A target of the colours of its surroundings has no distance.
    #[test]
    fn a_target_of_the_colours_of_its_surroundings_has_no_distance() {
        let mut colour = Colour::new(Settings::default());
        let at = State { x: 30.0, y: 32.0, ..State::default() };
        colour.init(&Image::grey(64, 64, 90), &at, EXTENT);
        assert!(!colour.broad_distances(&Image::grey(64, 64, 90), &[at], EXTENT, &mut [0.0]));
    }

    /// The sum stays, and a single bin spreads over its neighbours along each axis alone.
    #[test]
    fn smoothing_keeps_the_sum() {
        for (n, k) in [(GREY, 3), (4096, 16 * 16 * 7 + 16 * 15 + 2)] {
            let mut one = vec![0.0; n];
            one[k] = 1.0;
            let smoothed = smooth(one);
            assert!((smoothed.iter().sum::<f32>() - 1.0).abs() < 1e-4);
            assert!(smoothed[k] < 0.5 && smoothed[k] >= smoothed.iter().copied().fold(0.0, f32::max));
        }
    }
}
